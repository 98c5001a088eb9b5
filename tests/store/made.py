"""Takes for tests of the store: invented frames, with and without hypotheses."""

from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from handtrack.store.store import WritableStore
from handtrack.store.take import TakeAbout
from handtrack.tracking.frame.motion_belief import MotionBelief
from handtrack.tracking.frame.reason import Reason
from handtrack.tracking.frame.result import Alternative, Step
from tests.sample_track import HAND, labels_of, sample_frame


def about(frames: range = range(5), by: str = "a test", **inputs: str) -> TakeAbout:
    """Return the description of a take of some frames."""
    return TakeAbout(
        by, "2026-01-01T00:00:00Z", (frames.start, frames.stop), labels_of(HAND), inputs
    )


def step(rng: np.random.Generator, frame: int, hypotheses: int = 0) -> Step:
    """Return a tracked frame with all that may be in one."""
    count = len(HAND.rest)
    known = tuple(
        MotionBelief(
            rng.normal(size=count),
            rng.normal(size=count),
            np.asfortranarray(rng.normal(size=(2 * count, 2 * count))),
        )
        for _ in range(hypotheses)
    )
    others = tuple(Alternative(b.mean, 1.5, 0.5, n, "followed") for n, b in enumerate(known))
    result = sample_frame(
        rng,
        frame,
        energies={"silhouettes": 0.1, "motion": float("nan")},
        reason=Reason("overlap", camera="cam0", number=0.1 + 0.2),
        alternatives=others,
    )
    return Step(result, rng.normal(size=(count, count)), known)


def add_take(store: WritableStore, frames: range, seed: int = 0) -> int:
    """Add a take of invented frames and return its number."""
    writer = store.begin(about(frames, seed=str(seed)))
    rng = np.random.default_rng(seed)
    for frame in frames:
        writer.add(step(rng, frame))
    writer.finish()
    return writer.take.number


def same(one: Any, other: Any) -> bool:
    """Return whether two values are equal to the bit, arrays in the same order of memory."""
    if is_dataclass(one):
        return type(one) is type(other) and all(
            same(getattr(one, f.name), getattr(other, f.name)) for f in fields(one)
        )
    if isinstance(one, np.ndarray):
        return one.strides == other.strides and one.tobytes() == other.tobytes()
    if isinstance(one, tuple):
        return len(one) == len(other) and all(map(same, one, other))
    return repr(one) == repr(other)


def files_of(folder: Path) -> list[str]:
    """Return every file below a folder, by its path there."""
    return sorted(str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file())
