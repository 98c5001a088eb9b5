"""A person's hand size from tracked frames: which of them can tell it, and what it is."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from handtrack.model.articulated import HandScale
from handtrack.observation.observation import Observation
from handtrack.tracking.frame.result import FrameResult
from handtrack.tracking.size.size import refine_scale

if TYPE_CHECKING:
    from handtrack.session.run import TrackingRun

Tell = Callable[[float, str], None]
"""is given the share that is done, 0 to 1, and what is done in words"""
MOST_FRAMES = 8
"""that are used: neighbours show the same"""
TRACKED_SHARE = 0.6
"""of the time that a fit takes, where its frames are to be tracked first"""
_STRETCH = 40  # frames tracked to fit the hand's size
_ANGLE = np.deg2rad(20.0)  # between two lines of sight


def stretch_after(start: int, count: int) -> range:
    """Return the frames to be tracked for a fit: some after the first pose, or the last ones of all."""
    after = range(start, min(start + _STRETCH, count))
    return after if len(after) > 1 else range(max(count - _STRETCH, 0), count)


def size_of_frames(
    run: TrackingRun,
    results: Iterable[FrameResult],
    most: int,
    should_stop: Callable[[], bool] | None,
    tell: Tell,
) -> HandScale | None:
    """Return the size that explains at most so many of the frames best, evenly spread; None where none can tell it.

    Seen from around, every finger has a size of its own; clouds are one-sided and tell the whole hand's only.
    """
    tracked = sorted((r for r in results if r.fits), key=lambda r: r.frame)
    seen = [(result, run.seen_at(result)) for result in _spread(tracked, most)]
    around = [pair for pair in seen if _seen_around(pair[1], pair[0])]
    used = around or [pair for pair in seen if pair[1].cloud is not None]
    if not used:
        return None
    return refine_scale(
        lambda size: run.with_scale(size).model,
        run.settings,
        run.scale,
        [known for _, known in used],
        [run.model.transform.solver_params(result.parameters) for result, _ in used],
        should_stop,
        parts=bool(around),
        tell=tell,
    )


def _spread(results: Sequence[FrameResult], most: int) -> list[FrameResult]:
    """Return at most so many, evenly spread."""
    if len(results) <= most:
        return list(results)
    return [results[round(i)] for i in np.linspace(0, len(results) - 1, most)]


def _seen_around(seen: Observation, result: FrameResult) -> bool:
    """Return whether silhouettes show the hand from directions that differ enough to tell its size.

    From one side a hand that is larger and further back, or flatter, looks the same; a cloud is one-sided too.
    """
    middle = result.joint_positions.mean(axis=0)
    sights = [middle - silhouette.camera.centre for silhouette in seen.silhouettes]
    sights = [sight / np.linalg.norm(sight) for sight in sights]
    least = min((float(a @ b) for a in sights for b in sights), default=1.0)
    return least < np.cos(_ANGLE)
