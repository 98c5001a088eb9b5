"""Recordings to try things on, as files of one's own: bundled sessions, and the raw material of the tutorial."""

from __future__ import annotations

import shutil
from pathlib import Path

from handtrack.errors import unknown_name
from handtrack.session.bundled import bundled_names, bundled_session
from handtrack.session.layout import CALIBRATION_FILE, INIT_FILE, TRACKS_FOLDER, TRUTH_FILE

TWO_VIDEOS = "two_videos"
_RAW = {
    "cam0.mp4": "left.mp4",
    "cam1.mp4": "right.mp4",
    CALIBRATION_FILE: CALIBRATION_FILE,
    INIT_FILE: INIT_FILE,
    TRUTH_FILE: TRUTH_FILE,
}
"""of the bundled session, and what it is called as raw material"""


def sample_names() -> tuple[str, ...]:
    """Return the names of all samples."""
    return (*bundled_names(), TWO_VIDEOS)


def write_sample(name: str, folder: Path) -> list[Path]:
    """Fill a folder that exists with a sample's files; return them. Raises HandtrackError for a name that is none."""
    if name not in sample_names():
        raise unknown_name("sample", name, sample_names())
    if name == TWO_VIDEOS:
        source = bundled_session()
        return [Path(shutil.copyfile(source / file, folder / to)) for file, to in _RAW.items()]
    source = bundled_session(name)
    files = [path for path in sorted(source.rglob("*")) if path.is_file()]
    files = [path for path in files if source / TRACKS_FOLDER not in path.parents]
    for path in files:
        target = folder / path.relative_to(source)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, target)
    return [folder / path.relative_to(source) for path in files]
