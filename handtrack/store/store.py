"""Store: the takes of a session and its current track; the only writer of the session's tracks/.

    tracks/actions/000007.log        what was decided: poses, settings, which spans of which takes are current, what was removed
    tracks/takes/0003/000007.log     a take's frames
    tracks/lease-000007.json         who writes now

Reading needs nobody's leave. Whoever writes holds the lease, and begins new files of its own (`log`).
"""

from __future__ import annotations

import shutil
import threading
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import groupby, pairwise
from pathlib import Path
from typing import Any

from handtrack.errors import HandtrackError
from handtrack.store.history import Action, Change, History, Span, State, Value, apply
from handtrack.store.lease import BEAT_S, Lease
from handtrack.store.log import LogWriter, make_folders, read_log, segments, size_of
from handtrack.store.take import Take, TakeAbout, TakeWriter
from handtrack.tracking.frame.result import FrameResult, TrackResult

_ACTIONS, _TAKES = "actions", "takes"
_ACTION, _PRUNED, _FILE = "action", "pruned", "file"
SPANS = "spans"
"""the value of a session's state that says what the current track is composed of"""
ACCEPTED = "accepted"
"""likewise, which frames a person accepted, half-open pairs: no tracking changes what shows there"""
_SYNC_S = 0.5


class Store:
    """A store as it stands on disk; `WritableStore` adds to it."""

    def __init__(self, folder: Path) -> None:
        """folder: a session's tracks/; it need not exist."""
        self.folder = folder

    def takes(self) -> list[Take]:
        """Return the takes that were not pruned, the oldest first."""
        pruned = {data["take"] for data in self._actions(_PRUNED)}
        return [take for take in self._all_takes() if take.number not in pruned]

    def take(self, number: int) -> Take:
        """Return a take by its number. Raises HandtrackError."""
        known = {take.number: take for take in self.takes()}
        if number not in known:
            there = ", ".join(map(str, known)) or "none yet"
            raise HandtrackError(f"{self.folder}: no take {number}; its takes: {there}.")
        return known[number]

    def actions(self, mark: str = "") -> Iterator[Action]:
        """Yield what was decided, one action after the other; files that do not have `mark` in them are passed over."""
        for record in read_log(self.folder / _ACTIONS, [], payloads=False, mark=mark.encode()):
            with suppress(ValueError, KeyError, TypeError):  # of a later version
                if record.kind == _ACTION:
                    yield Action.of(record.data)

    def history(self) -> History:
        """Return what was decided so far, step by step. Reads all of it."""
        return History.of(self.actions())

    def state(self, beginning: str = "") -> State:
        """Return what holds by all that was decided, of values whose names begin so."""
        state: dict[str, Value] = {}
        for action in self.actions(f'"{beginning}' if beginning else ""):
            apply((c for c in action.changes if c.key.startswith(beginning)), state)
        return state

    def current(self) -> tuple[Span, ...]:
        """Return the spans of takes that show as the current track, in ascending order."""
        spans = spans_of(self.state().get(SPANS))
        ordered = sorted(spans, key=lambda span: span.first)
        if all(one.stop <= other.first for one, other in pairwise(ordered)):
            return tuple(ordered)
        return resolved(spans, self.frames_of)

    def frames_of(self, number: int) -> tuple[int, ...]:
        """Return the frames that a take has; none of one that was removed or cannot be read."""
        with suppress(HandtrackError):
            return self.take(number).frames
        return ()

    def composed(self, spans: Sequence[Span]) -> tuple[Span, ...]:
        """Return what would show if spans were made current, each frame once: accepted frames stay as they are."""
        accepted = self.state().get(ACCEPTED) or ()
        kept = clipped(self.current(), accepted) if accepted else ()
        return resolved([*spans, *kept], self.frames_of)

    def track_of(self, spans: Sequence[Span]) -> TrackResult | None:
        """Return spans, each frame in one of them, as one track; None where there are no frames. It is labelled as its latest take is.

        Raises HandtrackError where its takes are of different models.
        """
        takes = {span.take: self.take(span.take) for span in spans}
        labels = takes[max(takes)].about.labels
        frames: list[FrameResult] = []
        for span in spans:
            theirs = takes[span.take].about.labels
            if theirs.parameter_names != labels.parameter_names:
                raise HandtrackError(
                    f"{self.folder}: takes {span.take} and {max(takes)} are of different models ({theirs.model} and "
                    f"{labels.model}), so they cannot be one track. Restore one of them for all frames."
                )
            frames += takes[span.take].results(range(span.first, span.stop))
        return labels.track(frames) if frames else None

    def known_files(self) -> set[str]:
        """Return digests of track files whose frames are all in takes; `session.takes.take_recorder` makes them."""
        return {str(data["digest"]) for data in self._actions(_FILE)}

    def damage(self, takes: bool = True) -> list[str]:
        """Return a sentence for each part that is damaged or missing. Reads everything; without the takes, if wanted."""
        found: list[str] = []
        for _ in read_log(self.folder / _ACTIONS, found):
            pass
        read = self._all_takes() if takes else ()
        return [*found, *(text for take in read for text in take.damage)]

    def unfinished(self, inputs: Mapping[str, str]) -> Take | None:
        """Return the latest take that was made from these inputs, if it did not come to its end."""
        for take in reversed(self.takes()):
            with suppress(HandtrackError):  # nobody knows what it was made from
                if take.about.inputs == inputs:
                    return None if take.is_finished else take
        return None

    def _all_takes(self) -> list[Take]:
        found = (self.folder / _TAKES).glob("*")
        takes = [Take(path) for path in found if path.name.isdecimal() and size_of(path)]
        return sorted(takes, key=lambda take: take.number)

    def _actions(self, kind: str) -> list[dict[str, Any]]:
        records = read_log(self.folder / _ACTIONS, [], payloads=False)
        return [record.data for record in records if record.kind == kind]


