"""A hand from joints seen in images: flips in depth are not settled by one camera, so all that may be are returned."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from handtrack.arrays import Floats
from handtrack.errors import HandtrackError
from handtrack.geometry.rotation import rotation_vector
from handtrack.model.articulated import ArticulatedModel, keypoint_names
from handtrack.model.pose_library import named_pose
from handtrack.observation.observation import ImageKeypoints
from handtrack.sampling.chains import chains_of, prepare
from handtrack.sampling.hypotheses import Hypothesis, distinct
from handtrack.sampling.interpretation_tree import TreeSettings, interpretation_tree
from handtrack.sampling.polish import PolishSettings, polish
from handtrack.terms.loss import GemanMcClure
from handtrack.terms.priors import GaussianPrior
from handtrack.terms.term import ParameterTerm
from handtrack.tracking.frame.posture import posture_prior
from handtrack.tracking.search.orientation_grid import spread_rotations

_FEWEST = 4  # joints seen in a camera; fewer leave the hand's place open
_POSTURES, _ROTATIONS = ("open", "rest", "curl", "fist"), 300
_POLISHED, _FLIPPED, _KEPT = 48, 6, 8
_ROBUST_SIGMAS = 4.0
_REST_SIGMA = np.deg2rad(40.0)
_ALIKE_RAD = 0.15
_NEAREST_M, _FARTHEST_M = 0.08, 20.0  # of a palm from a camera
_LEAST_ANGLE = np.deg2rad(2.0)  # between two lines of sight, for a point in space
# of a line of sight from a point, beyond which it is no view of it: px, of the image
_OFF_PX, _OFF_SHARE = (25.0, 0.04)


def triangulated(seen: Sequence[ImageKeypoints]) -> Floats:
    """Return the 21 points in space (21, 3), world [m], that at least two cameras agree on; NaN for the others.

    Least squares over the lines of sight; the worst line is dropped while more than two are left and it misses the
    point by far.
    """
    points = np.full((len(keypoint_names()), 3), np.nan)
    for row, name in enumerate(keypoint_names()):
        views = [(s.camera, s.pixels[s.names.index(name)]) for s in seen if name in s.names]
        views = [(camera, pixel) for camera, pixel in views if np.isfinite(pixel).all()]
        while len(views) >= 2:
            ways = np.stack([camera.rays(pixel) for camera, pixel in views])
            if np.max(np.arccos(np.clip(ways @ ways.T, -1.0, 1.0))) < _LEAST_ANGLE:
                break
            across = np.eye(3) - ways[:, :, None] * ways[:, None, :]
            centres = np.stack([camera.centre for camera, _ in views])
            point = np.linalg.solve(across.sum(axis=0), np.einsum("nij,nj->i", across, centres))
            off = [
                float(np.linalg.norm(camera.project(point) - pixel)) / _allowed(camera.size)
                for camera, pixel in views
            ]
            if np.nanmax(off) <= 1.0 and np.isfinite(off).all():
                points[row] = point
                break
            if len(views) == 2:
                break
            views.pop(int(np.argmax(np.nan_to_num(off, nan=np.inf))))
    return points


def hands_from_images(
    model: ArticulatedModel, seen: Sequence[ImageKeypoints]
) -> tuple[Hypothesis, ...]:
    """Return the hands (P,) that explain joints seen in one or more undistorted images, the best first.

    Laid at many turns and postures where the joints are seen, polished, then each finger of the best flipped forwards
    and backwards along the lines of sight and polished again. The weights are shares of exp(−cost).
    Raises HandtrackError where too few joints are seen.
    """
    most = max(seen, key=lambda s: int(np.isfinite(s.pixels).all(axis=1).sum()), default=None)
    count = 0 if most is None else int(np.isfinite(most.pixels).all(axis=1).sum())
    if most is None or count < _FEWEST:
        raise HandtrackError(
            f"first-frame pose: {count} joints are seen in one image, at least {_FEWEST} are needed to place the hand. "
            "Add points, or pose the hand by parameters."
        )
    priors = _priors(model)
    loss, quick = (
        GemanMcClure(_ROBUST_SIGMAS),
        PolishSettings(iterations=40, gradient_tolerance=1e-3),
    )
    starts, rough = _laid(model, most)
    starts = starts[np.argsort(rough, kind="stable")[:_POLISHED]]
    found = polish(model, starts, seen, priors, loss, settings=quick)
    best = found.params[distinct(found.params, found.cost, _ALIKE_RAD)[:_FLIPPED]]
    flipped = [flip for params in best for flip in _flips(model, params, most)]
    again = polish(model, np.concatenate([best, *flipped]), seen, priors, loss, settings=quick)
    chosen = distinct(again.params, again.cost, _ALIKE_RAD)[:_KEPT]
    chosen = chosen[np.isfinite(again.cost[chosen])]
    weight = np.exp(again.cost[chosen].min() - again.cost[chosen])
    weight /= weight.sum()
    return tuple(
        Hypothesis(again.params[i], float(again.cost[i]), np.linalg.pinv(again.normal[i]), float(w), "image joints")
        for i, w in zip(chosen, weight, strict=True)
    )  # fmt: skip


def _allowed(size: tuple[int, int]) -> float:
    """Return how far a line of sight may miss a point [px]: detectors err in shares of the image."""
    return max(_OFF_PX, _OFF_SHARE * max(size))


def _priors(model: ArticulatedModel) -> list[ParameterTerm]:
    sigma = np.full(len(model.parameter_names), _REST_SIGMA)
    sigma[:6] = np.inf
    priors: list[ParameterTerm] = [GaussianPrior(model.rest, sigma, "rest")]
    together = posture_prior(model, 1.0)
    if together is not None:
        priors.append(together)
    return priors


def _laid(model: ArticulatedModel, seen: ImageKeypoints) -> tuple[Floats, Floats]:
    """Return starts (N, P) before a camera, and how far off the joints are there (N,) [px].

    For a turn and a posture, the place is the least squares solution of the projection's equations, which are linear
    in it.
    """
    camera = seen.camera
    known = np.asarray(np.isfinite(seen.pixels).all(axis=1))
    rays = (seen.pixels[known] - camera.matrix[:2, 2]) / np.diag(camera.matrix)[:2]
    index = [model.joint_names.index(n) for n, k in zip(seen.names, known, strict=True) if k]
    rotations = spread_rotations(_ROTATIONS)
    starts, costs = [], []
    for posture in _POSTURES:
        joint = named_pose(model, posture)
        bones = model.bones(model.transform.solver_params(joint))
        shape = model.joint_positions(bones)[index] - joint[:3]
        turned = np.einsum("ij,rjk,nk->rni", camera.rotation, rotations, shape)
        for rotation, points in zip(rotations, turned, strict=True):
            rows = np.zeros((len(points), 2, 3))
            rows[:, 0, 0] = rows[:, 1, 1] = 1.0
            rows[:, :, 2] = -rays
            right = rays * points[:, 2:] - points[:, :2]
            place = np.linalg.lstsq(rows.reshape(-1, 3), right.ravel(), rcond=None)[0]
            there = points + place
            if not _NEAREST_M < np.median(there[:, 2]) < _FARTHEST_M or there[:, 2].min() < 0.02:
                continue
            off = (there[:, :2] / there[:, 2:] - rays) * np.diag(camera.matrix)[:2]
            joint[3:6] = rotation_vector(rotation)
            joint[:3] = camera.rotation.T @ (place - camera.translation)
            starts.append(model.clipped(model.transform.solver_params(joint)))
            costs.append(float((off**2).sum()))
    if not starts:
        raise HandtrackError(
            f"first-frame pose: the joints seen by camera '{camera.name}' cannot be a hand's before it. Are they in "
            "pixels of the image as it was taken, in OpenPose's order?"
        )
    return np.array(starts), np.array(costs)


def _flips(model: ArticulatedModel, params: Floats, seen: ImageKeypoints) -> list[Floats]:
    """Return for each finger the poses (L, P) that look the same with its links bent the other way."""
    settings = TreeSettings(failing="nearest")
    return [
        interpretation_tree(model, params, [prepare(model, chain)], seen.camera, settings=settings).params
        for chain in chains_of(model)
    ]  # fmt: skip
