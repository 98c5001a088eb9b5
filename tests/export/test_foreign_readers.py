"""Every format is read by somebody else's program, which finds each joint where the result has it."""

import pytest

from handtrack import HandtrackError
from handtrack.export.registry import export_format
from handtrack.export.table import ResultsTable
from tests.export.foreign import (
    BOUNDS_MM,
    OF_KNOWN_SKELETONS,
    READERS,
)
from tests.export.sequences import KINDS, sample_sequence


@pytest.mark.parametrize("kind", KINDS[1:])
@pytest.mark.parametrize("name", list(READERS))
def test_foreign_readers_find_the_joints(name, kind, tmp_path):
    if name in OF_KNOWN_SKELETONS and kind == "claw":
        pytest.importorskip("pose_format" if name == "pose" else "numpy")
        table = ResultsTable(sample_sequence(kind)[1])
        with pytest.raises(HandtrackError, match="neither a whole hand nor a body"):
            export_format(name).write(tmp_path / "x.json", table)
        return
    assert READERS[name](kind, tmp_path) < BOUNDS_MM[name]
