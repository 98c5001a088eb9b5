"""The covariance that is stated of joints: what noise leaves, and how far another hand's flesh and joints lie beside the model's."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

import numpy as np

from handtrack.arrays import D3, Array, Floats, J, K, S
from handtrack.model.articulated import FINGERS, ArticulatedModel
from handtrack.tracking.frame.doubt import figures

OBSERVED = ("coverage", "conic_field", "cloud_distance", "cloud_rays", "cloud_emptiness")
"""terms that see a surface, by name: what a misfit is told by"""
_UNSEEN_M = 0.003
"""standard deviation above which a direction is open rather than noisy: twice an outline's usual error"""
_BONES = {"pip": 1, "dip": 2, "tip": 3}
_THUMB = {"thumb_mcp": 1, "thumb_ip": 2}
_CLOSED_RAD = 4.0
"""sum of a finger's bends in a fist"""


def misfit(energies: Mapping[str, float], views: int) -> float:
    """Return how badly a model fits what was seen, 1 where as its noise says; 1 where no surface was seen.

    energies: of each term. As least squares judge their own noise by what is left over.
    """
    seen = [energy for name, energy in energies.items() if name in OBSERVED]
    if not seen or not views:
        return 1.0
    found = sum(seen) / (figures.USUAL_PER_VIEW * views)
    return float(np.clip(found, figures.LEAST_MISFIT, figures.MOST_MISFIT))


def stated_covariance(
    model: ArticulatedModel,
    curled: Floats[K],
    joint_covariance: Floats[J, D3, D3],
    how_bad: float,
    by_cloud: bool = False,
) -> Floats[J, D3, D3]:
    """Return each joint's covariance [m²] of all that is known to be wrong.

    curled: `curls`, of fingers of which nothing else tells how they bend; joint_covariance: if the model were the hand, and noise what it
    is said to be; how_bad: `misfit`; by_cloud:
    whether a cloud was seen.
    """
    seen = figures.CLOUD if by_cloud else figures.MASKS
    if model.kind == "body":
        seen, how_bad = figures.BODY, 1.0
    closed = _along_fingers(model) @ curled**2
    flesh = seen.flesh_mm + seen.closed_mm * closed + seen.palm_mm * curled.mean() ** 2
    flesh *= 1e-3 * model.scale.overall
    noise = seen.noise**2 * how_bad ** (2 * seen.noise_by_misfit)
    flesh = flesh**2 * how_bad ** (2 * seen.flesh_by_misfit)
    scaled = noise * joint_covariance
    if noise < 1.0:  # less noise makes nothing surer that was not seen at all
        values, axes = np.linalg.eigh(joint_covariance)
        unseen = values / (values + _UNSEEN_M**2)
        values = values * (noise + (1.0 - noise) * unseen)
        scaled = np.einsum("jab,jb,jcb->jac", axes, values, axes)
    return scaled + flesh[:, None, None] * np.eye(3)


def curls(model: ArticulatedModel, joint_params: Floats[S]) -> Floats[K]:
    """Return how far each finger is closed, 0 straight … 1, thumb first."""
    return np.clip(_bends(model) @ joint_params / _CLOSED_RAD, 0.0, 1.0)


@lru_cache(maxsize=8)
def _bends(model: ArticulatedModel) -> Array:
    names = model.parameter_names
    return np.array(
        [[n.startswith(f"{finger}_") and n.endswith("_flex") for n in names] for finger in FINGERS],
        float,
    )


@lru_cache(maxsize=8)
def _along_fingers(model: ArticulatedModel) -> Array:
    """Return (J, 5), of the finger that a joint is of, how many of its three bones lead there from its base, a share."""
    found = np.zeros((len(model.joint_names), len(FINGERS)))
    for row, name in enumerate(model.joint_names):
        finger, _, place = name.partition("_")
        if finger in FINGERS:
            found[row, FINGERS.index(finger)] = _THUMB.get(name, _BONES.get(place, 0)) / 3
    return found
