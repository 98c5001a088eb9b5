"""The recordings that come with the program."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from handtrack.errors import HandtrackError, unknown_name
from handtrack.files.atomic import replacing
from handtrack.files.user_folder import user_data_folder
from handtrack.session.layout import (
    CALIBRATION_FILE,
    INIT_FILE,
    POSES_FILE,
    SESSION_FILE,
    TRACKS_FOLDER,
    TRUTH_FILE,
)

_PACKAGE = Path(__file__).resolve().parents[1]
_INSTALLED = _PACKAGE / "bundled_sessions"
_CHECKOUT = _PACKAGE.parent / "sessions"
_DEMO = "another_hand"
_TRACKED = "tracked.npz"
"""of the demo: what `handtrack track` made of it"""


def bundled_names() -> tuple[str, ...]:
    """Return the names of the bundled sessions."""
    return tuple(sorted(file.parent.name for file in _bundled_folder().glob(f"*/{SESSION_FILE}")))


def bundled_session(name: str = _DEMO) -> Path:
    """Return the folder of a bundled session; HandtrackError naming the known ones.

    In a checkout this is sessions/<name> itself. An installed program keeps its own copy untouched and
    gives out a working copy in the user's data folder, so that poses and tracks made there outlive an
    update.
    """
    if name not in bundled_names():
        raise unknown_name("bundled session", name, bundled_names())
    source = _bundled_folder() / name
    if _bundled_folder() == _CHECKOUT:
        return source
    return working_copy(source, name)


def working_folder(folder: Path) -> Path:
    """Return the folder to work in: a copy in the user's data folder for a recording that lies in a checkout.

    The copy's name carries a stamp of the recording, so that a changed recording gets a new one. An installed
    program's bundled session is such a copy already; any other folder is returned as it is.
    """
    source = Path(folder).resolve()
    if source.parent != _CHECKOUT:
        return Path(folder)
    stamp = hashlib.sha256()
    for name in (SESSION_FILE, INIT_FILE, TRUTH_FILE):
        if (source / name).is_file():
            stamp.update((source / name).read_bytes())
    return working_copy(source, f"{source.name}-{stamp.hexdigest()[:8]}")


def demo_session() -> Path:
    """Return the user's copy of the bundled session, tracked: where nobody has tracked it, by the track that comes with it.

    Else a first run would show nothing tracked until all loops are compiled. Raises HandtrackError where it cannot be written.
    """
    folder = working_folder(bundled_session())
    track = folder / POSES_FILE
    if not track.parent.exists():
        with _copying_to(folder):
            track.parent.mkdir()
            _copy(folder / _TRACKED, track)
    return folder


def working_copy(source: Path, name: str) -> Path:
    """Return the folder of that name in the user's data folder, completed from `source`; HandtrackError where it cannot be written."""
    target = user_data_folder() / "sessions" / name
    with _copying_to(target):
        _copy_missing(source, target)
    return target


@contextmanager
def _copying_to(target: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise HandtrackError(
            f"the bundled session cannot be copied to {target}: {error.strerror}. Free some space, or "
            "name another folder in the environment variable HANDTRACK_HOME."
        ) from None


def _bundled_folder() -> Path:
    return _INSTALLED if _INSTALLED.is_dir() else _CHECKOUT


def _copy_missing(source: Path, target: Path) -> list[Path]:
    """Copy what the working copy lacks, session.toml last: a copy cut short is completed next time. Return the copies' paths."""
    made = source / TRACKS_FOLDER  # what somebody made of it does not belong to the recording
    files = [f for f in sorted(source.rglob("*")) if f.is_file() and made not in f.parents]
    files.sort(key=lambda file: file.name == SESSION_FILE)
    copies = [target / file.relative_to(source) for file in files]
    for file, copy in zip(files, copies, strict=True):
        if not copy.exists():
            copy.parent.mkdir(parents=True, exist_ok=True)
            _copy(file, copy)
    return copies


def _copy(file: Path, to: Path) -> None:
    with replacing(to) as part:
        shutil.copyfile(file, part)


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
    return _copy_missing(bundled_session(name), folder)
