"""Golden files of the formats that are text or NumPy's, of a recording and a batch: python -m tests.golden.files writes them anew.

What others' scripts read stays as it is, and what was written once opens for ever; a change of one of these files is a change
of a promise, told in the changelog. Exports that are no text are read by others' programs (tests/export/foreign.py).
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

from handtrack.export.registry import export_format
from handtrack.export.table import ResultsTable
from handtrack.session.tables import write_npz
from tests.golden import recording
from tests.sample_track import hand_track

HERE = Path(__file__).parent
FOLDER, RECORDING = HERE / "files", HERE / "recorded"
POSES, POSES_2 = "poses.npz", "poses_2.npz"
TEXTS = (
    "csv csv-long trc mot bvh bvh-humanik urdf osim openpose mediapipe anipose npz keypoints report"
)
FRAMES = 2
AGAIN = (
    "Others read these files, and results are a promise. If one is to change, record it anew with `python -m tests.golden.files` or "
    "`tests.golden.results`, look at the difference, and tell it in docs/changelog.md"
)


def written(poses: Path, folder: Path) -> list[Path]:
    """Export a result in every format of text; return the files."""
    table = ResultsTable.read(poses, None)
    files: list[Path] = []
    for name in TEXTS.split():
        known = export_format(name)
        files += known.write(folder / f"{name}{known.suffix}", table)
    return files


def main() -> None:
    """Write all of them."""
    for folder in (FOLDER, RECORDING):
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
    write_npz(FOLDER / POSES, hand_track(FRAMES))
    recording.written(RECORDING)
    with tempfile.TemporaryDirectory() as place:
        for file in written(FOLDER / POSES, Path(place)):
            shutil.copyfile(file, FOLDER / file.name)


if __name__ == "__main__":
    main()
