"""How one recording ended, and the ledger of all: one line of JSON each, appended whole."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path

from handtrack.files.atomic import sync_folder

DONE, REFUSED, FAILED, INTERRUPTED, STARTED = "done", "refused", "failed", "interrupted", "started"
"""states: tracked to the end; bad input, which the same input would be again; ended otherwise; stopped; begun"""


@dataclass(frozen=True)
class Outcome:
    """What became of a recording."""

    recording: str
    folder: str
    digest: str
    state: str
    exit_code: int | None = None
    seconds: float = 0.0
    frames: Mapping[str, int] = field(default_factory=dict)
    """by status"""
    p_off: float | None = None
    """mean over frames of the probability that some joint is more than 25 mm off; None where nothing is said"""
    warnings: list[str] = field(default_factory=list)
    cause: str = ""
    """why it was refused or failed"""
    output: str = ""
    ended: str = ""
    """when, ISO 8601, UTC"""

    @property
    def is_settled(self) -> bool:
        """Whether the same inputs would end the same way, so that nothing is to be done again."""
        return (self.state == DONE and Path(self.output).is_file()) or self.state == REFUSED

    @property
    def total(self) -> int:
        """How many frames were tracked, whatever came of them."""
        return sum(self.frames.values())

    def share(self, *statuses: str) -> float:
        """Return the share of frames of some statuses; 0 where there are none."""
        return sum(self.frames.get(status, 0) for status in statuses) / max(self.total, 1)

    @property
    def badness(self) -> tuple[float, ...]:
        """What reports are sorted by, worst first: what has no result; then lost frames, doubtful ones, doubt."""
        rank = {FAILED: 4, STARTED: 3, INTERRUPTED: 3, REFUSED: 2}.get(self.state, 0)
        return (rank, self.share("lost"), self.share("doubtful"), self.p_off or 0.0)

    def table(self) -> dict[str, object]:
        """Return it as JSON has it."""
        return asdict(self)


def read_ledger(file: Path) -> list[Outcome]:
    """Return what a ledger says, in its order; a line that was torn by a crash, or is nobody's, is left out."""
    known = {entry.name for entry in fields(Outcome)}
    found = []
    for line in file.read_bytes().splitlines() if file.is_file() else ():
        try:
            table = json.loads(line)
            found.append(Outcome(**{key: value for key, value in table.items() if key in known}))
        except (ValueError, TypeError, AttributeError):
            continue
    return found


def latest(outcomes: list[Outcome]) -> dict[str, Outcome]:
    """Return the last outcome of each recording folder; a start counts where nothing came after it."""
    return {outcome.folder: outcome for outcome in outcomes}


def append(file: Path, outcome: Outcome) -> None:
    """Append a line, whole and on disk when this returns. Several programs may append to one file.

    A line that was torn before, by a full disk or a lost machine, is closed first.
    """
    line = json.dumps(outcome.table(), ensure_ascii=False, sort_keys=True).encode() + b"\n"
    new = not file.exists()
    handle = os.open(file, os.O_RDWR | os.O_APPEND | os.O_CREAT, 0o666)
    try:
        size = os.fstat(handle).st_size
        if size and os.pread(handle, 1, size - 1) != b"\n":
            line = b"\n" + line
        os.write(handle, line)
        os.fsync(handle)
    finally:
        os.close(handle)
    if new:
        sync_folder(file.parent)
