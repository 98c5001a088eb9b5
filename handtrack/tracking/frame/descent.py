"""From starts to minima: the schedule of one start, and many starts at once where only keypoints are seen; and minima that look the same to
the only camera: limbs and fingers flipped along its lines of sight.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from handtrack.arrays import D3, Floats, J, K, N, P
from handtrack.geometry.camera import Camera
from handtrack.model.articulated import ArticulatedModel
from handtrack.observation.pins import ImagePins
from handtrack.sampling.chains import chains_of
from handtrack.sampling.interpretation_tree import chain_flips
from handtrack.sampling.polish import polish
from handtrack.sampling.suppression import apart
from handtrack.solver.levenberg_marquardt import SolveSummary, solve
from handtrack.solver.problem import Problem
from handtrack.tracking.frame.control import Watch
from handtrack.tracking.frame.frame_terms import FrameTerms

_WIDE_GAIN, LAST_GAIN = 0.5, 0.01
"""what a step must gain for another to follow. Costs are negative log-likelihoods: a stage that hands over a start ends by a step that moves
no more than one standard deviation, ½; the last one by a seventh of it. Of three cameras' masks, clouds and stereo 0.6 to 0.8 of the
evaluations are left of those to the last digit, and the mean error is within 0.08 mm, both ways"""


def stage_problem(terms: FrameTerms, params: Floats[P], stage: int | None = None) -> Problem:
    """Return the problem of one stage of the schedule, the last unless given; bands are frozen at params."""
    model, free = terms.model, terms.settings.solver.limits == "none"
    return Problem(model, terms.stage(model.bones(params), stage), terms.priors, unlimited=free)


def descend(
    terms: FrameTerms,
    params: Floats[P],
    should_stop: Callable[[], bool] | None = None,
    on_iteration: Watch | None = None,
) -> tuple[SolveSummary, Problem]:
    """Run the schedule: wide bands first, each from where the one before ended. Return where it ended, the iterations of all stages
    counted, and the last stage's problem.
    """
    settings, likelihoods, done = terms.settings.solver, not terms.settings.traits.plain_sums, 0
    for stage in range(terms.stages):
        share = max((settings.iterations - done) // (terms.stages - stage), 1)
        problem = stage_problem(terms, params, stage)

        def watch(k: int, x: Floats, cost: float, before: int = done) -> None:
            if on_iteration is not None:
                on_iteration(before + k, x, cost)

        gain = _WIDE_GAIN if stage + 1 < terms.stages else LAST_GAIN
        stage_settings = replace(settings, iterations=share, least_gain=gain * likelihoods)
        summary = solve(problem, params, stage_settings, should_stop, watch)
        params, done = summary.params, done + summary.iterations
        if summary.why == "stopped":
            break
    return replace(summary, iterations=done), problem


def by_keypoints_alone(terms: FrameTerms) -> bool:
    """Return whether keypoints are all that a frame is solved by, so that many starts can be polished at once."""
    plain = all(term.weight == 1.0 for term in terms.keypoints)
    own = terms.observation.terms or terms.observation.priors
    others = terms.views or terms.pins or own
    return plain and bool(terms.keypoints) and not others


def minima(
    terms: FrameTerms,
    starts: Floats[N, P],
    most: int,
    should_stop: Callable[[], bool] | None = None,
    is_far: bool = False,
) -> tuple[Floats[N, P], Floats[N], Floats[N, P, P]]:
    """Return the minima that starts lead to: solver parameters; costs, infinite where a start led nowhere; Gauss-Newton matrices.

    Keypoints alone: of all starts; otherwise of the `most` cheapest.

    Parameters
    ----------
    is_far
        The starts may need many iterations, as in a first frame.
    """
    if by_keypoints_alone(terms):
        seen = [t.observed for t in terms.keypoints if not isinstance(t.observed, ImagePins)]
        ended = polish(
            terms.model,
            starts,
            seen,
            terms.priors,
            terms.wide().keypoints[0].loss,
            iterations=200 if is_far else 30,
            tolerance=1e-3,
        )
        return ended.params, ended.cost, ended.normal
    if len(starts) > most:
        costs = [stage_problem(terms, x, 0).cost(x) for x in starts]
        starts = starts[np.argsort(costs, kind="stable")[:most]]
    found: list[SolveSummary] = []
    for start in starts:
        found.append(descend(terms, start, should_stop)[0])
        if found[-1].why == "stopped":
            break
    return (
        np.array([one.params for one in found]),
        np.array([one.cost for one in found]),
        np.array([one.system.hessian for one in found]),
    )


# ---- flips in depth

_APART_SHARE = 0.025
"""two minima are one whose joints are all nearer, as a share of the model's greatest extent: of a body 4 cm, of a hand 5 mm"""


