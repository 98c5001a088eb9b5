"""`handtrack open` as its user has it: the part that tracks is killed, and the page goes on; Ctrl-C ends both parts."""

import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from handtrack import bundled_session
from tests.app.command_line import PROGRAM
from tests.app.waiting import eventually
from tests.app.wire import WireClient

pytestmark = pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="finds its processes")


@pytest.fixture
def program(tmp_path):
    leave_out = shutil.ignore_patterns("tracks")
    session = shutil.copytree(
        bundled_session("open_fist_open"), tmp_path / "session", ignore=leave_out
    )
    environment = PROGRAM | {"HANDTRACK_HOME": str(tmp_path / "home"), "TMPDIR": str(tmp_path)}
    command = [sys.executable, "-m", "handtrack_app.cli", "open", str(session), "--no-browser"]
    with subprocess.Popen(
        [*command, "--port", "0", "--memory", "4"],
        env=environment,
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # whoever runs the tests in a shell's background has it ignored, and so would the program
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),  # noqa: PLW1509
    ) as started:
        yield started
        started.kill()


def widget(client, kind, label):
    """Return what `set_value` takes for the widget with a label."""
    for _, message in list(client.messages):
        if message["type"] == kind and message["props"].get("label") == label:
            return SimpleNamespace(_impl=SimpleNamespace(uuid=message["uuid"]))
    return None


def test_c40_the_page_outlives_what_tracks(program, tmp_path):
    assert program.stdout is not None and program.stderr is not None
    address = re.compile(r"is open at (http://\S+)")
    url = next(said[1] for line in program.stdout if (said := address.search(line)))
    with WireClient(url) as client:

        def came(words, after=0):
            return any(re.search(words, str(message)) for _, message in client.messages[after:])

        def engine():
            processes = Path("/proc").glob("[0-9]*/stat")
            (child,) = (
                int(p.parent.name)
                for p in processes
                if _parent(p) == program.pid
                and b"resource_tracker" not in p.with_name("cmdline").read_bytes()
            )
            return child

        eventually(
            lambda: widget(client, "GuiButtonMessage", "Track all frames") is not None,
            "it is shown",
            60.0,
        )
        eventually(lambda: came(">ready"), "it is open", 60.0)
        client.set_value(widget(client, "GuiButtonMessage", "Track all frames"), True)
        eventually(
            lambda: came(r"Tracking: ([3-9]|\d\d) of 100 frames"), "frames are tracked", 90.0
        )
        loaded = Path(f"/proc/{program.pid}/maps").read_text()
        assert not [name for name in ("llvmlite", "scipy", "skimage") if f"/{name}/" in loaded]
        killed = engine()
        began = len(client.messages)
        os.kill(killed, signal.SIGKILL)
        eventually(lambda: came("The engine was ended", began), "it is told")
        assert came("Tracking stopped at (<[^>]+>)?frame", began)  # a link to it, in the messages
        eventually(lambda: came("tracked frames", began), "they are back", 60.0)
        assert engine() != killed
        slider = widget(client, "GuiSliderMessage", "x mm")
        sent = len(client.messages)
        client.set_value(slider, 12.0)
        eventually(lambda: came("batched_positions", sent), "the hand moves")
    program.send_signal(signal.SIGINT)
    out, err = program.communicate(timeout=120)
    assert program.returncode == 0
    assert "Traceback" not in out + err
    assert not any((tmp_path / "session/tracks").glob("lease-*.json"))


def _parent(stat):
    try:
        return int(stat.read_text().rpartition(")")[2].split()[1])
    except OSError:
        return 0
