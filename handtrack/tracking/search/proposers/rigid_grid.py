"""A grid of rigid hands over what was seen: every turn, every place, some postures."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from handtrack.arrays import D3, Array, Floats, Ints, N
from handtrack.sampling.hypotheses import apart
from handtrack.tracking.search.engine import Candidate
from handtrack.tracking.search.evidence.hand_shapes import HandShape
from handtrack.tracking.search.evidence.source import EvidenceSource
from handtrack.tracking.search.proposers.orientation_grid import spread_rotations, turned_by

_FEW_ROTATIONS, _ROTATIONS = 120, 700
"""to find out where a hand may be, and how it is turned there (25° from the nearest on average)"""
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
    s, r, p = np.unravel_index(order, scores.shape)
    posture = np.array([shape.posture for shape in shapes])[s]
    turn, place = rotations[r], places[p]

    def is_far(a: int, rest: Ints) -> Array:
        away = np.linalg.norm(place[rest] - place[a], axis=1) >= _APART_M
        turned = turned_by(turn[rest], turn[a]) >= _APART_RAD
        return (posture[rest] != posture[a]) | away | turned

    share = 0.5 if within is None else 1.0  # around a known place there is but one
    rows = spread_over_places(apart(range(len(order)), is_far), place, most, share)
    kept = [
        Candidate(
            shapes[s[n]].model,
            shapes[s[n]].params_at(turn[n], place[n]),
            float(scores[s[n], r[n], p[n]]),
            f"rigid grid, {posture[n]}",
            shapes[s[n]],
        )
        for n in rows
    ]
    return sorted(kept, key=lambda candidate: candidate.cost)


def spread_over_places(
    rows: Iterable[int], places: Floats[N, D3], most: int, share: float = 0.5
) -> list[int]:
    """Return at most `most` of the rows, the best first: no place takes more than a share of them while others are left.

    places: (N, 3) of a palm's middle, for each row [m].
    """
    chosen: list[int] = []
    spare: list[int] = []
    for row in rows:
        here = (np.linalg.norm(places[chosen] - places[row], axis=1) < PLACE_M).sum()
        (chosen if here < share * most else spare).append(row)
        if len(chosen) == most:
            break
    return [*chosen, *spare][:most]
