"""A take: one tracking, frame by frame as it came, with all that made it. It is never overwritten."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import msgspec

from handtrack.errors import HandtrackError
from handtrack.store.log import LogWriter, read_at, read_log, read_segments, size_of
from handtrack.store.record import Record
from handtrack.store.step_record import (
    read_result,
    read_step,
    result_content,
    result_head,
    step_content,
)
from handtrack.tracking.frame.result import (
    FrameHead,
    FrameResult,
    Status,
    Step,
    TrackLabels,
    TrackResult,
)

_ABOUT, _STEP, _POSE, _END = "take", "step", "pose", "end"


@dataclass(frozen=True)
class TakeAbout:
    """What is known of a take before its first frame."""

    by: str
    """the program, such as `handtrack track`"""
    begun: str
    """UTC, ISO 8601; for people: takes are ordered by their numbers"""
    frames: tuple[int, int]
    """half-open: those that it is to have"""
    labels: TrackLabels
    inputs: Mapping[str, str] = field(default_factory=dict)
    """what it is made from, by name: two takes with the same inputs have the same poses"""
    start: Mapping[str, Any] = field(default_factory=dict)
    """`frame` and solver `parameters` where tracking begins"""
    keyframes: tuple[int, ...] = ()
    """frames with a pose given by hand"""
    versions: Mapping[str, str] = field(default_factory=dict)
    """of the programs that made it"""


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class StoredFrame(FrameHead):
    """What is known of a stored frame without its arrays, and where they are."""

    path: Path
    offset: int

    def read(self) -> FrameResult:
        """Return the whole frame. Raises HandtrackError where it cannot be read any more."""
        return read_result(read_at(self.path, self.offset))


class Take:
    """A take as it stands on disk. Reads when asked, and holds no frames."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.number = int(folder.name)

    @property
    def about(self) -> TakeAbout:
        """Raises HandtrackError when all of its descriptions are damaged."""
        first = next(self._records(payloads=False), None)  # where it stands, unless that is damaged
        about = _about(first) if first is not None and first.kind == _ABOUT else None
        about = about or self._heads[0]
        if about is None:
            raise HandtrackError(
                f"{self.folder}: what this take is about is damaged, or of a later version of handtrack, so its frames "
                "cannot be used. The files are kept."
            )
        return about

    @property
    def statuses(self) -> dict[int, Status]:
        """The frames of its range that are there, ascending, with how far each can be trusted."""
        wanted = range(*self.about.frames)
        _, known, _ = self._heads
        return {frame: known[frame] for frame in sorted(known) if frame in wanted}

    @property
    def frames(self) -> tuple[int, ...]:
        """The frames of its range that are there, ascending."""
        return tuple(self.statuses)

    @property
    def is_finished(self) -> bool:
        """Whether it was tracked to its end."""
        _, _, is_finished = self._heads
        return is_finished

    @property
    def bytes(self) -> int:
        """What it takes on the disk."""
        return size_of(self.folder)

    @property
    def damage(self) -> tuple[str, ...]:
        """A sentence for each part that is damaged or missing. Reads all of it."""
        damage: list[str] = []
        for _ in read_log(self.folder, damage):
            pass
        return tuple(damage)

    def steps(self) -> list[Step]:
        """Return the frames that tracking can go on from, in the order they were tracked; the latest of each."""
        latest: dict[int, Step] = {}
        for record in self._records():
            if record.kind == _STEP:
                step = read_step(record)
                latest[step.result.frame] = step
        return list(latest.values())

    def results(self, frames: range | None = None) -> list[FrameResult]:
        """Return its frames in ascending order, those of `frames` alone if given."""
        wanted = range(*self.about.frames) if frames is None else frames
        latest: dict[int, FrameResult] = {}
        for record in self._records():
            if record.kind in (_STEP, _POSE) and record.data.get("frame") in wanted:
                result = read_result(record)
                latest[result.frame] = result
        return [latest[frame] for frame in sorted(latest)]

    def frame_heads(self, damage: list[str]) -> dict[int, StoredFrame]:
        """Return what is known of each of its frames, the latest of each.

        Reads and checks everything, and holds no arrays.

        Parameters
        ----------
        damage
            Gets a sentence for each part that is damaged or missing.
        """
        wanted, found = range(*self.about.frames), dict[int, StoredFrame]()
        for path, record in read_segments(self.folder, damage):
            if record.kind in (_STEP, _POSE) and record.data.get("frame") in wanted:
                found[record.data["frame"]] = _head(record.data, path, record.offset)
        return found

    def track(self, frames: range | None = None) -> TrackResult:
        """Return its frames as one result. Raises HandtrackError where there are none."""
        found = self.results(frames)
        if not found:
            raise HandtrackError(f"{self.folder}: take {self.number} has no such frames.")
        return replace(self.about.labels.track(found), take=self.number)

    @cached_property
    def _heads(self) -> tuple[TakeAbout | None, dict[int, Status], bool]:
        """What can be told without any frame's arrays: what it is about, statuses of frames, and whether it came to its end."""
        about, kind, statuses = None, "", dict[int, Status]()
        for record in self._records(payloads=False):
            kind = record.kind
            if kind in (_STEP, _POSE):
                statuses[int(record.data["frame"])] = Status(record.data["status"])
            elif kind in (_ABOUT, _END):
                about = about or _about(record)
        return about, statuses, kind == _END

    def _records(self, payloads: bool = True) -> Iterator[Record]:
        return read_log(self.folder, [], payloads)


class TakeWriter:
    """Adds frames to a take."""

    def __init__(self, take: Take, about: TakeAbout, log: LogWriter) -> None:
        """Use `Store.begin` or `Store.go_on`."""
        self.take, self.about = take, about
        self._log = log
        self._log.append(_ABOUT, asdict(about))

    def add(self, step: Step) -> None:
        """Keep a tracked frame, whatever happens to this program; a second later at most it is on disk."""
        self._log.append(_STEP, *step_content(step), durable=False)

    def replace(self, result: FrameResult) -> StoredFrame:
        """Keep a pose that nothing is tracked on from: another one of a frame that is there, of all frames together, say.
        Return where it is.
        """
        data, payload = result_content(result)
        return _head(data, self._log.path, self._log.append(_POSE, data, payload, durable=False))

    def sync(self) -> None:
        """Bring to disk what was added."""
        self._log.sync()

    def finish(self) -> None:
        """Say that it is tracked to its end; all of it is on disk."""
        self._log.append(_END, asdict(self.about))


def _head(data: Mapping[str, Any], path: Path, offset: int) -> StoredFrame:
    return StoredFrame(**result_head(data), path=path, offset=offset)


def _about(record: Record) -> TakeAbout | None:
    try:
        return msgspec.convert(record.data, TakeAbout)
    except msgspec.ValidationError:
        return None  # of a later version
