"""A tracked sequence in a world that stands as a format's readers take it to stand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from handtrack.arrays import D3, Floats
from handtrack.errors import unknown_name
from handtrack.export.registry import AXES
from handtrack.geometry.rotation import rotation_matrix, rotation_vector
from handtrack.tracking.frame.result import COLUMNS, TrackResult


def axis(name: str) -> Floats[D3]:
    """Return the direction of one of AXES. Raises HandtrackError naming them."""
    if name not in AXES:
        raise unknown_name("axis", name, AXES, "--up")
    return (-1.0 if name.startswith("-") else 1.0) * np.eye(3)["xyz".index(name[-1])]


def turn_between(up: str, wanted: str) -> Floats[D3, D3]:
    """Return the turn that brings an axis of AXES to another on the short way; about x or y where they are opposite, as from a camera's
    axes (x right, y down) to a screen's.
    """
    start, end = axis(up), axis(wanted)
    if start @ end == 0.0:
        about = np.cross(start, end)
        return np.outer(about, about) + np.outer(end, start) - np.outer(start, end)
    kept = np.eye(3)[1 if up[-1] == "x" else 0]
    return np.eye(3) if start @ end > 0 else 2.0 * np.outer(kept, kept) - np.eye(3)


def upright(track: TrackResult, up: str, wanted: str) -> TrackResult:
    """Return the sequence with the world turned so that what is up points along `wanted`.

    Poses, joints, their covariance and the root's parameters; what else is of the world (cameras, pins, other hypotheses, the
    root's standard deviations) is left out or unknown.
    """
    turn = turn_between(up, wanted)
    arrays = {name: getattr(track, name) for name in COLUMNS}
    changed = {name: COLUMNS[name].turned(a, turn) for name, a in arrays.items() if a is not None}
    parameters, std = track.parameters.copy(), track.parameter_std.copy()
    parameters[:, :3] = parameters[:, :3] @ turn.T
    parameters[:, 3:6] = rotation_vector(turn @ rotation_matrix(track.parameters[:, 3:6]))
    std[:, :6] = np.nan
    changed |= {"parameters": parameters, "parameter_std": std, "cameras": None, "pins": None}
    return replace(track, **changed)
