"""Looking through a camera on the wire: a page of one's own, the wheel, a walk out of the camera and the way back."""

from __future__ import annotations

import threading
import time
from typing import Any

import numpy as np
import pytest
import viser.transforms as vtf

from handtrack_app.page.scene import looking
from handtrack_app.page.views import through
from handtrack_app.page.views.through import Through
from handtrack_app.workbench import Workbench
from tests.app.waiting import eventually
from tests.app.wire import WireClient

WHERE = {
    "SetCameraFovMessage": "fov", "SetCameraPositionMessage": "position", "SetCameraLookAtMessage": "look_at",
    "SetCameraUpDirectionMessage": "position",
}  # fmt: skip


class Browser:
    """What a page does with its camera: as it is told, until the user turns the wheel or walks."""

    def __init__(self, bench: Workbench, wire: WireClient) -> None:
        self.bench, self.wire = bench, wire
        before = set(bench.server.get_clients())
        eventually(lambda: len(bench.server.get_clients()) > 0, "it came")
        self.number = max(before | set(bench.server.get_clients()))

    def press(self, words: str) -> None:
        commands = self.bench.server.gui._command_handle_from_uuid
        uuid = next(one for one, handle in commands.items() if handle._impl.props.label == words)
        self.wire.send({"type": "CommandTriggerMessage", "uuid": uuid})

    @property
    def view(self) -> Through | None:
        return self.bench.stage.looking.views.of(self.number)

    def told(self, kind: str) -> Any:
        """Return the latest value that the page was told."""
        said = [
            m for _, m in list(self.wire.messages) if m["type"] == kind and not m.get("initial")
        ]
        return said[-1][WHERE[kind]] if said else None

    def tell(self, position: np.ndarray, look_at: np.ndarray, width: int = 800) -> None:
        """Say where its camera is now."""
        ahead = (look_at - position) / np.linalg.norm(look_at - position)
        up = np.array(self.told("SetCameraUpDirectionMessage"))
        down = -(up - (up @ ahead) * ahead)
        down /= np.linalg.norm(down)
        wxyz = vtf.SO3.from_matrix(np.stack([np.cross(down, ahead), down, ahead], axis=1)).wxyz
        self.wire.send({
            "type": "ViewerCameraMessage", "wxyz": wxyz.tolist(), "position": position.tolist(),
            "fov": self.told("SetCameraFovMessage"), "near": 0.01, "far": 100.0, "image_height": 600,
            "image_width": width, "look_at": look_at.tolist(), "up_direction": up.tolist(),
        })  # fmt: skip

    def obey(self, width: int = 800) -> None:
        """Stand where it was told to."""

        def told() -> bool:
            view = self.view
            if view is None or self.told("SetCameraFovMessage") != view.eye.fov:
                return False
            return np.allclose(self.target - self.centre, view.told[-1].way, rtol=0, atol=1e-9)

        eventually(told, "told where to look")
        self.tell(self.centre, self.target, width)

    @property
    def centre(self) -> np.ndarray:
        return np.array(self.told("SetCameraPositionMessage"))

    @property
    def target(self) -> np.ndarray:
        return np.array(self.told("SetCameraLookAtMessage"))

    def times(self) -> float:
        return 0.0 if self.view is None else self.view.zoom.times


def test_it_stands_in_the_camera_and_shows_the_hand(bench: Workbench) -> None:
    with WireClient(bench.url) as wire:
        page = Browser(bench, wire)
        page.press("Look through front")
        eventually(lambda: page.view is not None and page.view.follows, "it looks through")
        page.obey()
        assert page.view is not None
        np.testing.assert_allclose(page.centre, page.view.card.centre, atol=1e-9)
        assert 1.0 < page.times() <= 12.0
        assert page.told("SetCameraFovMessage") == pytest.approx(page.view.eye.fov)
        page.press("View: the whole image")
        eventually(lambda: page.times() == 1.0, "all of it")


