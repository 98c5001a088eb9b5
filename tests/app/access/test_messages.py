"""What passes the message filter: through a real socket to viser, and the rules alone; and a hostile client that knows the token against a whole
workbench: what `handtrack bench hostile` does for five minutes, in seconds."""

import contextlib
import math
import time
from functools import partial

import msgspec
import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed

from handtrack_app.access.web_server import (
    BURST,
    LARGEST_FILE,
    LARGEST_MESSAGE,
    MOST_WAITING,
    RATE,
    Flow,
    Rejected,
)
from handtrack_app.log import logging_to
from tests.app.desk import shown
from tests.app.fake_run import fake_document
from tests.app.waiting import eventually
from tests.app.wire import WireClient
from tests.experiments.workbench import attacks
from tests.experiments.workbench.program import resident_mb

CAMERA = {
    "type": "ViewerCameraMessage", "wxyz": [1.0, 0.0, 0.0, 0.0], "position": [0.0, 0.0, -1.0], "fov": 0.7,
    "near": 0.01, "far": 100, "image_height": 600, "image_width": 800, "look_at": [0, 0, 0],
    "up_direction": [0.0, -1.0, 0.0],
}  # fmt: skip
DRAG = {
    "type": "SceneNodeDragMessage", "phase": "update", "name": "/control", "instance_index": None,
    "start_position": [0, 0, 0], "start_screen_pos": [0, 0], "end_position": [0, 0, 0], "end_screen_pos": [0, 0],
    "button": "left", "modifier": None, "owner": "",
}  # fmt: skip
MOVE = {
    "type": "TransformControlsUpdateMessage", "name": "/control", "wxyz": [1, 0, 0, 0], "position": [1, 2, 3], "owner": "",
}  # fmt: skip
KEPT = {"type": "LocalStorageGetItemResponseMessage", "value": "x", "error": None, "request_uuid": "1"}  # fmt: skip


def examined(small, message):
    kind, packed = small.web.messages.check(msgspec.msgpack.encode(message))
    return kind, msgspec.msgpack.decode(packed)


def update(handle, **updates):
    return {"type": "GuiUpdateMessage", "uuid": handle._impl.uuid, "updates": updates}


# ---- the rules


@pytest.mark.parametrize("message", [CAMERA, DRAG, MOVE, KEPT])
def test_what_the_page_sends_passes_unchanged(small, message):
    assert examined(small, message)[1] == message


@pytest.mark.parametrize(
    ("widget", "value", "passed"),
    [
        ("slider", 2, 2.0),
        ("slider", 1e300, 10.0),
        ("whole", 3.0, 3),
        ("whole", -1e300, 0),
        ("span", [3.0, 99], [3, 10]),
        ("button", True, True),
        ("row", "Right", "Right"),
        ("choice", "Two", "Two"),
        ("box", True, True),
    ],
)
def test_a_value_of_the_widgets_kind_passes_within_its_limits(small, widget, value, passed):
    found = examined(small, update(getattr(small, widget), value=value))[1]["updates"]
    assert found == {"value": passed}
    assert type(found["value"]) is type(passed)


@pytest.mark.parametrize(
    ("widget", "value"),
    [
        *[("slider", value) for value in (math.nan, math.inf, "1", None, True, [1], {}, b"1")],
        *[
            ("span", value)
            for value in ([1], [1, 2, 3], [1, math.nan], [True, 2], 5, "ab", [[1], 2])
        ],
        *[("choice", value) for value in ("Three", 1, None, ["One"])],
        ("row", "Up"),
        ("row", 0),
        ("box", 1),
        ("box", "yes"),
        ("button", 1),
        ("button", "x" * 5000),
    ],
)
def test_a11_a_value_of_another_kind_is_refused(small, widget, value):
    with pytest.raises(Rejected):
        examined(small, update(getattr(small, widget), value=value))


@pytest.mark.parametrize(
    "updates",
    [{"update_cb": []}, {"value": 1.0, "removed": True}, {"props": {}}, {}, {"__class__": 1}],
)
def test_a11_only_the_value_can_be_set(small, updates):
    with pytest.raises(Rejected):
        examined(small, update(small.slider, **updates))


