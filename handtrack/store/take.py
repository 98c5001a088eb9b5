"""A take: one tracking, frame by frame as it came, with all that made it. It is never overwritten."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from functools import cached_property
from math import prod
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from handtrack.arrays import Array
from handtrack.errors import HandtrackError
from handtrack.parallel import LRUCache
from handtrack.store.log import LogWriter, Record, read_at, read_log, read_segments, size_of
from handtrack.tracking.frame.motion_belief import MotionBelief
from handtrack.tracking.frame.reason import Reason
from handtrack.tracking.frame.result import (
    COLUMNS,
    FIELDS,
    Alternative,
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


# ---- A tracked frame ↔ what a record holds: numbers as JSON, arrays as bytes, nothing rounded


_STATE = ("belief", "hypothesis")
"""arrays that begin so are of the tracker's state"""
_Content = tuple[dict[str, Any], bytes]
"""data and payload of a record"""


def step_content(step: Step) -> _Content:
    """Return what a record of a tracked frame holds."""
    data, arrays = _of_result(step.result)
    arrays["belief"] = step.belief
    moving = step.result.alternatives[: len(step.beliefs)]
    data["hypotheses"] = [[float(one.energy), float(one.weight), one.origin] for one in moving]
    for number, belief in enumerate(step.beliefs):
        for name, key in _BELIEF.items():
            arrays[f"hypothesis{number}.{name}"] = getattr(belief, key)
    return _packed(data, arrays)


def result_content(result: FrameResult) -> _Content:
    """Return what a record of a frame holds that nothing is tracked on from."""
    return _packed(*_of_result(result))


def read_result(record: Record) -> FrameResult:
    """Return the frame of a record. Raises ValueError, KeyError or TypeError for one that holds none."""
    return _result(record.data, _arrays(record, passed_over=_STATE))


def read_step(record: Record) -> Step:
    """Return the frame of a record with what the next one needs. Raises as `read_result` does."""
    arrays, data = _arrays(record), record.data
    beliefs = tuple(
        MotionBelief(**{key: arrays[f"hypothesis{n}.{name}"] for name, key in _BELIEF.items()})
        for n in range(len(data.get("hypotheses", ())))
    )
    return Step(_result(data, arrays), arrays.get("belief"), beliefs)


def _packed(data: dict[str, Any], arrays: Mapping[str, Array | None]) -> _Content:
    """Return data with arrays of floats by name, one after another. Their order in memory is kept: sums depend on it."""
    heads, parts = list[list[object]](), list[bytes]()
    for name, array in arrays.items():
        if array is not None:
            columns = array.flags.f_contiguous and not array.flags.c_contiguous
            rows = array.T if columns else array
            heads.append([name, "F" if columns else "C", *array.shape])
            parts.append(np.ascontiguousarray(rows, dtype="<f8").tobytes())
    return data | {"arrays": heads}, b"".join(parts)


def _arrays(record: Record, passed_over: tuple[str, ...] = ()) -> dict[str, Array]:
    found, at = {}, 0
    for name, order, *shape in record.data["arrays"]:
        count = prod(shape)
        if not (passed_over and name.startswith(passed_over)):
            flat = np.frombuffer(record.payload, "<f8", count, at).astype(float)
            found[name] = flat.reshape(shape[::-1]).T if order == "F" else flat.reshape(shape)
        at += 8 * count
    return found


def _of_result(result: FrameResult) -> tuple[dict[str, Any], dict[str, Array | None]]:
    arrays = dict[str, Array | None]()
    data: dict[str, Any] = {
        "energies": {name: float(value) for name, value in result.energies.items()},
        "reason": None if result.reason is None else asdict(result.reason),
        "alternatives": [
            [float(a.energy), float(a.weight), int(a.parent), a.origin] for a in result.alternatives
        ],
    }
    for name in (name for name in FIELDS if name not in data):
        if COLUMNS[name].axes:
            arrays[name] = getattr(result, name)
        else:
            data[name] = COLUMNS[name].kind(getattr(result, name))
    for number, pose in enumerate(result.alternatives):
        arrays[f"alternative{number}"] = pose.parameters
    return data, arrays


def result_head(data: Mapping[str, Any], owner: type[FrameHead] = FrameHead) -> dict[str, Any]:
    """Return what a record's data says of a frame without its arrays, by the names of the owner's fields."""
    known = {entry.name: data[entry.name] for entry in fields(owner) if entry.name in data}
    reason = data["reason"] and Reason(**data["reason"])
    return known | {"status": Status(data["status"]), "reason": reason}


