"""A grid of rigid hands over what was seen: every turn, every place, some postures."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from handtrack.arrays import D3, Floats
from handtrack.tracking.search.engine import Candidate
from handtrack.tracking.search.evidence.hand_shapes import HandShape
from handtrack.tracking.search.evidence.source import EvidenceSource
from handtrack.tracking.search.proposers.orientation_grid import spread_rotations, turned_by

_FEW_ROTATIONS, _ROTATIONS = 120, 700
"""to find out where a hand may be, and how it is turned there (13° from the nearest on average)"""
_KEPT_PLACES = 10
_HOPELESS = 0.5  # share of disagreement that need not be known exactly
# times the best disagreement of the first look: no shape beyond it is looked at closely
_PROMISING = 2.0
_LOOKED_AT = 3000
PLACE_M = 0.07
"""palms that are nearer are at one place"""
_APART_RAD, _APART_M = np.deg2rad(24.0), 0.03


def rigid_grid(
    sources: Sequence[EvidenceSource],
    shapes: Sequence[HandShape],
    most: int,
    should_stop: Callable[[], bool],
    within: tuple[Floats[D3], float] | None = None,
) -> list[Candidate]:
    """Return the shapes at all turns and places, the best first, at most `most`, none like a better one; at most half
    of them at one place, if nothing is known of where the hand is.

    A first look with few turns tells at which places a hand may be at all; those are looked at closely. Only the first
    of the sources is asked here: a cloud says more than silhouettes. within: a point and a distance [m] from it beyond
    which no palm is looked for.
    """
    source = sources[0]
    places, few = source.places, spread_rotations(_FEW_ROTATIONS)
    if within is not None:
        places = places[np.linalg.norm(places - within[0], axis=1) < within[1]]
    if not len(places):
        return []
    typical = [shape for shape in shapes if shape.is_typical]
    rough = np.stack([source.scores(s, few, places, _HOPELESS) for s in typical])
    places = places[np.argsort(rough.min(axis=(0, 1)), kind="stable")[:_KEPT_PLACES]]
    rotations = spread_rotations(_ROTATIONS)
    enough = _PROMISING * float(rough.min())
    scores = np.ones((len(shapes), len(rotations), len(places)))
    for i, shape in enumerate(shapes):
        if should_stop():
            return []
        scores[i] = source.scores(shape, rotations, places, enough)
    order = np.argsort(scores, axis=None, kind="stable")[:_LOOKED_AT]
    chosen: list[tuple[int, int, int]] = []
    spare: list[tuple[int, int, int]] = []
    for s, r, p in np.stack(np.unravel_index(order, scores.shape), axis=1).tolist():
        alike = [
            (q, o) for t, q, o in [*chosen, *spare] if shapes[s].posture == shapes[t].posture
            and np.linalg.norm(places[p] - places[o]) < _APART_M
        ]  # fmt: skip
        if any(turned_by(rotations[r], rotations[q]) < _APART_RAD for q, _ in alike):
            continue
        here = sum(np.linalg.norm(places[p] - places[o]) < PLACE_M for _, _, o in chosen)
        shared = within is None and 2 * here >= most  # around a known place there is but one
        (spare if shared else chosen).append((s, r, p))
        if len(chosen) == most:
            break
    kept = [
        Candidate(
            shapes[s].model,
            shapes[s].params_at(rotations[r], places[p]),
            float(scores[s, r, p]),
            f"rigid grid, {shapes[s].posture}",
            shapes[s],
        )
        for s, r, p in [*chosen, *spare][:most]
    ]
    return sorted(kept, key=lambda candidate: candidate.cost)
