"""`handtrack open` as its user has it: the part that tracks is killed, and the page goes on; Ctrl-C ends both parts."""

import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from handtrack import bundled_session
from handtrack.store.lease import holder_of
from tests.app.command_line import PROGRAM
from tests.app.waiting import eventually
from tests.app.wire import WireClient

pytestmark = pytest.mark.skipif(
    not Path("/proc/self/task").is_dir(), reason="looks into its process"
)


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


def test_c40_the_page_outlives_what_tracks(program, tmp_path):
    assert program.stdout is not None and program.stderr is not None
    address = re.compile(r"is open at (http://\S+)")
    url = next(said[1] for line in program.stdout if (said := address.search(line)))
    with WireClient(url) as client:

        def came(words, after=0):
            return any(re.search(words, str(message)) for _, message in client.messages[after:])

        eventually(lambda: came(">ready"))
        client.press("Track all frames")
        eventually(lambda: came(r"Tracking: ([3-9]|\d\d) of 100 frames"), "frames are tracked")
        loaded = Path(f"/proc/{program.pid}/maps").read_text()
        assert not [name for name in ("llvmlite", "scipy", "skimage") if f"/{name}/" in loaded]
        killed = holder_of(tmp_path / "session/tracks").pid
        assert killed != program.pid
        began = len(client.messages)
        os.kill(killed, signal.SIGKILL)
        eventually(lambda: came("The engine was ended", began))
        eventually(lambda: came("Tracking stopped at (<[^>]+>)?frame", began))  # it may be a link
        eventually(lambda: came("tracked frames", began))
        assert holder_of(tmp_path / "session/tracks").pid != killed
        sent = len(client.messages)
        client.set_value(client.button("x mm"), 12.0)
        eventually(lambda: came("batched_positions", sent))
    program.send_signal(signal.SIGINT)
    out, err = program.communicate()
    assert program.returncode == 0
    assert "Traceback" not in out + err
    assert not any((tmp_path / "session/tracks").glob("lease-*.json"))