def _result(data: dict[str, Any], arrays: dict[str, Array]) -> FrameResult:
    known = result_head(data, FrameResult)
    known |= {name: array for name, array in arrays.items() if name in FIELDS}
    known["alternatives"] = tuple(
        Alternative(arrays[f"alternative{n}"], *numbers)
        for n, numbers in enumerate(data["alternatives"])
    )
    return FrameResult(**known)


_BELIEF = {"mean": "mean", "velocity": "velocity", "motion": "covariance"}
"""arrays of a hypothesis, and the fields of its belief"""


# ---- The current track frame by frame: of takes that lie over one another, read from disk when a frame is asked for


_MOST_READ = 256  # frames whose arrays stay in memory, about 3 MB: those that one looks at

Head = StoredFrame | FrameResult
"""status, energy and its parts of a frame; one that is nowhere on disk is its own head"""


@dataclass(eq=False)
class TakeFrames(Mapping[int, FrameResult]):
    """The frames of one take."""

    labels: TrackLabels
    """of the model, settings and size that it was tracked with"""
    heads: dict[int, Head] = field(default_factory=dict)
    puts: list[int] = field(default_factory=list)
    """frames that were taken since it was read or begun, in this order: whoever follows it looks at these alone"""
    _read: LRUCache[int, FrameResult] = field(default_factory=LRUCache)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        return self.labels.parameter_names

    def put(self, result: FrameResult, head: StoredFrame | None) -> None:
        """Take a frame, in the place of the one that was there. head: where it is on disk; None: nowhere."""
        self.heads[result.frame] = result if head is None else head
        self.puts.append(result.frame)
        self._read.put(result.frame, result, _MOST_READ)

    def __getitem__(self, frame: int) -> FrameResult:
        """Raises KeyError, or HandtrackError where a frame cannot be read any more."""
        head = self.heads[frame]
        if isinstance(head, FrameResult):
            return head
        return self._read.value(frame, head.read, lambda _: _MOST_READ)

    def __contains__(self, frame: object) -> bool:
        return frame in self.heads

    def __iter__(self) -> Iterator[int]:
        return iter(self.heads)

    def __len__(self) -> int:
        return len(self.heads)


@dataclass(eq=False)
class CurrentTrack(Mapping[int, FrameResult]):
    """Takes over one another; where an upper one lacks a frame, the one below shows."""

    layers: Sequence[tuple[range, TakeFrames]] = ()
    """frames for which a take counts, and the take; the uppermost last"""

    def head(self, frame: int) -> Head | None:
        """Return what is known of a frame without its arrays; None of one that was not tracked."""
        take = self._take(frame)
        return None if take is None else take.heads[frame]

    def below(self, frame: int) -> FrameResult | None:
        """Return what showed at a frame before the take that shows there was laid over it; None where nothing did."""
        takes = [*self._takes(frame)]
        return takes[1][frame] if len(takes) > 1 else None

    @property
    def refinement(self) -> str | None:
        """What the frames of the uppermost take share that shows anywhere and tells it: frames beside a correction tell nothing new."""
        telling = (take for _, take in reversed(self.layers) if take.labels.refinement is not None)
        return next((take.labels.refinement for take in telling if self.count_of(take)), None)

    def count_of(self, take: TakeFrames) -> int:
        """Return how many frames a take shows."""
        return sum(self._take(frame) is take for frame in take)

    def _takes(self, frame: object) -> Iterator[TakeFrames]:
        """Yield the takes that have a frame, the uppermost first."""
        return (take for frames, take in reversed(self.layers) if frame in take and frame in frames)

    def _take(self, frame: object) -> TakeFrames | None:
        return next(self._takes(frame), None)

    def __getitem__(self, frame: int) -> FrameResult:
        """Raises KeyError, or HandtrackError where a frame cannot be read any more."""
        take = self._take(frame)
        if take is None:
            raise KeyError(frame)
        return take[frame]

    def __contains__(self, frame: object) -> bool:
        return self._take(frame) is not None

    def __iter__(self) -> Iterator[int]:
        """Ascending."""
        shown = {frame for frames, take in self.layers for frame in take if frame in frames}
        return iter(sorted(shown))

    def __len__(self) -> int:
        return sum(1 for _ in self)
