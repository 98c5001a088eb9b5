"""Killed at random moments, the disk full at others: all that was acknowledged is there, unchanged, and no file is left over.

`HANDTRACK_KILLS=300 pytest tests/store/test_killed.py` is the nightly measure.
"""

import random
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from handtrack import HandtrackError
from handtrack.store.store import Span, Store, WritableStore
from tests.killing import KILLS, forked, killed
from tests.store.made import about, files_of, same, step


@dataclass
class Known:
    """What the store must hold: what was acknowledged. And what was only begun: that may be there or not."""

    frames: set[tuple[int, int, int]] = field(default_factory=set)
    """take, frame, seed of its numbers"""
    spans: list[tuple[Span, ...]] = field(default_factory=lambda: [()])
    """the current track, and those that may be it"""
    pruned: set[int] = field(default_factory=set)
    may_be_pruned: set[int] = field(default_factory=set)
    failed: int = 0

    def hear(self, line):
        what, state, *told = line
        if what == "frame" and state == "done":
            self.frames.add(tuple(told))
        elif what == "current":
            spans = tuple(Span(*span) for span in told[0])
            self.spans = [spans] if state == "done" else [*self.spans, spans]
        elif what == "prune":
            (self.pruned if state == "done" else self.may_be_pruned).add(told[0])
        self.failed += what == "failed"

    def check(self, folder):
        store = Store(folder)
        takes = {take.number: take for take in store.takes()}
        assert not self.pruned & takes.keys()
        assert store.current() in self.spans
        found = {
            number: {step.result.frame: step for step in take.steps()}
            for number, take in takes.items()
        }
        for take, frame, seed in self.frames:
            if take not in self.pruned | self.may_be_pruned:
                assert same(found[take][frame], step(np.random.default_rng(seed), frame))


def work(folder, told, rng, fate):
    """Do whatever a program does with a store, telling before and after each deed."""
    with WritableStore(folder, "a test") as store:
        fate.arm()
        numbers = [take.number for take in store.takes() if not take.is_finished]
        go_on, writer = numbers and rng.random() < 0.5, None
        while writer is None:
            with suppress(HandtrackError):
                last = store.take(numbers[-1]) if go_on else None
                writer = store.begin(about(range(100_000))) if last is None else store.go_on(last)
        number = writer.take.number
        frame = len(store.take(number).frames)
        while True:
            told("begun", "")
            try:
                deed = rng.random()
                if deed < 0.7:
                    seed = rng.randrange(1 << 30)
                    writer.add(step(np.random.default_rng(seed), frame))
                    told("frame", "done", number, frame, seed)
                    frame += 1
                elif deed < 0.9:
                    spans = [(number, 0, rng.randint(1, 99))]
                    told("current", "begun", spans)
                    store.make_current([Span(*span) for span in spans])
                    told("current", "done", spans)
                else:
                    others = {take.number for take in store.takes()} - {number}
                    others -= {span.take for span in store.current()}
                    if others:
                        told("prune", "begun", min(others))
                        store.prune(min(others))
                        told("prune", "done", min(others))
            except HandtrackError:
                told("failed", "")


@forked
def test_a1_a6_a7_killed_at_any_moment_nothing_acknowledged_is_lost(tmp_path):
    rng, known = random.Random(5), Known()
    for _ in range(KILLS):
        for line in killed(tmp_path, random.Random(rng.random()), work, lines=60):
            known.hear(line)
        known.check(tmp_path)
        known.spans = [Store(tmp_path).current()]
        assert len(list(tmp_path.glob("lease-*"))) <= 2
    with WritableStore(tmp_path, "the last"):
        pass
    assert {Path(name).suffix for name in files_of(tmp_path)} == {".log"}
    assert len(known.frames) > KILLS
    print(
        f"{KILLS} kills, {len(known.frames)} frames acknowledged, {known.failed} writes failed, 0 lost"
    )
