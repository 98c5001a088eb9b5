"""Files and folders that a command writes: checked before anything is computed, made whole or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from handtrack.errors import HandtrackError
from handtrack.files.atomic import filling


def output_file(
    out: Path,
    suffixes: tuple[str, ...],
    what: str,
    makes_folders: bool = False,
    option: str = "--out",
) -> Path:
    """Return the file, which can be written. Raises HandtrackError; writes nothing.

    what: a few words for the error, such as `results are`. A device, such as /dev/stdout, may have any name.
    """
    if out.exists() and not out.is_file() and not out.is_dir():
        return out
    if out.suffix.lower() not in suffixes:
        raise HandtrackError(
            f"{option} {out}: {what} {' or '.join(suffixes)} files; expected such a name."
        )
    if out.is_dir():
        raise HandtrackError(f"{option} {out}: that is a folder; expected the name of a file.")
    if not (makes_folders or out.parent.exists()):
        raise HandtrackError(f"{option} {out}: cannot be written: there is no folder {out.parent}.")
    standing = next(path for path in (out.parent, *out.parent.resolve().parents) if path.exists())
    try:
        handle, name = tempfile.mkstemp(dir=standing, prefix=".handtrack_", suffix=".part")
        os.close(handle)
        os.unlink(name)
    except OSError as error:
        raise HandtrackError(
            f"{out}: cannot be written: {standing}: {error.strerror}. Nothing was done; name another place with {option}."
        ) from None
    return out


def check_new(folder: Path, option: str = "--out") -> None:
    """Raise HandtrackError unless a folder can be made at `folder`: nothing there, or an empty folder."""
    if folder.exists() and not folder.is_dir():
        raise HandtrackError(
            f"{option} {folder} is a file; nothing was written. Name a new folder with {option}."
        )
    if folder.is_dir() and any(folder.iterdir()):
        raise HandtrackError(
            f"{option} {folder} is not empty; nothing was written. Name a new folder with {option}."
        )


@contextmanager
def new_folder(folder: Path) -> Iterator[Path]:
    """Give a folder to fill; it becomes `folder` when the block ends well, and goes otherwise.

    Raises HandtrackError when something is there already, or nothing can be written there.
    """
    check_new(folder)
    target = folder.resolve()
    made = [path for path in target.parents if not path.exists()]  # the innermost first
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with filling(target) as part:
            yield part
        made = []
    except OSError as error:
        raise HandtrackError(
            f"--out {folder}: writing there failed ({error.strerror or error}); nothing was kept. "
            "Name another folder with --out."
        ) from None
    finally:
        for parent in made:
            with suppress(OSError):
                parent.rmdir()
