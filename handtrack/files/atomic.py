"""Write a file whole or not at all; keep for a while what is written over."""

from __future__ import annotations

import errno
import os
import re
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from handtrack.errors import HandtrackError

_PART = re.compile(r"\.(?P<name>.+)\.[a-z0-9_]{8}\.part(?P<suffix>\.\w+)?")
_ABANDONED_S = 600.0  # nobody writes a file for so long without touching it


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a file to write beside `path`; it takes path's place, on disk, when the block ends well.

    After an error or a crash `path` is what it was before. A link stays, and what it leads to is replaced; a device is
    written to.
    """
    path = Path(path).resolve()
    if path.exists() and not path.is_file():
        yield path
        return
    try:
        handle, name = tempfile.mkstemp(
            dir=path.parent, prefix=f".{path.name}.", suffix=f".part{path.suffix}"
        )
    except OSError as error:  # it names the other file
        error.filename = str(path)
        raise
    os.close(handle)
    part = Path(name)
    try:
        yield part
        with part.open("rb+") as file:
            os.fsync(file.fileno())
        part.chmod(0o666 & ~umask())
        part.replace(path)
    except OSError as error:
        if error.filename is None:  # of a full disk, Python does not say where
            error.filename = str(path)
        raise
    finally:
        part.unlink(missing_ok=True)
    sync_folder(path.parent)


def check_folder_of(path: Path | str) -> None:
    """Raise HandtrackError where the folder that a file is to be written to does not exist."""
    if not Path(path).parent.is_dir():
        raise HandtrackError(f"{path}: there is no folder {Path(path).parent}; make it first.")


def replace_text(path: Path, text: str) -> None:
    """Write a text file whole or not at all."""
    with replacing(path) as part:
        part.write_text(text, encoding="utf-8", newline="")


@contextmanager
def filling(folder: Path) -> Iterator[Path]:
    """Give a folder to fill beside `folder`, which is none or empty; it takes that place when the block ends well, and goes else.

    What programs left there that were killed while they filled one goes, too.
    """
    remove_abandoned(folder.parent)
    part = Path(tempfile.mkdtemp(dir=folder.parent, prefix=f".{folder.name}.", suffix=".part"))
    try:
        yield part
        part.chmod(0o777 & ~umask())
        if folder.is_dir():
            folder.rmdir()  # it is empty
        part.rename(folder)
    finally:
        shutil.rmtree(part, ignore_errors=True)


def remove_abandoned(folder: Path) -> list[Path]:
    """Remove what programs killed inside `replacing` or `filling` left in a folder and its versions/; return it.

    For who alone may write there. Ours by their names, and not touched for ten minutes.
    """
    gone = []
    for path in (*folder.glob(".*.part*"), *folder.glob("versions/.*.part*")):
        named = _PART.fullmatch(path.name)
        if named is None or path.is_symlink():
            continue
        with suppress(OSError):
            touched = max(one.lstat().st_mtime for one in (path, *path.rglob("*")))
            if time.time() - touched <= _ABANDONED_S:
                continue
            if path.is_file() and Path(named["name"]).suffix == (named["suffix"] or ""):
                path.unlink()
            elif path.is_dir() and not named["suffix"] and _is_private(path):
                shutil.rmtree(path)
            else:
                continue
            gone.append(path)
    return gone


def _is_private(folder: Path) -> bool:
    """Return whether a folder is as `filling` makes it: nobody else's, and closed to others."""
    found = folder.lstat()
    own = not hasattr(os, "getuid") or found.st_uid == os.getuid()
    return own and (os.name == "nt" or found.st_mode & 0o777 == 0o700)


def sync_folder(folder: Path) -> None:
    """Make the new name last; Windows cannot open folders and needs no such thing."""
    if os.name == "nt":
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def umask() -> int:
    """Return which rights a file made the ordinary way lacks; temporary ones are private."""
    mask = os.umask(0)
    os.umask(mask)
    return mask


# ---- Earlier versions of a file: what is written over is kept for a while


VERSIONS_FOLDER = "versions"
VERSIONS_KEPT = 20


def keep_version(path: Path) -> Path | None:
    """Copy `path` to versions/<name>_YYYYmmdd_HHMMSS.<suffix> beside it, by the time it was written, UTC.

    Returns the copy, None when there is no such file. Only the latest VERSIONS_KEPT stay.
    """
    if not path.is_file():
        return None
    folder = path.parent / VERSIONS_FOLDER
    folder.mkdir(exist_ok=True)
    written = time.strftime("%Y%m%d_%H%M%S", time.gmtime(path.stat().st_mtime))
    copy = folder / f"{path.stem}_{written}{path.suffix}"
    number = 1
    while copy.exists():
        if copy.read_bytes() == path.read_bytes():
            return copy
        number += 1
        copy = folder / f"{path.stem}_{written}_{number:02d}{path.suffix}"
    with replacing(copy) as part:
        shutil.copyfile(path, part)
    for old in versions(path)[:-VERSIONS_KEPT]:
        old.unlink(missing_ok=True)  # another process may have done it
    return copy


def versions(path: Path) -> list[Path]:
    """Return the kept versions of a result, the oldest first."""
    folder = path.parent / VERSIONS_FOLDER
    if not folder.is_dir():
        return []
    form = re.compile(re.escape(path.stem) + r"_\d{8}_\d{6}(_\d+)?" + re.escape(path.suffix))
    found = [file for file in folder.iterdir() if form.fullmatch(file.name)]
    return sorted(found, key=lambda file: file.stem)


def write_over(path: Path, content: bytes | None, ours: bytes | None) -> bool:
    """Write or (None) remove a file. One that is not as `ours`, what was written here last, is kept in versions/.

    Return whether anything had to be done. Raises HandtrackError.
    """
    try:
        stands = path.read_bytes() if path.is_file() else None
        if stands == content:
            return False
        if stands is not None and stands != ours:
            keep_version(path)
        if content is None:
            path.unlink(missing_ok=True)
            return True
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as part:
            part.write_bytes(content)
        return True
    except OSError as error:
        raise HandtrackError(
            f"{path}: cannot be written ({error.strerror}). Is the folder read-only?"
        ) from None


# ---- Films that OpenCV writes


def check_film(path: Path, frames: int) -> None:
    """Raise OSError where a film that was written has fewer frames: of a full disk, OpenCV says nothing."""
    import cv2  # slow to import

    film = cv2.VideoCapture(str(path))
    held = int(film.get(cv2.CAP_PROP_FRAME_COUNT))
    film.release()
    if held < frames:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
