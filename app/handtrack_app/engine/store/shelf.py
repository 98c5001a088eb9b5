"""The shelf: takes of the open session, those on disk read when they are asked for, those of this hour as they come."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

from handtrack.errors import HandtrackError
from handtrack.session.takes.take_about import REFINED
from handtrack.store.current_track import CurrentTrack, TakeFrames
from handtrack.store.store import Store
from handtrack_app.protocol.snapshots import TakeCard


class TakeShelf:
    """Takes by their numbers."""

    def __init__(self, folder: Path | None = None, tell: Callable[[str], None] = print) -> None:
        """folder: a session's tracks/; None: nothing is on disk. tell: takes a sentence for whatever is damaged."""
        self._store = None if folder is None else Store(folder)
        self._tell = tell
        self._known: dict[int, TakeFrames | None] = {}
        self._cards: tuple[CurrentTrack, tuple[TakeCard, ...]] | None = None

    def get(self, number: int) -> TakeFrames | None:
        """Return a take's frames; None of one that was removed or cannot be read."""
        if number not in self._known:
            self._known[number] = None if self._store is None else self._read(number, self._store)
        return self._known[number]

    def frames_of(self, number: int) -> tuple[int, ...]:
        """Return the frames that a take has."""
        return tuple(self.get(number) or ())

    def cards(self, track: CurrentTrack) -> tuple[TakeCard, ...]:
        """Return what is told of each take, the latest first. All takes are looked at, so once for a track."""
        if self._cards is None or self._cards[0] is not track:
            self._cards = track, self._cards_of(track)
        return self._cards[1]

    def _cards_of(self, track: CurrentTrack) -> tuple[TakeCard, ...]:
        there = {} if self._store is None else {take.number: take for take in self._store.takes()}
        shown = {number: track.count_of(take) for number, take in self._known.items() if take}
        cards = []
        for number in sorted({*there, *shown}, reverse=True):
            words = f"{len(self._known.get(number) or ())} frames, not on disk"
            if number in there:
                try:
                    about = there[number].about
                except HandtrackError:
                    continue  # begun by a program that was killed at once; `handtrack takes` tells of it
                first, stop = about.frames
                if stop - first == 1:
                    continue  # a single frame that was fitted: undo goes back to it
                when = about.begun.replace("T", " ").removesuffix("+00:00")
                size = there[number].bytes / 1e6
                kind = f"{REFINED}, " if about.by.endswith(REFINED) else ""
                words = f"{when} UTC, {kind}frames {first} to {stop - 1}, {size:.1f} MB"
            cards.append(TakeCard(number, words, shown.get(number, 0)))
        return tuple(cards)

    def put(self, number: int, take: TakeFrames) -> None:
        """Add a take that is being tracked."""
        self._known[number] = take

    def look_again(self) -> None:
        """A take has come to its end."""
        self._cards = None

    @property
    def next_number(self) -> int:
        """A number for a take that nothing is written of."""
        there = () if self._store is None else self._store.takes()
        return max([0, *self._known, *(take.number for take in there)]) + 1

    def _read(self, number: int, store: Store) -> TakeFrames | None:
        damage: list[str] = []
        try:
            take = store.take(number)
            labels = take.about.labels
            return TakeFrames(
                labels.parameter_names,
                dict(take.frame_heads(damage)),
                labels.refinement,
                json.loads(labels.settings or "{}"),
            )
        except HandtrackError as error:
            damage.append(str(error))
        finally:
            for text in damage:
                self._tell(text)
        return None
