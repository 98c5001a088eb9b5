"""What was made with a model is put aside while another one is looked at."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from handtrack.arrays import Floats
from handtrack.tracking.frame.result import FrameResult


@dataclass(frozen=True)
class Made:
    """What was made with a model that is not the one in force."""

    start: Floats
    shown: Floats
    by_hand: dict[int, Floats] = field(default_factory=dict)
    results: dict[int, FrameResult] = field(default_factory=dict)
    limits: dict[str, tuple[float, float]] = field(default_factory=dict)

    def pose_at(self, frame: int) -> Floats:
        if frame in self.by_hand:
            return self.by_hand[frame]
        return self.results[frame].parameters if frame in self.results else self.shown


def renamed(
    values: Floats, names: Sequence[str], new_names: Sequence[str], others: Floats
) -> Floats:
    """Return joint parameters of another model by name; those that are not known are `others` (S,)."""
    known: Mapping[str, float] = dict(zip(names, values.tolist(), strict=True))
    return np.array([known.get(name, other) for name, other in zip(new_names, others, strict=True)])
