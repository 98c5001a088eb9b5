"""Fingers put elsewhere: one over its whole range, or all shifted by one, where they may have been lost."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice, pairwise, product

import numpy as np

from handtrack.arrays import Floats, P, S
from handtrack.model.articulated import FINGERS, ArticulatedModel
from handtrack.parallel import in_parallel
from handtrack.sampling.hypotheses import apart
from handtrack.solver.problem import Problem

# Shares of the joints' ranges that are tried: base flexion, abduction, and curl of the two joints after.
_FLEX, _SPREAD, _CURL = (0.2, 0.4, 0.6, 0.85), (0.2, 0.5, 0.8), (0.1, 0.4, 0.75)
_PLACES = 2  # of a finger that may be tried
_ELSEWHERE_M = 0.02  # between fingertips: nearer places lead to the same


def finger_grid(far: Problem, params: Floats[P], most: int) -> list[tuple[str, Floats[P]]]:
    """Return the `most` promising starts (P,), the best first: each with one finger, named, well away from where it is.

    far: sees missed silhouette from afar (the widest band); it ranks the places that a finger is put to.

    They may cost more than the pose that stands: put anywhere on a grid, a finger covers little of its own silhouette,
    but the one that is lost loses least where it was. No two of a finger are near each other: one of them may lead back.
    """
    model = far.model
    best: list[tuple[float, str, Floats]] = []
    for finger in FINGERS:
        starts = list(_placements(model, params, finger))
        placed = list(zip(in_parallel(far.cost, starts), starts, strict=True))
        if not placed:
            continue
        places = [(0.0, params), *sorted(placed, key=lambda pair: pair[0])]
        tip = model.joint_names.index(f"{finger}_tip")
        tips = np.array([model.joint_positions(model.bones(start))[tip] for _, start in places])
        elsewhere = apart(
            range(len(places)),
            lambda a, rest, tips=tips: np.linalg.norm(tips[rest] - tips[a], axis=1) > _ELSEWHERE_M,
        )
        best += [(places[n][0], finger, places[n][1]) for n in islice(elsewhere, 1, 1 + _PLACES)]
    return [(finger, start) for _, finger, start in sorted(best, key=lambda row: row[0])[:most]]


def finger_shifts(model: ArticulatedModel, params: Floats[P]) -> list[Floats[P]]:
    """Return solver parameters with all fingers shifted by one, either way (2004 paper, section 4): the way out when all are.

    The palm moves sideways by the distance of two knuckles, so that every finger stands where its neighbour was; once with
    the fingers bent as they are, once each as that neighbour is: what was seen there then still has its finger.
    """
    if not {"index_mcp", "middle_mcp"} <= set(model.joint_names):
        return []
    bones = model.bones(params)
    places = model.joint_positions(bones)
    index, middle = (places[model.joint_names.index(name)] for name in ("index_mcp", "middle_mcp"))
    sideways = bones.rotation[0][:, 0] * float(np.linalg.norm(middle - index))
    starts = []
    for side in (-1.0, 1.0):
        joint = model.joint_params(params)
        joint[:3] += side * sideways * (1.0 if model.side == "right" else -1.0)
        for posture in (handed_on(model, joint, side), joint):
            starts.append(model.clipped(model.transform.solver_params(posture)))
    return starts


def handed_on(model: ArticulatedModel, joint: Floats[S], side: float) -> Floats[S]:
    """Return joint parameters in which each finger is bent as its neighbour was; side 1: on the little's side."""
    four = FINGERS[1:] if side > 0 else FINGERS[:0:-1]
    moved = joint.copy()
    for finger, other in pairwise(four):
        for bend in ("mcp_flex", "pip_flex", "dip_flex"):
            at, there = (model.skeleton.parameter(f"{f}_{bend}") for f in (finger, other))
            moved[at] = joint[there]
    return moved


def _placements(model: ArticulatedModel, params: Floats, finger: str) -> Iterator[Floats]:
    """Yield params with one finger put everywhere in its range."""
    base = "cmc" if finger == "thumb" else "mcp"
    after = ("mcp", "ip") if finger == "thumb" else ("pip", "dip")
    names = [
        f"{finger}_{base}_flex",
        f"{finger}_{base}_abd",
        *(f"{finger}_{j}_flex" for j in after),
    ]
    if any(name not in model.parameter_names for name in names):
        return
    at = [model.skeleton.parameter(name) for name in names]
    joint = model.joint_params(params)
    for flex, spread, curl in product(_FLEX, _SPREAD, _CURL):
        trial = joint.copy()
        low, high = model.limits.bounds(trial)[at].T
        trial[at] = low + np.array([flex, spread, curl, curl]) * (high - low)
        yield model.clipped(model.transform.solver_params(trial))
