"""Named poses: joint angles that users start from."""

from __future__ import annotations

import tomllib
from functools import lru_cache
from importlib import resources

import numpy as np

from handtrack.arrays import Floats
from handtrack.errors import unknown_name
from handtrack.model.articulated import ArticulatedModel


@lru_cache(maxsize=1)
def _library() -> dict[str, dict[str, float]]:
    text = resources.files("handtrack.model.poses").joinpath("hand.toml").read_text()
    return tomllib.loads(text)


def pose_names() -> tuple[str, ...]:
    """Return the names of the hand poses."""
    return tuple(_library())


def named_pose(model: ArticulatedModel, name: str) -> Floats:
    """Return joint parameters (S,) of a named hand pose, the root at the world's origin."""
    if name not in _library():
        raise unknown_name("pose", name, pose_names())
    joint = np.zeros(len(model.parameter_names))
    for parameter, degrees in _library()[name].items():
        joint[model.skeleton.parameter(parameter)] = np.deg2rad(degrees)
    return joint
