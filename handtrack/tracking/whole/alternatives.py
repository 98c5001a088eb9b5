"""Alternative poses of frames, by the other trajectories of a recording, and low confidence where they are elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import islice

import numpy as np

from handtrack.arrays import Array, Floats, Ints, K, P
from handtrack.model.articulated import ArticulatedModel
from handtrack.sampling.suppression import apart
from handtrack.tracking.frame import confidence
from handtrack.tracking.frame.confidence import BODY_OFF_M, FRAME_OFF_M, part_of, with_paths
from handtrack.tracking.frame.constants import APART_MM
from handtrack.tracking.frame.reason import Reason
from handtrack.tracking.frame.result import PARTS, Alternative, FrameResult, Status
from handtrack.tracking.size.estimate import WholeEstimate
from handtrack.tracking.whole.mode_search import APART_M, Trellis

_LEAST = 0.03
"""probability below which an alternative is left out"""


def with_alternatives(
    model: ArticulatedModel,
    results: Sequence[FrameResult],
    trellis: Trellis,
    shown: int = 1,
    refined: Sequence[tuple[WholeEstimate, float]] = (),
) -> list[FrameResult]:
    """Return refined frames with the other poses that all frames together leave open, the most
    probable first, behind the frame's own.

    What is stated contains them.

    Parameters
    ----------
    trellis
        On whose Viterbi path the frames were refined.
    shown
        How many poses a frame has that were asked for, however probable: such as differ in shape
        come first.
    refined
        Trajectories that were refined as a whole and how probable each is, the frames' own first, the others
        are what is shown.
    """

    def other(pose: Floats[P], cost: float, weight: float, origin: str) -> Alternative:
        return Alternative(model.joint_params(pose), float(cost), float(weight), -1, origin)

    found = []
    several = len(refined) > 1
    rows = zip(results, trellis.minima, trellis.probabilities, trellis.best.tolist(), strict=True)
    for n, (result, minima, share, own) in enumerate(rows):
        poses = [m.pose for m in minima]
        others = _shown(model, result, poses, share, own, 0 if several else shown - 1)
        known = [
            other(minima[k].pose, minima[k].system.cost, share[k], minima[k].origin) for k in others
        ]
        weight = float(share[own])
        result = _doubted(model, result, weight, known) if known else result
        if several:
            weight = refined[0][1]
            known = [other(one.poses[n], one.costs[n], w, one.origin) for one, w in refined[1:]]
        held = Alternative(result.parameters, result.energy, weight, -1, "refined")
        found.append(replace(result, alternatives=(held, *known)) if known else result)
    return found


def _shown(
    model: ArticulatedModel,
    result: FrameResult,
    poses: Sequence[Floats[P]],
    share: Floats[K],
    own: int,
    most: int,
) -> list[int]:
    """Return which of a frame's minima stay with it, the most probable first: so many that differ in shape from it and from each
    other, as the hypotheses that are shown do, and those above `_LEAST`.
    """
    order = [k for k in np.argsort(-share, kind="stable").tolist() if k != own]
    kept: list[int] = []
    if most > 0:
        places = [result.joint_positions]
        places += [model.joint_positions(model.bones(poses[k])) for k in order]
        shapes = np.array([here - here[0] for here in places])

        def differ(row: int, others: Ints) -> Array:
            return (
                np.linalg.norm(shapes[others] - shapes[row], axis=2).mean(axis=1) >= 1e-3 * APART_MM
            )

        differing = islice(apart(range(len(shapes)), differ), 1, 1 + most)
        kept = [order[row - 1] for row in differing]
    more = [k for n, k in enumerate(order) if share[k] > _LEAST or n < most - len(kept)]
    return kept + [k for k in more if k not in kept]


def _doubted(
    model: ArticulatedModel, result: FrameResult, own: float, others: Sequence[Alternative]
) -> FrameResult:
    """Return a frame whose stated covariance and probability contain the alternatives. own: how probable its own pose is.

    Of a joint, alternatives that leave it where it is say nothing: P = w / (w of its own pose and of those that move it).
    """
    poses = [model.bones(model.solver_params(one.parameters)) for one in others]
    off = np.array([model.joint_positions(bones) for bones in poses]) - result.joint_positions
    far_m = np.linalg.norm(off, axis=2)
    weight = np.array([one.weight for one in others])[:, None] * (far_m > APART_M)
    # of a pose that all frames call impossible a joint may be where all others have it, too
    share = weight / np.maximum(own + weight.sum(axis=0), np.finfo(float).tiny)
    covariance = result.joint_covariance + np.einsum("kj,kja,kjb->jab", share, off, off)

    def elsewhere(joints: Array, beyond_m: float) -> float:
        """Return how probably one of some joints is further off than that."""
        far, of_joint = far_m[:, joints], share[:, joints]
        farthest = of_joint[np.arange(len(others)), far.argmax(axis=1)]
        return min(float(farthest[far.max(axis=1) > beyond_m].sum()), 1.0)

    is_body = model.kind == "body"
    off_frame = elsewhere(np.ones(far_m.shape[1], bool), BODY_OFF_M if is_body else FRAME_OFF_M)
    off_25, off_10 = result.p_off_25mm, result.p_off_10mm
    if is_body:
        off_25 = 1.0 - (1.0 - off_25) * (1.0 - off_frame)
    elif off_10 is not None:
        part = np.array([part_of(name) for name in model.joint_names])
        other = [off_frame, *(elsewhere(part == one, APART_M) for one in PARTS)]
        off_25, *off_10 = with_paths(np.array([off_25, *off_10]), np.array(other)).tolist()
        off_10 = np.array(off_10)
    result = replace(result, joint_covariance=covariance, p_off_25mm=off_25, p_off_10mm=off_10)
    told = off_frame if is_body or np.isnan(off_25) else off_25
    if result.status != Status.TRACKED or not off_frame or told * confidence.MISSED <= 1.0:
        return result
    hypothesis, joint = np.unravel_index(int((weight * far_m).argmax()), far_m.shape)
    name = model.joint_names[joint].replace("_", " ")
    why = Reason("other way", name, number=off_frame, other=1e3 * float(far_m[hypothesis, joint]))
    return replace(result, status=Status.DOUBTFUL, reason=why)
