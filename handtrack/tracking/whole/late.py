"""Which cameras are late by whole frames: where their pictures fit poses of other frames better."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from handtrack.arrays import C, F, Floats, K, P
from handtrack.solver.problem import Problem
from handtrack.tracking.size.cameras import CameraChanges
from handtrack.tracking.size.sized_problem import terms_of
from handtrack.tracking.whole.evidence import Evidence, by_camera

_MOST = 5
"""frames that a camera may be late by: a fifth of a second at 25 a second, further than a hand's picture reaches its place"""
_LOOKS = 40
"""frames, evenly spread, that are looked at"""


def with_late_cameras(
    evidence: Evidence, numbers: Sequence[int], poses: Floats[F, P]
) -> CameraChanges:
    """Return the evidence's cameras with those images looked at beside a frame that fit its pose best, in the widest band and better in
    the narrowest, too: of fingers that curl at one place the widest may tell any.

    Only a start: poses that were found with a late camera lie between it and the others.
    """
    cameras = evidence.cameras
    if not cameras.count or len(numbers) <= 2 * _MOST:
        return cameras
    best = _costs(evidence, numbers, poses, range(2 * _MOST + 1), 0).argmin(axis=1)
    if (best == _MOST).all():
        return cameras
    tried = sorted({_MOST, *best.tolist()})
    narrow = _costs(evidence, numbers, poses, tried, -1)
    own = narrow[np.arange(len(best)), np.searchsorted(tried, best)]
    later = np.where(own < narrow[:, tried.index(_MOST)], best - _MOST, 0)
    # the recording's time is that of most cameras; of two, the first one's
    common = min(later.tolist(), key=lambda one: int(np.abs(later - one).sum()))
    return replace(cameras, ahead=tuple((common - later).tolist()))


def _costs(
    evidence: Evidence,
    numbers: Sequence[int],
    poses: Floats[F, P],
    later: Sequence[int],
    stage: int,
) -> Floats[C, K]:
    """Return what each camera's pictures of some frames cost at poses of frames beside them, the K-th `later` less _MOST frames after;
    stage: of the bands, the widest first, −1 the narrowest.
    """
    names, model = evidence.cameras.names, evidence.shared.person.model
    found = np.zeros((len(names), len(later)))
    looks = np.unique(np.linspace(_MOST, len(numbers) - 1 - _MOST, _LOOKS).round().astype(int))
    for n in looks.tolist():
        terms = evidence.of(numbers[n]).terms
        seen, _ = by_camera(terms.stage(stage % terms.stages, evidence.model.bones(poses[n])))
        for c, name in enumerate(names):
            problem = Problem(model, seen.get(name, []))
            problem = replace(problem, observation_terms=terms_of(problem, model))
            for k, frames in enumerate(later):
                found[c, k] += problem.cost(poses[n + frames - _MOST])
    return found
