"""Files that people name on the command line: looked at before they are opened, so that none waits for ever or fills the memory."""

from __future__ import annotations

from pathlib import Path

from handtrack.errors import HandtrackError

MOST_BYTES = 64 << 20  # of a description in words or numbers; a calibration has some kB


def check_given(path: Path, what: str, most_bytes: int = MOST_BYTES) -> None:
    """Raise HandtrackError unless a path is a plain file of at most so many bytes.

    what: a few words for the error, such as `a calibration`.
    """
    if path.is_dir():
        raise HandtrackError(f"{path} is a folder; expected {what}.")
    if not path.exists():
        raise HandtrackError(f"{path}: no such file; expected {what} there.")
    if not path.is_file():
        raise HandtrackError(f"{path} is a pipe or a device, not a file, so it was not opened.")
    size = path.stat().st_size
    if size > most_bytes:
        raise HandtrackError(
            f"{path} has {size / 1e6:.0f} MB; {what} of more than {most_bytes / 1e6:.0f} MB is not read. Is it another file?"
        )


def first_bytes(path: Path) -> bytes:
    """Return how a file begins. Raises HandtrackError where it cannot be read."""
    try:
        with path.open("rb") as file:
            return file.read(4096)
    except OSError as error:
        raise HandtrackError(f"{path}: cannot be read ({error.strerror}).") from None
