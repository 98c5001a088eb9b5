"""What looks the same to the only camera: limbs and fingers flipped along its lines of sight, and how probable each flip is."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from handtrack.arrays import D3, Floats, J, K, N, P
from handtrack.geometry.camera import Camera
from handtrack.model.articulated import ArticulatedModel
from handtrack.observation.observation import ImageKeypoints
from handtrack.sampling.chains import PreparedChain, chains_of, prepare
from handtrack.sampling.interpretation_tree import TreeSettings, interpretation_tree
from handtrack.tracking.frame.descent import by_keypoints_alone, minima
from handtrack.tracking.frame.frame_terms import FrameTerms

_MOVED_RAD = 0.2
"""an angle by which a flip differs at least; a link that lies across the line of sight has none"""
_APART_SHARE = 0.025
"""two minima are one whose joints are all nearer, as a share of the model's greatest extent: of a body 4 cm, of a hand 5 mm"""
_TREE = TreeSettings(failing="nearest")


def mirrored_covariance(terms: FrameTerms, params: Floats[P]) -> Floats[J, D3, D3]:
    """Return what flips in depth add to each joint's covariance [m²]: Σ P · d dᵀ, d from the pose to the flip; zero unless joints
    in one camera's image are all that was seen.

    Where the limb was before tells nothing: it was as ambiguous there. Each limb flips on its own; its flips descend
    together, and count by their masses (Laplace) beside the pose's own.
    """
    model = terms.model
    found = np.zeros((len(model.joint_names), 3, 3))
    camera = _only_camera(terms)
    if camera is None:
        return found
    flips = [_flips(model, params, chain, camera) for chain in _chains(model)]
    starts = np.concatenate([params[None], *flips])
    ended = minima(model, terms.settings.solver, terms.without_motion(), starts, len(starts))
    places = np.stack([model.joint_positions(model.bones(pose)) for pose in ended.params])
    mass = -ended.cost - 0.5 * np.linalg.slogdet(ended.hessian)[1]
    here = model.joint_positions(model.bones(params))
    apart_m = _APART_SHARE * float(np.linalg.norm(np.ptp(here, axis=0)))
    if not np.isfinite(mass[0]):
        return found
    limb = np.repeat(np.arange(len(flips)), [len(rows) for rows in flips]) + 1
    for one in range(1, len(flips) + 1):
        rows = [0, *(1 + np.flatnonzero((limb == one) & np.isfinite(mass[1:]))).tolist()]
        rows = _distinct(places, mass, rows, apart_m)
        share = np.exp(mass[rows] - mass[rows].max())
        off = places[rows[1:]] - here
        found += np.einsum("k,kja,kjb->jab", share[1:] / share.sum(), off, off)
    return found


def _only_camera(terms: FrameTerms) -> Camera | None:
    """Return the camera whose joints are all that was seen; None where it is not the only one."""
    seen = [term.observed for term in terms.keypoints]
    cameras = {one.camera.name: one.camera for one in seen if isinstance(one, ImageKeypoints)}
    alone = by_keypoints_alone(terms) and all(isinstance(one, ImageKeypoints) for one in seen)
    return next(iter(cameras.values())) if alone and len(cameras) == 1 else None


def _flips(
    model: ArticulatedModel, params: Floats[P], chain: PreparedChain, camera: Camera
) -> Floats[K, P]:
    leaves = interpretation_tree(model, params, [chain], camera, settings=_TREE).params
    moved = np.abs(leaves - params).max(axis=1) > _MOVED_RAD
    return np.array([model.clipped(leaf) for leaf in leaves[moved]]).reshape(-1, len(params))


def _distinct(
    places: Floats[N, J, D3], mass: Floats[N], rows: Sequence[int], apart_m: float
) -> list[int]:
    """Return the first of rows, and the heaviest of the others that stand for all."""
    kept = list(rows[:1])
    for row in sorted(rows[1:], key=lambda row: -mass[row]):
        far = np.linalg.norm(places[kept] - places[row], axis=2).max(axis=1)
        if (far > apart_m).all():
            kept.append(row)
    return kept


@lru_cache(maxsize=8)
def _chains(model: ArticulatedModel) -> tuple[PreparedChain, ...]:
    return tuple(prepare(model, chain) for chain in chains_of(model))