class WritableStore(Store):
    """A store that this program writes to. Use as a context: at its end all is on disk and the lease is given back."""

    def __init__(self, folder: Path, program: str, take_over: bool = False) -> None:
        """program: such as `handtrack track`, for others to read. take_over: even if another program holds the lease.

        Raises LeaseTaken naming the holder, or OSError where nothing can be written.
        """
        super().__init__(folder)
        make_folders(folder)
        logs = [folder / _ACTIONS, *(take.folder for take in self._all_takes())]
        written = [int(p.stem) for log in logs for p in segments(log)]
        self.lease = Lease.acquire(folder, program, max(written, default=0) + 1, take_over)
        self._writers = [LogWriter(folder / _ACTIONS, self.lease.generation, self.lease.check)]
        self._history = super().history()
        self._ended = threading.Event()
        self._keeper = threading.Thread(target=self._keep, name="store", daemon=True)
        self._keeper.start()
        self._remove_pruned()

    def __enter__(self) -> WritableStore:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def begin(self, about: TakeAbout) -> TakeWriter:
        """Begin a new take."""
        folder = self.folder / _TAKES
        pruned = [data["take"] for data in self._actions(_PRUNED)]
        there = [int(p.name) for p in folder.glob("*") if p.name.isdecimal()]
        return self._writer(Take(folder / f"{max([0, *pruned, *there]) + 1:04d}"), about)

    def go_on(self, take: Take) -> TakeWriter:
        """Add to a take that did not come to its end."""
        return self._writer(take, take.about)

    def history(self) -> History:
        """Return what was decided so far, what this program wrote included; whoever adds to it is to `write` it."""
        return self._history

    def state(self, beginning: str = "") -> State:
        """As `Store.state`, what this program wrote included."""
        return {k: v for k, v in self._history.state.items() if k.startswith(beginning)}

    def write(self, action: Action) -> None:
        """Bring an action to disk. Raises HandtrackError, and nothing is written."""
        self._act(_ACTION, action.content)

    def make_current(self, spans: Sequence[Span], words: str = "Another take") -> None:
        """Say what the current track is composed of, but for frames that were accepted; undo in the workbench takes it back."""
        history = self._history
        if history.state.get(ACCEPTED):
            spans = self.composed(spans)
        after = [[s.take, s.first, s.stop] for s in spans]
        action = history.next(words, [Change(SPANS, history.state.get(SPANS), after)])
        self.write(action)
        history.take(action)

    def know_file(self, digest: str) -> None:
        """Say that the frames of a track file are all in takes."""
        self._act(_FILE, {"digest": digest})

    def restored(self, number: int, frames: range | None = None) -> tuple[Span, ...]:
        """Return what the current track is composed of once a take, or some frames of it, is made current again; the rest stays."""
        take = self.take(number)
        if not take.frames:
            raise HandtrackError(f"{self.folder}: take {number} has no frames.")
        there = range(take.frames[0], take.frames[-1] + 1)
        if frames is None:
            return (Span(number, there.start, there.stop),)
        first, stop = max(frames.start, there.start), min(frames.stop, there.stop)
        if first >= stop:
            raise HandtrackError(
                f"{self.folder}: take {number} has the frames {there.start} to {there.stop - 1}, none of "
                f"{frames.start} to {frames.stop - 1}."
            )
        return resolved([*self.current(), Span(number, first, stop)], self.frames_of)

    def prune(self, number: int) -> int:
        """Remove a take for good; return how many bytes that frees. Raises HandtrackError for one that is current."""
        take = self.take(number)
        if any(span.take == number for span in self.current()):
            raise HandtrackError(
                f"{self.folder}: take {number} is part of the current track; restore another one first."
            )
        size = take.bytes
        self._act(_PRUNED, {"take": number})
        self._remove_pruned()
        return size

    def close(self) -> None:
        """Bring everything to disk and give the lease back."""
        self._ended.set()
        self._keeper.join()
        try:
            for writer in self._writers:
                writer.close()
        finally:
            self.lease.release()
            with suppress(OSError):
                self.folder.rmdir()  # where nothing was written

    def _act(self, kind: str, data: dict[str, Any]) -> None:
        self._writers[0].append(kind, data)

    def _writer(self, take: Take, about: TakeAbout) -> TakeWriter:
        log = LogWriter(take.folder, self.lease.generation, self.lease.check)
        self._writers.append(log)
        return TakeWriter(Take(take.folder), about, log)

    def _remove_pruned(self) -> None:
        for data in self._actions(_PRUNED):
            with suppress(OSError):
                shutil.rmtree(self.folder / _TAKES / f"{data['take']:04d}")

    def _keep(self) -> None:
        """Bring to disk what was written without waiting for it, and say that we live."""
        waits = 0.0
        while not self._ended.wait(_SYNC_S):
            for writer in list(self._writers):
                with suppress(HandtrackError):  # tried again, and told when the store is closed
                    writer.sync()
            waits += _SYNC_S
            if waits >= BEAT_S:
                self.lease.beat()
                waits = 0.0


