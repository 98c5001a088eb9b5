"""Every format is read by somebody else's program, which finds each joint where the result has it."""

from dataclasses import replace

import pytest

from handtrack import HandtrackError
from handtrack.export.registry import export_format
from handtrack.export.table import ResultsTable
from tests.export.foreign import (
    MOST_MM,
    OF_KNOWN_SKELETONS,
    READERS,
    library,
)
from tests.export.sequences import KINDS, LOST_ROW, sample_sequence


@pytest.mark.parametrize("kind", KINDS[1:])
@pytest.mark.parametrize("name", list(READERS))
def test_foreign_readers_find_the_joints(name, kind, tmp_path):
    if name in OF_KNOWN_SKELETONS and kind == "claw":
        pytest.importorskip("pose_format" if name == "pose" else "numpy")
        table = ResultsTable(sample_sequence(kind)[1])
        with pytest.raises(HandtrackError, match="neither a whole hand nor a body"):
            export_format(name).write(tmp_path / "x.json", table)
        return
    assert READERS[name](kind, tmp_path) < MOST_MM


def test_a_pose_file_is_as_large_as_what_was_found(tmp_path):
    """Not as where a lost hand is held, metres away."""
    Pose = library("pose_format").Pose
    track = sample_sequence("left")[1]
    far = track.joint_positions.copy()
    far[LOST_ROW] += 10.0
    table = ResultsTable(replace(track, joint_positions=far))
    (path,) = export_format("pose").write(tmp_path / "x.pose", table)
    told = Pose.read(path.read_bytes()).header.dimensions
    assert 0 < max(told.width, told.height, told.depth) < 2000