@pytest.mark.parametrize(
    "message",
    [
        {"type": "RunJavascriptMessage", "source": "1"},
        {"type": "ShareUrlRequest"},
        {"type": "GuiUpdateMessage", "uuid": "nobody", "updates": {"value": 1}},
        {"type": "CommandTriggerMessage", "uuid": "nobody"},
        {"type": "NoSuchMessage"},
        {},
        [1, 2],
        DRAG | {"name": "/nobody"},
        DRAG | {"phase": "later"},
        MOVE | {"position": [math.nan, 0, 0]},
        MOVE | {"wxyz": [0, 0, 0, 0]},
        MOVE | {"more": 1},
        CAMERA | {"fov": 0.0},
        CAMERA | {"position": [0, 0]},
        {"type": "ScenePointerMessage", "event_type": "click", "ray_origin": None, "ray_direction": None,
         "screen_pos": [[0, 0]], "modifier": None},
        {"type": "ScenePointerMessage", "event_type": "rect-select", "ray_origin": None, "ray_direction": None,
         "screen_pos": [[0, 0]], "modifier": None},
    ],
)  # fmt: skip
def test_a11_c49_other_messages_are_refused(small, message):
    with pytest.raises(Rejected):
        examined(small, message)


@pytest.mark.parametrize("raw", [b"", b"\xc1", b"\x91" * 60_000, "text", b"\xdd\xff\xff\xff\xff"])
def test_a11_what_is_no_message_is_refused(small, raw):
    with pytest.raises(Rejected):
        small.web.messages.check(raw)


def test_a_widget_that_is_switched_off_stays(small):
    small.slider.disabled = True
    with pytest.raises(Rejected, match="disabled"):
        examined(small, update(small.slider, value=2.0))


# ---- the flow of one client


class Clock:
    now = 0.0

    def __call__(self):
        return self.now


def test_a_burst_passes_at_once_then_the_newest_of_each_kind_at_a_steady_rate():
    clock = Clock()
    flow = Flow(clock)
    passed = []
    for k in range(int(BURST) + 100):
        assert flow.put("slider", b"%d" % k)
        passed += [message] if (message := flow.take()) else []
    assert passed[-1] == b"%d" % (BURST - 1)
    assert flow.take() is None
    clock.now += flow.pause() or 0.0
    assert flow.take() == b"%d" % (BURST + 99)
    assert flow.pause() is None
    clock.now += 1.0
    assert sum(flow.put(k, b"") for k in range(1000)) == MOST_WAITING
    assert sum(flow.take() is not None for _ in range(1000)) == pytest.approx(RATE, abs=2)
    clock.now += 1e3  # a pause earns a burst and no more
    assert sum(flow.put("slider", b"") and flow.take() is not None for _ in range(1000)) == BURST


# ---- through the socket


