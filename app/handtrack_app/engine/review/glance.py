"""What is told of a recording at a glance beside status and energy: what is worth a look, limits, what moved, takes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from handtrack.diagnostics.review import worth_a_look
from handtrack.model.articulated import ArticulatedModel
from handtrack.store.spans import Span, resolved
from handtrack.tracking.frame.result import FrameResult
from handtrack_app.engine.document import Document
from handtrack_app.protocol.timeline import APART, AT_LIMITS, MOVED, StretchCard, TakeSpan

_MOST = 500  # of the queue: nobody looks at more in one go, and what is told does not grow with the recording
_AT_LIMIT_RAD = 1e-3  # bounded steps end at a limit to rounding; a slider's step is 0.1°


def queue(document: Document) -> tuple[StretchCard, ...]:
    """Return the stretches that are worth a look, the worst first."""
    done = document.accepted | document.by_hand.keys()
    return tuple(
        StretchCard(s.first, s.last, s.worst, s.expected, s.brief, s.words)
        for s in worth_a_look(document.rows.heads(), done)[:_MOST]
    )


def take_spans(document: Document) -> tuple[TakeSpan, ...]:
    """Return of which takes the current track is composed."""
    return _showing(document, document.laid)


def hidden_spans(document: Document) -> tuple[TakeSpan, ...]:
    """Return the frames that do not show, since they were tracked with another model than the one in force."""
    return _showing(document, document.hidden)


def _showing(document: Document, laid: Sequence[Span]) -> tuple[TakeSpan, ...]:
    shown = resolved(laid, document.takes.frames_of)
    return tuple(TakeSpan(s.take, s.first, s.stop - 1) for s in shown)


def numbers_of(
    model: ArticulatedModel,
    result: FrameResult,
    below: FrameResult | None,
    compared: FrameResult | None,
) -> dict[str, float]:
    """Return how many joints of a frame lie at their limits, and how far the furthest is from where it lies below it, and in the
    take that is compared [mm].
    """
    found, interval = dict[str, float](), model.limits.interval
    if len(result.parameters) == len(interval):
        low, high = interval[6:].T
        near = np.abs(result.parameters[6:, None] - interval[6:]).min(axis=1) < _AT_LIMIT_RAD
        found[AT_LIMITS] = float((near & (high - low > _AT_LIMIT_RAD)).sum())
    for word, other in ((MOVED, below), (APART, compared)):
        if other is not None and other.joint_positions.shape == result.joint_positions.shape:
            moves = np.linalg.norm(result.joint_positions - other.joint_positions, axis=1)
            found[word] = float(1e3 * moves.max())
    return found
