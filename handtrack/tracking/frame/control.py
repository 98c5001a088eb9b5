"""What a caller may ask of a long computation: to stop, to be shown iterations, to be told what was searched."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from handtrack.arrays import Floats, P

Watch = Callable[[int, Floats[P], float], None]
"""called after each accepted solver step with its count, parameters and cost"""


def _never() -> bool:
    return False


@dataclass(frozen=True)
class Control:
    """Handed down from whoever started the work."""

    should_stop: Callable[[], bool] = _never
    """asked between solver steps"""
    on_iteration: Callable[[int, int, Floats[P], float], None] | None = None
    """called as Watch is, with the frame's number before"""
    on_search: Callable[[Any], None] | None = None
    """called with a SearchReport for every search that was made"""
    on_step: Callable[[Any], None] | None = None
    """called with a Step for every frame that is solved for good, in the order of tracking, before its result is yielded"""

    def watch(self, frame: int) -> Watch | None:
        """Return what the solver calls after each step in a frame; None where nobody looks."""
        shown = self.on_iteration
        if shown is None:
            return None
        return lambda count, params, cost: shown(frame, count, params, cost)