def spans_of(value: object) -> tuple[Span, ...]:
    """Return the spans that a session's state names, the uppermost last."""
    return tuple(Span(*map(int, span)) for span in value) if isinstance(value, list) else ()


# ---- Spans of takes, of which a track is composed. Later ones lie over earlier ones: where a take lacks a frame, the one below shows


def clipped(spans: Sequence[Span], accepted: Sequence[Sequence[int]]) -> list[Span]:
    """Return what spans show of accepted frames, half-open pairs: laid over others it stays."""
    both = ((span, first, stop) for first, stop in accepted for span in spans)
    return [Span(s.take, max(s.first, first), min(s.stop, stop)) for s, first, stop in both]


def resolved(
    spans: Sequence[Span], frames_of: Callable[[int], Collection[int]]
) -> tuple[Span, ...]:
    """Return what shows of spans that lie over one another: ascending, each frame once. frames_of: those that a take has."""
    shown: dict[int, int] = {}
    for span in spans:
        theirs = (f for f in frames_of(span.take) if span.first <= f < span.stop)
        shown |= dict.fromkeys(theirs, span.take)
    runs = groupby(enumerate(sorted(shown)), lambda place: (shown[place[1]], place[1] - place[0]))
    found = [(take, [frame for _, frame in run]) for (take, _), run in runs]
    return tuple(Span(take, frames[0], frames[-1] + 1) for take, frames in found)
