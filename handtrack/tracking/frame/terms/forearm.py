"""The forearm: whether one is in view, which way it points, and from where on it does not count."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from handtrack.arrays import D3, Array, Floats, N, P
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.ellipsoids import Ellipsoids
from handtrack.model.kinematics import BonePoses
from handtrack.observation.observation import Observation, PointCloud, Silhouette
from handtrack.solver.problem import Problem

_STEP_M = 0.002
_LOOKED_AT_M = 0.1
_SHOWN_M = 0.02  # of a forearm beside the hand; less tells nothing of where it ends, and hands of 1 cm of arm are tracked better without
_ROUND_M = 0.008  # a visible end is round, or cut at a slant
_HAND_MARGIN = 1.25  # a line of sight that passes an ellipsoid this much larger may show the hand
_USUAL_BEND = np.deg2rad(30.0)
_BEND_COSTS_M = 0.005  # that much less of an arm a straight wrist may explain
_LEAST_PX = 1.0


def forearm_in_view(
    model: ArticulatedModel, posed: Iterable[tuple[Floats[P], Observation]]
) -> float | None:
    """Return how far from the wrist silhouettes show a forearm [m of the mean adult's], the median
    of frames that tell; 0 where it is too little to model, infinite where it goes on beyond what is
    looked at, or a cloud shows one; None where no frame tells.

    Parameters
    ----------
    posed
        What was seen of frames, with the solver parameters of the hand there.
    """
    lengths = []
    for params, seen in posed:
        bones = model.bones(params)
        length = forearm_length(model, bones, seen.silhouettes)
        if seen.cloud is not None:
            in_cloud = _forearm_in_cloud(bones, seen.cloud)
            length = _LOOKED_AT_M if in_cloud else float(np.nan_to_num(length))
        lengths.append(length)
    if np.isnan(lengths).all():
        return None
    length = float(np.nanmedian(lengths))
    if length < _SHOWN_M:
        return 0.0
    goes_on = length > _LOOKED_AT_M - _STEP_M / 2
    return np.inf if goes_on else (length - _ROUND_M) / model.scale.factor("forearm")


def _forearm_in_cloud(bones: BonePoses, cloud: PointCloud) -> bool:
    """Return whether behind the wrist, 2 to 6 cm from it, lie at least a quarter as many points as before it.

    A stretch of wrist before a sleeve is enough: a hand without a forearm would slide back to cover it.
    """
    local = (cloud.points - bones.position[0]) @ bones.rotation[0]
    far = np.linalg.norm(local, axis=1)
    shell = (far > 0.02) & (far < 0.06)
    behind = shell & (local[:, 1] < -0.5 * far)
    return bool(behind.sum() > 0.25 * (shell & (local[:, 1] > 0)).sum() > 0)


def forearm_length(
    model: ArticulatedModel, bones: BonePoses, silhouettes: Sequence[Silhouette]
) -> float:
    """Return how far from the wrist masks show a forearm [m], at most 10 cm; 0 where they show none, NaN where none can tell.

    Follows the axis of a forearm in all directions that a wrist bends to, until it leaves the mask. Only beside the hand
    does a mask tell: an arm before or behind the hand is covered by every mask. The direction that explains most of the
    mask counts, of two that explain as much the straighter wrist; its length is the median of the views that tell.
    """
    bend, tilt, along = _directions()
    reach = np.arange(0.0, _LOOKED_AT_M + _STEP_M / 2, _STEP_M)
    points = bones.to_world(0, along[:, None, :] * reach[:, None])  # (directions, steps, 3)
    hand = _hand(model, bones)
    lengths, extents = [], []
    for silhouette in silhouettes:
        camera = silhouette.camera
        covered, known, unsure = silhouette.at(points)
        beside = known & ~_before(camera.centre, points, hand)
        out = ~(known & covered) & ~unsure  # where nobody knows, it may go on
        end = np.where(out.any(axis=1), out.argmax(axis=1), len(reach) - 1)
        shown = _STEP_M * (beside & (np.arange(len(reach)) < end[:, None])).sum(axis=1)
        length = np.where(shown >= 0.5 * _SHOWN_M, reach[end], 0.0)
        is_visible = _STEP_M * beside.sum(axis=1) >= _SHOWN_M
        pixel = np.nan_to_num(camera.project(points))
        wide = np.linalg.norm(pixel[np.arange(len(end)), end] - pixel[:, 0], axis=1)
        lengths.append(np.where(is_visible, length, np.nan))
        extents.append(
            np.where(
                is_visible & (length > 0), wide / camera.pixels_per_m_at(bones.position[0]), 0.0
            )
        )
    if not lengths or np.isnan(lengths).all():
        return np.nan
    costs = _BEND_COSTS_M * ((bend / _USUAL_BEND) ** 2 + (tilt / _USUAL_BEND) ** 2)
    told = np.array(lengths)[:, np.argmax(np.mean(extents, axis=0) - costs)]
    return np.nan if np.isnan(told).all() else float(np.nanmedian(told))


def _directions() -> tuple[Floats, Floats, Floats]:
    """Return bends and tilts (D,) of a wrist [rad], and where the forearm then points (D, 3) from the hand's root."""
    bends, tilts = np.deg2rad(np.linspace(-70, 70, 15)), np.deg2rad(np.linspace(-35, 35, 7))
    bend, tilt = (a.ravel() for a in np.meshgrid(bends, tilts, indexing="ij"))
    along = [np.sin(tilt), -np.cos(tilt) * np.cos(bend), -np.cos(tilt) * np.sin(bend)]
    return bend, tilt, np.stack(along, axis=1)


def aimed_forearm(problem: Problem, params: Floats[P]) -> Floats[P]:
    """Return params with the wrist's bend and tilt that cost least, the hand left as it is."""
    names = problem.model.transform.names
    if "wrist_flex" not in names:
        return params
    flex, abd = names.index("wrist_flex"), names.index("wrist_abd")
    bounds = problem.bounds(params)
    best, least = params, np.inf
    for bend in np.linspace(bounds[flex, 0], bounds[flex, 1], 13):
        for tilt in np.linspace(bounds[abd, 0], bounds[abd, 1], 7):
            trial = params.copy()
            trial[[flex, abd]] = bend, tilt
            cost = problem.cost(trial)
            if cost < least:
                best, least = trial, cost
    return best


def forearm_cut(
    silhouette: Silhouette, model: ArticulatedModel, start: BonePoses, most_m: float
) -> tuple[float, float, float] | None:
    """Return the line (a, b, c) across the arm beyond which a silhouette does not count, or None.

    There are sleeve, elbow and upper arm, of which the model knows nothing; a model that ends inside the mask would be
    pulled along the arm. So the line is most_m from the wrist, and nearer where the mask ends earlier: a forearm that goes
    on there would be pulled away from where it has no image. Without a forearm it runs behind the hand. It never
    cuts the hand, whichever way the arm points: fingers that do not count could be anywhere. Where the model's forearm is as short as
    that of the masks, all of them counts: poses are compared on the same pixels. Pixels with a u + b v + c < 0 are cut off.
    """
    if not model.has_keypoints21:
        return None
    camera = silhouette.camera
    bone, axis = 0, np.array([0.0, -1.0, 0.0])
    if model.has_forearm:
        bone, axis = model.skeleton.bone("forearm"), np.array([0.0, 1.0, 0.0])
        if model.skeleton.length[bone] < most_m:
            return None
    hand = _hand(model, start)
    ends = start.to_world(bone, np.array([[0.0], [most_m]]) * axis)
    pixels = camera.project(np.concatenate([ends, hand.centre]))
    wrist, far, centre = pixels[0], pixels[1], pixels[2:]
    along, long = wrist - far, float(np.linalg.norm(wrist - far))
    # seen along the arm, or behind the camera: there is no side to cut off
    if not long > _LEAST_PX or np.isnan(centre).any():
        return None
    at = wrist
    if model.has_forearm:
        reach = np.arange(0.0, most_m + _STEP_M / 2, _STEP_M)
        points = start.to_world(bone, reach[:, None] * axis)
        covered, known, _ = silhouette.at(points)
        out = known & ~covered & ~_before(camera.centre, points, hand)
        end = max(reach[out.argmax()] - _ROUND_M, 0.0) if out.any() else most_m
        at = camera.project(start.to_world(bone, end * axis))
    across = camera.rotation[:2].T @ (along / long)  # in the world, nearly
    half = np.linalg.norm(np.einsum("eji,j->ei", hand.rotation, across) * hand.radii, axis=1)
    hand_ends = centre @ along - long * half * camera.pixels_per_m_at(hand.centre)
    return float(along[0]), float(along[1]), -float(min(along @ at, hand_ends.min()))


def is_behind_hand(points: Floats[N, D3], model: ArticulatedModel, bones: BonePoses) -> Array[N]:
    """Return which points (N, 3) lie beyond the end of a hand behind its wrist: of an arm, whatever the model has of one."""
    hand, along = _hand(model, bones), bones.rotation[0][:, 1]
    half = np.linalg.norm(np.einsum("eji,j->ei", hand.rotation, along) * hand.radii, axis=1)
    return points @ along < (hand.centre @ along - half).min()


@lru_cache(maxsize=4)  # for each camera the same
def _hand(model: ArticulatedModel, bones: BonePoses) -> Ellipsoids:
    return _hand_ellipsoids(model).posed(bones)


@lru_cache(maxsize=8)
def _hand_ellipsoids(model: ArticulatedModel) -> Ellipsoids:
    ellipsoids = model.ellipsoids["fine"]
    return ellipsoids.subset(~model.is_forearm(ellipsoids.bone))


def _before(camera: Floats, points: Floats, hand: Ellipsoids) -> Array:
    """Return (...,) whether the line of sight from a camera (3,) to each point (..., 3) passes the hand."""
    wide = replace(hand, radii=_HAND_MARGIN * hand.radii)
    return wide.hide(points.reshape(-1, 3), camera, -np.inf).reshape(points.shape[:-1])