def test_a_small_file_reaches_an_upload_button_and_nothing_else_does(small):
    button = small.web.server.gui.add_upload_button("File")
    small.web.messages.files[button._impl.uuid] = lambda *file: small.heard.append(file[1:])
    whole = bytes(range(256)) * (LARGEST_FILE // 256)
    with WireClient(small.url) as client:
        eventually(small.web.server.get_clients)
        for odd in (
            begins(button, -1), begins(button, LARGEST_FILE, 2), begins(button, 3, 0), part(button, b"x"),
            begins(button, 3), part(button, b"four"), begins(button, 3), part(button, "abc"),
            {"type": "ResetGuiMessage", "content": whole}, {"type": "ViewerCameraMessage", "content": whole},
            begins(small.slider, 3), part(small.slider, b"abc"),
        ):  # fmt: skip
            client.send(odd)
        client.send(begins(button, len(whole), transfer="2"))
        client.send(part(button, whole, transfer="2"))
        eventually(lambda: small.heard)
        client.send(begins(button, 10**8))
        eventually(lambda: len(small.heard) == 2, "one that is too large")
        for k in range(100):
            client.send(begins(button, 3, transfer=f"more {k}"))
        client.set_value(small.slider, 4.0)
        eventually(lambda: 4.0 in small.heard, "the same client goes on")
    assert small.heard == [("x", whole), ("x", None), 4.0]
    assert small.web.messages.refused == 10 and len(small.web.messages._begun) < 10


def begins(widget, size=10**12, parts=1, transfer="1", filename="x"):
    return {
        "type": "FileTransferStartUpload", "source_component_uuid": widget._impl.uuid, "transfer_uuid": transfer,
        "filename": filename, "mime_type": "x", "size_bytes": size, "part_count": parts,
    }  # fmt: skip


def part(widget, content, index=0, transfer="1"):
    return {
        "type": "FileTransferPart", "source_component_uuid": widget._impl.uuid, "transfer_uuid": transfer,
        "part_index": index, "content": content,
    }  # fmt: skip


def test_a11_a_large_message_ends_its_sender_only(small):
    with WireClient(small.url) as other, WireClient(small.url) as client:
        with contextlib.suppress(ConnectionClosed):
            client.send({"type": "X", "more": bytes(LARGEST_MESSAGE + LARGEST_FILE + 1)})
        eventually(lambda: client.close_code == 1009)
        other.set_value(small.slider, 4.0)
        eventually(lambda: 4.0 in small.heard, "the other one goes on")


def test_a11_pings_without_end_send_their_sender_away(small, monkeypatch):
    # however slow the machine, all that is sent comes at one moment
    monkeypatch.setattr("handtrack_app.access.web_server.Flow", partial(Flow, Clock()))
    ping = b"\x89\xfd" + bytes(4 + 125)
    with WireClient(small.url) as client:
        with contextlib.suppress(OSError):
            client.send_packed(ping * 100_000)
        eventually(lambda: client.close_code is not None)


def test_the_last_of_many_values_arrives(small):
    """More than passes at once: the older ones of a widget give way, not the last."""
    with WireClient(small.url) as client:
        for k in range(1500):
            client.set_value(small.slider, (k % 20) / 2)
        client.set_value(small.slider, 7.0)
        eventually(lambda: small.slider.value == 7.0)


def test_what_the_page_said_outlives_what_the_program_writes(small):
    with WireClient(small.url) as client:
        client.set_value(small.slider, 3.0)
        eventually(lambda: small.slider.value == 3.0)
    small.slider.value = 9.0
    assert small.web.messages.sent_value(small.slider) == 3.0
    assert small.web.messages.sent_value(small.whole) == 1


def test_a_node_of_one_page_alone_is_moved_by_that_page(small):
    with WireClient(small.url), WireClient(small.url):
        eventually(lambda: len(small.web.server.get_clients()) == 2)
        first, second = sorted(small.web.server.get_clients())
        small.web.server.get_clients()[first].scene.add_image(
            "/screen", np.zeros((4, 4, 3), np.uint8), 1.0, 1.0
        )
        drag, filter = msgspec.msgpack.encode(DRAG | {"name": "/screen"}), small.web.messages
        assert filter.check(drag, first)[0] == ("drag", "/screen")
        with pytest.raises(Rejected):
            filter.check(drag, second)


FEWER = {
    "_VALUES": 3000, "_UPLOAD_BYTES": 70_000_000, "_FLOOD_S": 1.0, "_SLOW_READERS": 4, "_SLOW_S": 0.5,
    "_RECONNECTS": 100, "_PIECES": 600_000,
}  # fmt: skip


def callbacks(bench):
    known = bench.server.gui._gui_input_handle_from_uuid.items()
    return {uuid: len(handle._impl.update_cb) for uuid, handle in known}


@pytest.fixture(scope="module")
def attacked(tmp_path_factory):
    with shown(tmp_path_factory.mktemp("attacked"), opener=fake_document) as workbench:
        yield workbench


@pytest.mark.parametrize("name", list(attacks.ATTACKS))
def test_a11_c49_a_hostile_client_harms_nobody(attacked, tmp_path, capfd, monkeypatch, name):
    bench = attacked
    for constant, fewer in FEWER.items():
        monkeypatch.setattr(attacks, constant, fewer)
    slider, before = bench.layout.pose.sliders["index_mcp_flex"], callbacks(bench)
    page = attacks.TargetPage(bench.url, list(before))
    with logging_to(tmp_path / "log"), WireClient(bench.url) as honest:
        memory = resident_mb("self")
        attacks.ATTACKS[name](page)
        time.sleep(0.3)
        for k in range(9):
            sent = honest.set_value(slider, 10.0 + k + np.random.default_rng(k).random())
            came = honest.wait_for(sent, "/hand/flesh", "batched_positions")
            assert came is not None, "the hand did not move"
        assert resident_mb("self") - memory < 50
    assert before.items() <= callbacks(bench).items()
    assert capfd.readouterr() == ("", "")
