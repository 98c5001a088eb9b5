"""Golden files of every format that is written: python -m tests.golden.files writes them anew.

What others' scripts read stays as it is, and what was written once opens for ever; a change of one of these files is a change
of a promise, told in the changelog. Exports that are text, and all files of a recording and a batch, are kept as they are;
exports that are no text by what they say (`meaning`).
"""

from __future__ import annotations

import json
import shutil
import tempfile
from pathlib import Path

from handtrack.export.registry import FORMATS, export_format
from handtrack.export.table import ResultsTable
from handtrack.session.formats.tables import write_npz
from handtrack.simulation.simulate import Simulation, simulate
from tests.golden import recording
from tests.golden.meaning import meaning
from tests.sample_track import hand_track

HERE = Path(__file__).parent
FOLDER, RECORDING, MEANINGS = HERE / "files", HERE / "recorded", HERE / "meanings.json"
POSES, POSES_2 = "poses.npz", "poses_2.npz"
TEXTS = (
    "csv",
    "csv-long",
    "trc",
    "mot",
    "bvh",
    "bvh-humanik",
    "urdf",
    "osim",
    "openpose",
    "mediapipe",
    "anipose",
)
OTHERS = tuple(
    known.name for known in FORMATS if known.name not in (*TEXTS, "mano")
)  # which needs a model of the user's
FRAMES = 2
AGAIN = (
    "A promise: others read these files. If it is to change, record them anew with `python -m tests.golden.files`, look at the "
    "difference, and tell it in docs/changelog.md"
)


def written(poses: Path, folder: Path) -> list[Path]:
    """Export a result in every format of text; return the files."""
    table = ResultsTable.read(poses, None)
    files: list[Path] = []
    for name in TEXTS:
        known = export_format(name)
        files += known.write(folder / f"{name}{known.suffix}", table)
    return files


def exported(name: str, folder: Path) -> object:
    """Return what an export says that is no text, of the recorded result of format 2."""
    table = ResultsTable.read(RECORDING / POSES_2, filmed(folder) if name == "mp4" else None)
    known = export_format(name)
    (path,) = known.write(folder / f"poses{known.ending}", table)
    return meaning(path)


def filmed(folder: Path) -> Path:
    """Write a session with masks of the frames that the recorded result has."""
    what = Simulation(cameras=2, frames=6, motion="still", size=(64, 48), images=False)
    return simulate(folder / "filmed", what)


def main() -> None:
    """Write all of them."""
    for folder in (FOLDER, RECORDING):
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
    write_npz(FOLDER / POSES, hand_track(FRAMES))
    recording.written(RECORDING)
    told: dict[str, object] = {}
    for name in ("texts", *OTHERS):
        with tempfile.TemporaryDirectory() as place:
            if name == "texts":
                for file in written(FOLDER / POSES, Path(place)):
                    shutil.copyfile(file, FOLDER / file.name)
            else:
                told[name] = exported(name, Path(place))
    rows = (f"{json.dumps(name)}: {json.dumps(told[name], sort_keys=True)}" for name in OTHERS)
    MEANINGS.write_text("{\n" + ",\n".join(rows) + "\n}\n", encoding="utf-8")


if __name__ == "__main__":
    main()
