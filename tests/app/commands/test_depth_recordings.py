"""The recipes of docs/how-to/depth_and_stereo.md do what they say, on recordings made by others' libraries."""

import pytest

from handtrack import Session
from tests.capture.sample_files import sample
from tests.conftest import REPOSITORY
from tests.test_docs import blocks

PAGE = REPOSITORY / "docs" / "how-to" / "depth_and_stereo.md"


def test_a_realsense_recording_becomes_a_session(handtrack, tmp_path, monkeypatch):
    """Of three depth images of 500, 501, 502 units, a frame between the last two was dropped."""
    pytest.importorskip("rosbags")
    monkeypatch.chdir(tmp_path)
    sample("depth/realsense", tmp_path)
    (recipe,) = blocks(PAGE, "python")
    exec(compile(recipe, str(PAGE), "exec"), {})
    (command,) = (
        line for body in blocks(PAGE, "sh") for line in body.splitlines() if " new " in line
    )
    handtrack.does(*command.split()[1:])
    session = Session.open(tmp_path / "my_hand")
    depths = [session.view("depth").depth_m(frame) for frame in range(4)]
    assert [None if d is None else float(d[0, 0]) for d in depths] == pytest.approx(
        [0.5, 0.501, None, 0.502]
    )
    assert len(session.measured_cloud(0)) > 1000
