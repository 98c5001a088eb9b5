"""Golden files, small, of the formats that are text: python -m tests.golden.files writes them anew.

What others' scripts read stays as it is; a change of one of these files is a change of a promise, told in the changelog.
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

from handtrack.export.registry import export_format
from handtrack.export.table import ResultsTable
from handtrack.session.formats.tables import write_npz
from tests.sample_track import hand_track

FOLDER = Path(__file__).parent / "files"
POSES = "poses.npz"
TEXTS = ("csv", "csv-long", "trc", "mot", "bvh", "urdf", "osim", "openpose", "mediapipe", "anipose")
FRAMES = 2


def written(poses: Path, folder: Path) -> list[Path]:
    """Export a result in every format of text; return the files."""
    table = ResultsTable.read(poses, None)
    files: list[Path] = []
    for name in TEXTS:
        known = export_format(name)
        files += known.write(folder / f"{name}{known.suffix}", table)
    return files


def main() -> None:
    """Write all of them."""
    shutil.rmtree(FOLDER, ignore_errors=True)
    FOLDER.mkdir()
    write_npz(FOLDER / POSES, hand_track(FRAMES))
    with tempfile.TemporaryDirectory() as place:
        for file in written(FOLDER / POSES, Path(place)):
            shutil.copyfile(file, FOLDER / file.name)


if __name__ == "__main__":
    main()
