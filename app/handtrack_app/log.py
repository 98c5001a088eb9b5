"""The log of a running workbench: a file of its user, of bounded size, in place of the terminal."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from io import TextIOWrapper
from logging.handlers import RotatingFileHandler
from pathlib import Path

from handtrack.files.user_folder import user_data_folder

_BYTES, _OLDER = 1_000_000, 3
"""of each file, and how many older ones are kept"""
_A_MINUTE = 60
"""records of one logger; more in a minute are the same again"""


class _OwnFile(RotatingFileHandler):
    """A file that its user alone may read. What cannot be written is lost: the terminal is not for it."""

    def _open(self) -> TextIOWrapper:
        Path(self.baseFilename).parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        descriptor = os.open(self.baseFilename, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
        if hasattr(os, "fchmod"):
            os.fchmod(descriptor, 0o600)  # one that was there before
        return TextIOWrapper(open(descriptor, "ab"), encoding=self.encoding)

    def handleError(self, record: logging.LogRecord) -> None:
        """Say nothing."""


class _Sparing(logging.Filter):
    """Lets a number of records of each logger pass in a minute."""

    def __init__(self) -> None:
        super().__init__()
        self._minute, self._counts = 0, {}

    def filter(self, record: logging.LogRecord) -> bool:
        minute = int(time.monotonic() // 60)
        if minute != self._minute:
            self._minute, self._counts = minute, {}
        observed = self._counts[record.name] = self._counts.get(record.name, 0) + 1
        if observed == _A_MINUTE:
            record.msg, record.args = (
                f"{record.getMessage()} (more are not written in this minute)",
                (),
            )
        return observed <= _A_MINUTE


@contextmanager
def logging_to(path: Path) -> Iterator[None]:
    """While it lasts, all that is logged or warned of goes to a file: ours, viser's, and of odd requests from the network."""
    records = _OwnFile(path, maxBytes=_BYTES, backupCount=_OLDER, encoding="utf-8", delay=True)
    records.setFormatter(logging.Formatter("%(asctime)s %(name)s %(levelname)s %(message)s"))
    records.addFilter(_Sparing())
    root = logging.getLogger()
    root.addHandler(records)
    logging.captureWarnings(True)
    try:
        yield
    finally:
        logging.captureWarnings(False)
        root.removeHandler(records)
        records.close()


# ---- Where details of mistakes are kept: files of the user's own; light to import


LOG_FILE = user_data_folder() / "logs" / "workbench.log"
"""what the page's process notes"""
ENGINE_LOG = LOG_FILE.with_name("engine.log")
"""what the engine's process, and libraries in it, print"""
