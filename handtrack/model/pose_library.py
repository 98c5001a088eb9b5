"""Named poses: joint angles to start from, and how the hand is turned where that matters.

The letters `lsf_a` to `lsf_z` are the French manual alphabet, with which the 2004 paper validated its
model. A letter's turn of the hand is a hint for pictures and for placing a hand, not part of the pose:
`named_pose` always leaves the root at the world's origin.
"""

from __future__ import annotations

import tomllib
from functools import lru_cache
from importlib import resources
from typing import Any

import numpy as np

from handtrack.arrays import D3, Floats, S
from handtrack.errors import check_name
from handtrack.geometry.rotation import axes_along, rotation_vector
from handtrack.model.articulated import ArticulatedModel

_FILES = {"hand": ("hand.toml", "lsf.toml"), "body": ("body.toml",)}
_HINTS = ("palm", "fingers", "like", "title")
_ALPHABET, _LETTER = "French manual alphabet", "lsf_"
_PALM, _FINGERS = (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)  # to the viewer, up


@lru_cache(maxsize=2)
def _library(kind: str) -> dict[str, dict[str, Any]]:
    folder = resources.files("handtrack.model.poses")
    poses: dict[str, dict[str, Any]] = {}
    for file in _FILES[kind]:
        poses |= tomllib.loads(folder.joinpath(file).read_text(encoding="utf-8"))
    return {name: _with_model(poses, name) for name in poses}


def _with_model(poses: dict[str, dict[str, Any]], name: str) -> dict[str, Any]:
    """Return a pose with what it takes over from the one it is `like`."""
    own = poses[name]
    if "like" not in own:
        return own
    return _with_model(poses, own["like"]) | own


def pose_names(kind: str = "hand") -> tuple[str, ...]:
    """Return the names of the poses of a hand or a body."""
    return tuple(_library(kind))


def alphabet() -> tuple[str, ...]:
    """Return the names of the 26 letters, `lsf_a` to `lsf_z`."""
    return tuple(name for name in pose_names() if name.startswith(_LETTER))


def pose_title(name: str, kind: str = "hand") -> tuple[str, str]:
    """Return what a pose is called, and what it is one of: ("A", "French manual alphabet")."""
    if kind == "body":
        return name.capitalize(), "Body"
    if name.startswith(_LETTER):
        return name.removeprefix(_LETTER).upper(), _ALPHABET
    return str(_pose(name).get("title", name)), "Everyday"


def named_pose(model: ArticulatedModel, name: str) -> Floats[S]:
    """Return joint parameters of a named pose of a hand or body, the root at the world's origin."""
    is_body = model.kind == "body"
    joint = model.rest.copy() if is_body else np.zeros(len(model.parameter_names))
    for parameter, degrees in _pose(name, model.kind).items():
        lacking = is_body and parameter not in model.parameter_names  # not all bodies have wrists
        if parameter not in _HINTS and not lacking:
            joint[model.skeleton.parameter(parameter)] = np.deg2rad(degrees)
    return joint


def pose_turn(name: str, side: str = "right") -> Floats[D3]:
    """Return the rotation vector [rad] that holds the hand as the pose is shown to a viewer.

    It turns the hand's axes into the viewer's: x to the viewer's right, y up, z to the viewer. A pose
    without a hint is held with its palm to the viewer and fingers up. A left hand is the mirror image.
    """
    pose = _pose(name)
    along = np.array(pose.get("fingers", _FINGERS), dtype=float)
    palm = np.array(pose.get("palm", _PALM), dtype=float)
    turn = axes_along(along, -palm)
    if side == "left":
        mirror = np.diag([-1.0, 1.0, 1.0])
        turn = mirror @ turn @ mirror
    return rotation_vector(turn)


def _pose(name: str, kind: str = "hand") -> dict[str, Any]:
    check_name("pose", name, _library(kind))
    return _library(kind)[name]
