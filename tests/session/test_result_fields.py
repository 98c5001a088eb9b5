"""A field that is added to a frame's result, in the one place where it is declared, goes through everything."""

from __future__ import annotations

import os
import subprocess
import sys
import types
from dataclasses import replace
from pathlib import Path

import pytest

from tests.conftest import REPOSITORY

ADDED = """
    force: Floats[D3] | None = field(default=None, metadata=column(finite=True, gaps="missing", turned=vector))
    tremor: float = field(default=float("nan"), metadata=column(gaps="missing", unit="mm"))
"""


def test_an_added_field_goes_through_everything(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "tests.session.test_result_fields", str(tmp_path)],
        cwd=REPOSITORY, env=os.environ | {"PYTHONPATH": str(REPOSITORY)}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


def add_fields() -> None:
    """Load the module of results with ADDED at the end of FrameResult."""
    name = "handtrack.tracking.frame.result"
    path = REPOSITORY / f"{name.replace('.', '/')}.py"
    before, after = path.read_text(encoding="utf-8").split("\n\n\nFIELDS = ")
    module = sys.modules[name] = types.ModuleType(name)
    exec(compile(f"{before}{ADDED}\n\nFIELDS = {after}", path, "exec"), module.__dict__)


def check(folder: Path) -> None:
    """Send frames with the added fields through stacking, slicing, files, the store, gaps, turns and tables."""
    add_fields()
    import numpy as np

    from handtrack.errors import HandtrackError
    from handtrack.export.table import ResultsTable
    from handtrack.export.upright import turn_between, upright
    from handtrack.session.formats.tables import read_npz, write_npz
    from handtrack.store.store import Store, WritableStore
    from handtrack.tracking.frame.tables.labelled import labelled
    from tests.sample_track import sample_frame, stacked
    from tests.store.made import about

    rng = np.random.default_rng(1)
    forces = [rng.normal(size=3) for _ in range(3)]
    frames = [
        replace(sample_frame(rng, frame), force=force, tremor=0.5 * frame)
        for frame, force in zip((3, 4, 6), forces, strict=True)
    ]
    track = stacked(frames)
    np.testing.assert_array_equal(track.force, forces)
    np.testing.assert_array_equal(track.between(range(4, 7)).tremor, [2.0, 3.0])
    assert stacked([sample_frame(rng, 1)]).force is None

    write_npz(folder / "poses.npz", track)
    for frame, back in zip(frames, read_npz(folder / "poses.npz").frames(), strict=True):
        np.testing.assert_array_equal(back.force, frame.force)
        assert back.tremor == frame.tremor
    for wrong, said in ((track.force[:, :2], "shape"), (track.force * np.nan, "finite")):
        write_npz(folder / "wrong.npz", replace(track, force=wrong))
        with pytest.raises(HandtrackError, match=said):
            read_npz(folder / "wrong.npz")

    with WritableStore(folder / "store", "a test") as store:
        writer = store.begin(about(range(3, 7)))
        for frame in frames:
            writer.replace(frame)
    again = Store(folder / "store").take(1).track()
    np.testing.assert_array_equal(again.force, forces)
    np.testing.assert_array_equal(again.tremor, track.tremor)

    whole = ResultsTable(track).without_gaps.track
    assert np.isnan(whole.force).any(axis=1).tolist() == [False, False, True, False]
    assert np.isnan(whole.tremor).tolist() == [False, False, True, False]
    turn = turn_between("z", "y")
    np.testing.assert_array_equal(upright(track, "z", "y").force, track.force @ turn.T)
    assert labelled(track).arrays["tremor"].unit == "mm"


if __name__ == "__main__":
    check(Path(sys.argv[1]))
