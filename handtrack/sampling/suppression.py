"""Non-maximum suppression: which of many poses stand for all; near-equal ones count once."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import numpy as np

from handtrack.arrays import D3, Array, Floats, Ints, J, K, N, P
from handtrack.geometry.rotation import rotation_matrix

MERGED_RAD = 0.1
"""two minima closer than this, root mean square over all angles, count as one"""


def angle_distance(params: Floats[P], others: Floats[N, P]) -> Floats[N]:
    """Return the root mean square difference [rad] of all angles between params and each of others.

    The root's three count as one turn: the angle from one attitude to the other, so that rotation vectors of the same
    attitude (2π apart) are at no distance. Translations do not count.
    """
    others = np.atleast_2d(others)
    hinges = ((others[:, 6:] - params[6:]) ** 2).sum(axis=1)
    between = rotation_matrix(params[3:6]).T @ rotation_matrix(others[:, 3:6])
    # from both sine and cosine: the cosine alone cannot tell small angles from rounding
    sine = 0.5 * np.linalg.norm(
        np.stack([between[:, i, j] - between[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))]), axis=0
    )
    turn = np.arctan2(sine, 0.5 * (np.trace(between, axis1=1, axis2=2) - 1.0))
    return np.sqrt((hinges + turn**2) / (len(params) - 3))


def apart(rows: Iterable[int], is_far: Callable[[int, Ints[N]], Array[N]]) -> Iterator[int]:
    """Yield the rows that stand for all: each, the best first, that is far from every better one
    yielded.

    Parameters
    ----------
    is_far
        Tells for a row and others (N,) which of them (N,) are far from it.
    """
    left = np.fromiter(rows, dtype=int)
    while len(left):
        best, left = int(left[0]), left[1:]
        yield best
        left = left[is_far(best, left)] if len(left) else left


def apart_joints(rows: Iterable[int], joints: Floats[N, J, D3], least_m: float) -> Iterator[int]:
    """Yield the rows that stand for all poses, whose joints are at least so far from those of every better one, on average."""
    return apart(
        rows,
        lambda a, rest: np.linalg.norm(joints[rest] - joints[a], axis=2).mean(axis=1) >= least_m,
    )


def distinct(params: Floats[N, P], costs: Floats[N], threshold_rad: float = MERGED_RAD) -> Ints[K]:
    """Return the indices of rows of params (N, P) that stand for all: best first, none within the threshold of a better."""

    def is_far(row: int, others: Ints) -> Array:
        return angle_distance(params[row], params[others]) > threshold_rad

    return np.fromiter(apart(np.argsort(costs, kind="stable"), is_far), dtype=int)
