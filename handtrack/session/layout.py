"""The file names inside a session folder, and the rule that nothing named there lies outside it."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from contextlib import suppress
from difflib import get_close_matches
from fnmatch import fnmatch
from pathlib import Path, PurePosixPath, PureWindowsPath

from handtrack.errors import HandtrackError
from handtrack.files.atomic import replace_text
from handtrack.files.user_folder import user_data_folder

SESSION_FILE = "session.toml"
CALIBRATION_FILE = "calibration.toml"
TRUTH_FILE = "truth.npz"
INIT_FILE = "init.json"
TRACKS_FOLDER = "tracks"
POSES_FILE = "tracks/poses.npz"
VIDEOS_FILE = "tracks/videos.json"
HAND_FILE = "hand.json"
PINS_FILE = "pins.json"
"""where a person pointed at joints and segments in images"""
KEYPOINTS_FOLDER = "keypoints"
"""what the hand detector writes: a folder for each camera"""
MASKS_FOLDER = "masks_refined"
"""masks made again by tracked poses: a folder for each camera"""
CORRECTED_FOLDER = "masks_corrected"
"""what was painted over masks by hand: a folder for each camera"""
_WRITTEN = (
    SESSION_FILE,
    INIT_FILE,
    HAND_FILE,
    TRACKS_FOLDER,
    POSES_FILE,
    VIDEOS_FILE,
    "versions",
    "tracks/takes",
    "tracks/actions",
    "tracks/versions",
    KEYPOINTS_FOLDER,
    MASKS_FOLDER,
    CORRECTED_FOLDER,
    PINS_FILE,
)

_WILD = "*?["
_LONGEST = 1000  # characters of a path
_SHOWN = 3  # names of those that are there, and of how many
_COMPARED = 200


def is_pattern(setting: str) -> bool:
    """Return whether a path setting names several files, like `masks/cam0/*.png`."""
    return any(sign in setting for sign in _WILD)


def inside(folder: Path, setting: str, where: str) -> Path:
    """Return folder / setting.

    An absolute path is one below a folder that the user has linked (`handtrack new --link`), and is
    held to that folder.

    Parameters
    ----------
    where
        The setting's file, table and key, for the error.

    Raises
    ------
    HandtrackError
        When that lies outside the folder, links followed, or is a pipe or a device: opening one may
        wait for ever, and reading it never end.
    """
    folder, setting = _rooted(folder, setting)
    path = folder / setting
    if "\0" in setting or len(setting) > _LONGEST:
        raise HandtrackError(f"{where}: {setting[:40]!r} is no path.")
    if _is_absolute(setting) or not _is_within(path, folder):
        raise _leaves(folder, setting, where, path)
    # not "exists, and is no file": it may be removed in between
    if path.is_fifo() or path.is_socket() or path.is_char_device() or path.is_block_device():
        raise HandtrackError(
            f"{path} is a pipe or a device, not a file, so it was not opened. Put a file there, or take it away."
        )
    return path


def check_written(folder: Path) -> None:
    """Raise HandtrackError where what handtrack writes in a session would be written elsewhere, or into a pipe or device."""
    for name in _WRITTEN:
        inside(folder, name, str(folder))


def matching_files(folder: Path, pattern: str, where: str) -> list[Path]:
    """Return the files of a pattern, as `existing_files`. Raises HandtrackError also when there is none."""
    files = existing_files(folder, pattern, where)
    if not files:
        raise HandtrackError(f"{where}: {absence(folder, pattern)}.")
    return files


def existing_files(folder: Path, pattern: str, where: str) -> list[Path]:
    """Return the files of a pattern, sorted, none where nothing matches; hidden files never match.

    Raises HandtrackError when the pattern or a file leaves the folder.
    """
    folder, pattern = _rooted(folder, pattern)
    if not is_pattern(pattern):
        path = inside(folder, pattern, where)
        if path.is_dir():
            raise HandtrackError(
                f'{where}: "{pattern}" is a folder; expected a pattern of files, such as '
                f'"{pattern.rstrip("/")}/*.png".'
            )
        return [path] if path.is_file() else []
    fixed = folder / _fixed_part(pattern)
    climbs = ".." in PurePosixPath(pattern).parts
    if _is_absolute(pattern) or climbs or not _is_within(fixed, folder):
        raise _leaves(folder, pattern, where, fixed)
    files = []
    try:
        for parent in _matching_folders(folder, PurePosixPath(pattern)):
            found, links = _entries(parent, PurePosixPath(pattern).name)
            # a file that is no link lies where its folder does
            for path in [*([parent / found[0]] if found else []), *(parent / n for n in links)]:
                if not _is_within(path, folder):
                    raise _leaves(folder, str(path.relative_to(folder)), where, path)
            files += [parent / name for name in sorted([*found, *links])]
    except ValueError as error:
        raise HandtrackError(f'{where}: "{pattern}" is no pattern of files: {error}.') from None
    if not files and "\\" in pattern:
        raise HandtrackError(f'{where}: nothing matches "{pattern}"; write / between folders.')
    return files


def _matching_folders(folder: Path, pattern: PurePosixPath) -> list[Path]:
    """Return the folders in which the files of a pattern may lie."""
    if "**" in pattern.name:
        raise ValueError("'**' stands for folders, and alone")
    above = str(pattern.parent)
    if not is_pattern(above):
        return [folder / above]
    return sorted({path for path in folder.glob(above) if path.is_dir()})


def _entries(folder: Path, pattern: str) -> tuple[list[str], list[str]]:
    """Return the names of the files of a folder that match, and of links to files. Each is looked at once: there may be
    many.
    """
    files, links = list[str](), list[str]()
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if fnmatch(entry.name, pattern) and not entry.name.startswith(".") and entry.is_file():
                (links if entry.is_symlink() else files).append(entry.name)
    return files, links


def absence(folder: Path, pattern: str) -> str:
    """Return that nothing matches a pattern, and the names most like it where it should be, in words."""
    folder, pattern = _rooted(folder, pattern)
    wanted, place = folder / pattern, folder / _fixed_part(pattern)
    if not is_pattern(pattern):
        place = place.parent
    missing = ""
    while not place.is_dir():
        missing = f"there is no folder {place}; "
        wanted, place = place, place.parent
    names = [path.name for path in place.iterdir() if not path.name.startswith(".")]
    near = get_close_matches(wanted.name, sorted(names)[:_COMPARED], _SHOWN, 0.0)
    shown = ", ".join(near) + (", …" if len(names) > len(near) else "")
    return f'nothing matches "{pattern}" in {folder}; {missing}in {place} there is {shown or "nothing"}'


def place_of(path: Path, folder: Path) -> str:
    """Return a file's path below a session's folder; of a linked file the whole one."""
    return (path.relative_to(folder) if path.is_relative_to(folder) else path).as_posix()


def _rooted(folder: Path, setting: str) -> tuple[Path, str]:
    """Return the folder that a setting must not leave, and the setting below it."""
    if _is_absolute(setting) and "\0" not in setting:
        for linked in _links().get(str(folder.resolve()), []):
            if setting.startswith(f"{linked}/"):
                return Path(linked), setting.removeprefix(f"{linked}/")
    return folder, setting


def _is_absolute(setting: str) -> bool:
    return PurePosixPath(setting).is_absolute() or bool(PureWindowsPath(setting).anchor)


def _is_within(path: Path, folder: Path) -> bool:
    return path.resolve().is_relative_to(folder.resolve())


def _fixed_part(pattern: str) -> PurePosixPath:
    parts = PurePosixPath(pattern).parts
    fixed = [part for i, part in enumerate(parts) if not any(is_pattern(p) for p in parts[: i + 1])]
    return PurePosixPath(*fixed)


def _leaves(folder: Path, setting: str, where: str, path: Path) -> HandtrackError:
    return HandtrackError(
        f'{where}: the path "{setting}" leaves the session folder {folder} (it leads to '
        f"{path.resolve()}). Paths are relative to that folder and must stay in it: copy the files there. Files elsewhere are "
        "read where you linked them yourself, on this computer: `handtrack new --link`."
    )


# ---- Files that a session names outside of its folder: only where this user linked them there, on this computer


_FILE = "links.json"


def allow_links(session: Path, folders: Iterable[Path]) -> None:
    """Let a session read files of these folders, from now on and for this user.

    Raises HandtrackError where that cannot be kept.
    """
    links = {name: known for name, known in _links().items() if Path(name).is_dir()}
    links[str(session.resolve())] = sorted({str(folder.resolve()) for folder in folders})
    path = user_data_folder() / _FILE
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        replace_text(path, json.dumps(links, indent=1) + "\n")
    except OSError as error:
        raise HandtrackError(
            f"{path}: cannot be written ({error.strerror}), so no links can be allowed. Copy the files: leave --link away."
        ) from None


def _links() -> dict[str, list[str]]:
    """Return the list; one that is damaged allows nothing."""
    try:
        read = json.loads((user_data_folder() / _FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return {
        name: [folder for folder in folders if isinstance(folder, str)]
        for name, folders in (read.items() if isinstance(read, dict) else ())
        if isinstance(folders, list)
    }
