"""After tracking with hypotheses: the line of poses that led to the best of the last frame, and that line smoothed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from handtrack.arrays import F, Floats, Ints, P
from handtrack.geometry.rotation import (
    left_jacobian,
    rotation_matrix,
    rotation_vector,
    wrapped,
)
from handtrack.model.articulated import ArticulatedModel
from handtrack.tracking.frame.result import FrameResult
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.hypotheses.mixture import MixtureStep
from handtrack.tracking.hypotheses.moving_hypothesis import MovingHypothesis

Carried = tuple[FrameResult, tuple[MovingHypothesis, ...]]
"""a frame's result, and the hypotheses that the state carried on from it"""


def chosen_sequence(
    model: ArticulatedModel, settings: TrackerSettings, carried: Sequence[Carried]
) -> list[FrameResult]:
    """Return the results, in tracking order, with the poses that `mixture.sequence` asks for; unchanged for `best`."""
    results = [result for result, _ in carried]
    known = [n for n, result in enumerate(results) if result.alternatives]
    if settings.mixture.sequence == "best" or not known:
        return results
    path = lineage([carried[n] for n in known])
    poses = [hypothesis.params for hypothesis in path]
    if settings.mixture.sequence == "smooth":
        numbers = np.array([results[n].frame for n in known])
        push = MixtureStep(model, settings, ()).speed_of_change()
        poses = list(smoothed(model, path, numbers, push))
    for n, pose in zip(known, poses, strict=True):
        results[n] = _posed(model, results[n], pose)
    return results


def lineage(carried: Sequence[Carried]) -> list[MovingHypothesis]:
    """Return the hypothesis of each frame that the last frame's heaviest descends from.

    What came later decides between what looked alike: lines that led nowhere have died out.
    """
    path: list[MovingHypothesis] = []
    number = 0
    for result, hypotheses in reversed(carried):
        path.append(hypotheses[number])
        number = max(result.alternatives[number].parent, 0)
    return path[::-1]


def smoothed(
    model: ArticulatedModel,
    path: Sequence[MovingHypothesis],
    frames: Ints[F],
    push: Floats[P],
) -> Floats[F, P]:
    """Return poses that weigh what was seen against steady motion: one Gauss-Newton step on the whole path.

    Minimises Σ (what each frame's observations cost, to second order) + ½ Σ |(x₊ − 2x + x₋)/push|², push the unknown
    acceleration a frame. Across jumps and missing frames nothing is smoothed. 2003 paper, §5.2, left it out.
    """
    from scipy.linalg import solveh_banded

    x = np.array([hypothesis.params for hypothesis in path])
    turns = rotation_matrix(x[:, 3:6])
    jumped = [hypothesis.origin.endswith("jumped") for hypothesis in path]
    count, size = x.shape
    band = np.zeros((3 * size, count * size))  # lower form: band[k, c] is row c + k of column c
    right = np.zeros((count, size))
    for n, hypothesis in enumerate(path):
        # the root's turn is changed by a small turn in world axes, whatever vector it is written as
        change = np.eye(size)
        change[3:6, 3:6] = np.linalg.inv(left_jacobian(x[n, 3:6]))
        block = change.T @ hypothesis.seen.hessian @ change
        for column in range(size):
            band[: size - column, n * size + column] += block[column:, column]
        right[n] -= change.T @ hypothesis.seen.gradient
    steady = 1.0 / push**2
    weights = np.array([1.0, -2.0, 1.0])
    for n in range(1, count - 1):
        gaps = np.diff(frames[n - 1 : n + 2])
        if jumped[n] or jumped[n + 1] or gaps[0] != gaps[1]:
            continue
        bend = weights @ x[n - 1 : n + 2]
        spin, earlier = turns[n + 1] @ turns[n].T, turns[n] @ turns[n - 1].T
        bend[3:6] = rotation_vector(spin) - rotation_vector(earlier)
        for a in range(3):
            right[n - 1 + a] -= weights[a] * steady * bend
            for b in range(a + 1):
                columns = (n - 1 + b) * size + np.arange(size)
                band[(a - b) * size, columns] += weights[a] * weights[b] * steady
    band[0] += 1e-9 * (1.0 + band[0])
    step = solveh_banded(band, right.ravel(), lower=True).reshape(count, size)
    moved = x + step
    moved[:, 3:6] = rotation_vector(rotation_matrix(step[:, 3:6]) @ turns)
    return np.array([model.clipped(row) for row in moved])


def _posed(model: ArticulatedModel, result: FrameResult, params: Floats) -> FrameResult:
    joint = model.joint_params(params)
    joint[3:6] = wrapped(joint[3:6])
    bones = model.bones(params)
    return replace(
        result,
        parameters=joint,
        T_world_bone=bones.T_world_bone,
        joint_positions=model.joint_positions(bones),
        keypoints21=model.keypoints21(bones) if model.has_keypoints21 else None,
    )
