"""Where a command's file goes: looked at before anything is computed, so that no work is lost for a wrong name."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from handtrack.errors import HandtrackError


def output_file(
    out: Path, suffixes: tuple[str, ...], what: str, makes_folders: bool = False
) -> Path:
    """Return the file, which can be written. Raises HandtrackError; writes nothing.

    what: a few words for the error, such as `results are`. A device, such as /dev/stdout, may have any name.
    """
    if out.exists() and not out.is_file() and not out.is_dir():
        return out
    if out.suffix.lower() not in suffixes:
        raise HandtrackError(
            f"--out {out}: {what} {' or '.join(suffixes)} files; expected such a name."
        )
    if out.is_dir():
        raise HandtrackError(f"--out {out}: that is a folder; expected the name of a file.")
    if not (makes_folders or out.parent.exists()):
        raise HandtrackError(f"--out {out}: cannot be written: there is no folder {out.parent}.")
    standing = next(path for path in (out.parent, *out.parent.resolve().parents) if path.exists())
    try:
        handle, name = tempfile.mkstemp(dir=standing, prefix=".handtrack_", suffix=".part")
        os.close(handle)
        os.unlink(name)
    except OSError as error:
        raise HandtrackError(
            f"{out}: cannot be written: {standing}: {error.strerror}. Nothing was done; name another place with --out."
        ) from None
    return out
