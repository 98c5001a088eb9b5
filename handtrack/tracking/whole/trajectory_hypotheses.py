"""Several trajectories of a recording, each refined by all frames: limbs flipped in depth throughout."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from handtrack.arrays import Array, F, Floats, Ints, K, N, P
from handtrack.geometry.camera import Camera
from handtrack.model.articulated import ArticulatedModel
from handtrack.sampling.suppression import apart
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.descent import apart_m, flips_of_limbs, only_camera
from handtrack.tracking.size.estimate import WholeEstimate, estimate_whole
from handtrack.tracking.whole.likelihood import RecordingLikelihood

_SWEEPS = 6
"""of hypotheses beside the best: they show which is better, and what else it may be"""
_WIDTH, _ROUNDS = 3, 3
"""hypotheses that are flipped on, the best; limbs that may be flipped together. A flip may cost more before another limb is flipped, too:
of a real person the best hypothesis was two such steps away in one camera of four (docs/reports/results.md)"""


def trajectory_cost(likelihood: RecordingLikelihood, trajectory: WholeEstimate) -> float:
    """Return by which trajectories are compared: what all frames say, and what is usual of motion."""
    usual = likelihood.usual
    moves = 0.0 if usual is None else usual.cost(trajectory.poses)
    return float(trajectory.costs.sum()) + moves


def trajectory_weights(
    likelihood: RecordingLikelihood, trajectories: Sequence[WholeEstimate]
) -> Floats[K]:
    """Return how probable trajectories are beside one another."""
    costs = np.array([trajectory_cost(likelihood, one) for one in trajectories])
    weights = np.exp(costs.min(initial=np.inf) - costs)
    return weights / weights.sum()


def trajectory_hypotheses(
    likelihood: RecordingLikelihood,
    first: WholeEstimate,
    frames: Sequence[int],
    count: int,
    control: Control = Control(),
) -> list[WholeEstimate]:
    """Return so many hypotheses, the best first, where joints in one camera's image are all that was seen; else the given one alone.

    One camera leaves open on which side of the image plane a limb is, throughout: like the 2003 paper's jumps, but of whole trajectories. How
    far away everything is it leaves open too, about each of them: that is no hypothesis of its own, and the covariance contains it. Fewer
    where there are no more. Raises StoppedError when stopped.
    """
    camera = _camera(likelihood, frames)
    if camera is None or count < 2:
        return [first]
    hypotheses, flipped = [first], list[WholeEstimate]()
    cost = partial(trajectory_cost, likelihood)
    for _ in range(_ROUNDS):
        fresh = [
            hypothesis
            for hypothesis in hypotheses[:_WIDTH]
            if all(hypothesis is not one for one in flipped)
        ]
        for hypothesis in fresh:
            for name, poses in _trials(likelihood.model, hypothesis.poses, camera):
                found = estimate_whole(
                    likelihood, frames, poses, control.should_stop, sweeps=_SWEEPS
                )
                other = replace(found, origin=f"{hypothesis.origin}, {name} flipped")
                ranked = sorted([*hypotheses, other], key=cost)
                hypotheses = _unlike(likelihood.model, ranked)[:count]
        flipped += fresh
        if not fresh:
            break
    return hypotheses


def _camera(likelihood: RecordingLikelihood, frames: Sequence[int]) -> Camera | None:
    """Return the only camera, whose image's joints are all that was seen; None where there is more."""
    found = None
    for frame in frames:
        terms = likelihood.of(frame).terms
        if terms.has_observations:
            camera = only_camera(terms)
            if camera is None or (found is not None and found.name != camera.name):
                return None
            found = camera
    return found


def _trials(
    model: ArticulatedModel, poses: Floats[F, P], camera: Camera
) -> Iterator[tuple[str, Floats[F, P]]]:
    """Yield each limb's name and the poses of all frames in which it is flipped, one trajectory: from the frame where a flip differs most it is
    followed to both sides, to the flip that is nearest. Where the limb lies in the image plane that is the pose itself.
    """
    by_frame = [flips_of_limbs(model, pose, camera) for pose in poses]
    for name in by_frame[0]:
        leaves = [np.concatenate([pose[None], at[name]]) for pose, at in zip(poses, by_frame, strict=True)]  # fmt: skip
        far = [_far(rows, rows[0]).max() for rows in leaves]
        begin = int(np.argmax(far))
        for start in leaves[begin][1:]:
            found = poses.copy()
            for path in (range(begin, len(poses)), range(begin, -1, -1)):
                here = start
                for n in path:
                    here = leaves[n][_far(leaves[n], here).argmin()]
                    found[n] = here
            yield name, found


def _far(rows: Floats[N, P], pose: Floats[P]) -> Floats[N]:
    """Return how far poses are from another, by their joints' angles [rad]."""
    return np.linalg.norm(rows[:, 6:] - pose[6:], axis=1)


def _unlike(model: ArticulatedModel, hypotheses: Sequence[WholeEstimate]) -> list[WholeEstimate]:
    """Return the hypotheses of which no better one is the same: all joints of all frames near each other."""
    places = np.array(
        [[model.joint_positions(model.bones(p)) for p in one.poses] for one in hypotheses]
    )

    def differ(row: int, others: Ints) -> Array:
        moved = np.linalg.norm(places[others] - places[row], axis=3).max(axis=(1, 2))
        return moved > apart_m(places[row, 0])

    return [hypotheses[row] for row in apart(range(len(hypotheses)), differ)]