def test_the_wheel_enlarges_and_nothing_is_counted_twice(bench: Workbench) -> None:
    with WireClient(bench.url) as wire:
        page = Browser(bench, wire)
        page.press("Look through front")
        page.obey()
        page.press("View: the whole image")
        eventually(lambda: page.times() == 1.0, "all of it")
        page.obey()
        centre, target, fov = page.centre, page.target, page.told("SetCameraFovMessage")
        for notch in range(1, 5):  # the browser goes on while the answers are under way
            page.tell(target + 0.95**notch * (centre - target), target)
        eventually(
            lambda: page.times() == pytest.approx(0.95**-12, rel=1e-3), "four notches, no more"
        )
        eventually(
            lambda: (
                np.tan(page.told("SetCameraFovMessage") / 2)
                == pytest.approx(np.tan(fov / 2) * 0.95**12, rel=1e-3)
            ),
            "the field of view follows",
        )
        assert page.view is not None and not page.view.follows and not page.view.left


def test_an_answer_to_what_it_was_told_before_undoes_nothing(
    bench: Workbench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(through, "_SETTLED_S", 1e6)  # however slow the machine
    with WireClient(bench.url) as wire:
        page = Browser(bench, wire)
        page.press("Look through front")
        page.obey()
        old = page.centre, page.target
        page.press("View: the whole image")
        eventually(lambda: page.times() == 1.0, "all of it")
        page.tell(*old)
        page.obey()
        time.sleep(0.3)
        assert page.times() == 1.0


def test_a_page_has_one_screen_whichever_threads_redraw(
    bench: Workbench, monkeypatch: pytest.MonkeyPatch
) -> None:
    add, made = looking._add_screen, list[Any]()

    def slow(client: Any) -> Any:
        made.append(client)
        time.sleep(0.1)
        return add(client)

    monkeypatch.setattr(looking, "_add_screen", slow)
    with WireClient(bench.url) as wire:
        page = Browser(bench, wire)
        page.press("Look through front")
        eventually(lambda: bench.stage.looking.anyone, "it looks through")
        redraws = [threading.Thread(target=bench.redraw) for _ in range(3)]
        for one in redraws:
            one.start()
        for one in redraws:
            one.join(60.0)
        screen = bench.stage.looking._screens[page.number].image
        assert len(made) == 1 and not screen._impl.removed


def test_who_walks_out_is_told_and_one_key_leads_back(
    bench: Workbench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(through, "_SETTLED_S", 0.0)
    with WireClient(bench.url) as wire:
        page = Browser(bench, wire)
        page.press("Look through front")
        page.obey()
        page.tell(page.centre + 0.05, page.target + 0.05)
        eventually(lambda: page.view is not None and page.view.left, "left")
        eventually(lambda: "You left front" in str(wire.messages), "told")
        page.press("View: the hand, and back into the camera")
        eventually(lambda: page.view is not None and not page.view.left, "back")
        page.obey()
        assert page.view is not None and page.view.follows


def test_each_page_has_a_view_of_its_own_also_who_looks_on(bench: Workbench) -> None:
    with WireClient(bench.url) as one:
        editor = Browser(bench, one)
        with WireClient(bench.url) as other:
            eventually(lambda: len(bench.server.get_clients()) == 2, "both are there")
            guest = Browser(bench, other)
            guest.press("Look through side")
            editor.press("Look through front")
            eventually(lambda: editor.view is not None and guest.view is not None, "both look")
            assert editor.view is not None and guest.view is not None
            assert (editor.view.card.name, guest.view.card.name) == ("front", "side")
            guest.press("View: the whole image")
            eventually(lambda: guest.times() == 1.0, "the guest's")
            assert editor.times() > 1.0


def test_a_window_of_another_shape_shows_the_hand_as_well(bench: Workbench) -> None:
    with WireClient(bench.url) as wire:
        page = Browser(bench, wire)
        page.press("Look through front")
        page.obey()
        page.obey(width=300)
        eventually(lambda: page.view is not None and page.view.aspect == 0.5, "the new shape")
        assert page.view is not None and page.view.follows
        eventually(
            lambda: page.told("SetCameraFovMessage") == pytest.approx(page.view.eye.fov),  # type: ignore[union-attr]
            "its field of view",
        )
