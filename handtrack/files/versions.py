"""Earlier versions of a result: what is written over is kept for a while."""

from __future__ import annotations

import re
import shutil
import time
from pathlib import Path

from handtrack.errors import HandtrackError
from handtrack.files.atomic import replacing

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