def mirrored_covariance(terms: FrameTerms, params: Floats[P]) -> Floats[J, D3, D3]:
    """Return what flips in depth add to each joint's covariance [m²]: Σ P · d dᵀ, d from the pose to the flip; zero where more than one
    camera saw anything, or there is a cloud, and unless joints in an image are all that was seen zero for hands.

    Where the limb was before tells nothing: it was as ambiguous there. Each limb flips on its own; its flips descend
    together, and count by their masses (Laplace) beside the pose's own. Masks, edges and texture are not asked, which would take
    a descent by images each: a limb's outline is nearly that of its flip, and of these what is known of poses beforehand decides.
    """
    model = terms.model
    found = np.zeros((len(model.joint_names), 3, 3))
    by_joints, by_image = only_camera(terms), _only_view(terms)
    camera = by_joints or by_image
    if camera is None:
        return found
    flips = list(flips_of_limbs(model, params, camera).values())
    starts = np.concatenate([params[None], *flips])
    if by_joints is not None:
        poses, costs, normal = minima(terms.without_motion(), starts, len(starts))
    else:
        known = Problem(model, (), terms.without_motion().priors)
        poses, costs = starts, np.array([known.cost(start) for start in starts])
        normal = np.tile(np.eye(len(params)), (len(starts), 1, 1))
    places = np.stack([model.joint_positions(model.bones(pose)) for pose in poses])
    mass = -costs - 0.5 * np.linalg.slogdet(normal)[1]
    here = model.joint_positions(model.bones(params))
    far_m = apart_m(here)
    if not np.isfinite(mass[0]):
        return found
    limb = np.repeat(np.arange(len(flips)), [len(rows) for rows in flips]) + 1
    for one in range(1, len(flips) + 1):
        others = 1 + np.flatnonzero((limb == one) & np.isfinite(mass[1:]))
        heaviest = others[np.argsort(-mass[others], kind="stable")].tolist()
        rows = list(
            apart(
                [0, *heaviest],
                lambda a, rest: (
                    np.linalg.norm(places[rest] - places[a], axis=2).max(axis=1) > far_m
                ),
            )
        )
        share = np.exp(mass[rows] - mass[rows].max())
        off = places[rows[1:]] - here
        found += np.einsum("k,kja,kjb->jab", share[1:] / share.sum(), off, off)
    return found


def apart_m(places: Floats[J, D3]) -> float:
    """Return how near all joints of two minima are that are one [m]; places: a pose's joints."""
    return _APART_SHARE * float(np.linalg.norm(np.ptp(places, axis=0)))


def only_camera(terms: FrameTerms) -> Camera | None:
    """Return the camera whose joints are all that was seen; None where it is not the only one."""
    return _only_one(terms, []) if by_keypoints_alone(terms) else None


def _only_view(terms: FrameTerms) -> Camera | None:
    """Return the camera whose mask or image is all that was seen of a body, its joints aside; None where there is more."""
    if terms.model.kind != "body" or terms.cloud is not None or not terms.views:
        return None
    cameras = [seen.camera for seen in (*terms.prepared, *terms.images)]
    return _only_one(terms, cameras)


def _only_one(terms: FrameTerms, cameras: Sequence[Camera]) -> Camera | None:
    """Return the only one of these cameras and those of joints; None where there are several, or joints in space."""
    seen = [*cameras, *(points.camera for _, points in terms.detected)]
    is_one = len({camera.name for camera in seen}) == 1
    return seen[0] if is_one and len(terms.detected) == len(terms.keypoints) else None


def flips_of_limbs(
    model: ArticulatedModel, params: Floats[P], camera: Camera
) -> dict[str, Floats[K, P]]:
    """Return by limb the poses in which it alone is flipped along a camera's lines of sight, within limits."""
    return {c.name: chain_flips(model, params, c, camera) for c in chains_of(model)}
