"""How the model of a result is built: hierarchy, rest pose, hinges, limits. For readers who have the file alone."""

from __future__ import annotations

import json

import numpy as np

from handtrack.arrays import Array, Axes
from handtrack.errors import HandtrackError
from handtrack.model.articulated import ArticulatedModel, HandScale
from handtrack.model.model_file import MODELS, load_model, model_from_definition, scale_from
from handtrack.tracking.frame.result import TrackResult

AXES = (
    "world: right-handed, as the camera calibration has it; bone: origin at its proximal end, +y along it, +z dorsal; "
    "T_a_b maps b to a"
)


def model_of(track: TrackResult, source: str = "this result") -> ArticulatedModel:
    """Return the model that a result was tracked with, of the same size, without couplings.

    It is built from the result's definition; without one (format 1), a shipped model of that name is taken if it has the same
    bones, parameters and joints. source: where the result is from, for errors. Raises HandtrackError.
    """
    size, side = _scale(track, source), track.side or "right"
    forearm = "forearm" in track.bone_names
    if track.definition is not None:
        model = model_from_definition(track.definition, side, size, forearm, source)
    elif track.model in MODELS:
        model = load_model(track.model, side, size, forearm=forearm)
    else:
        raise HandtrackError(
            f"{source}: how its model '{track.model}' is built is not in the file, and no model of that name comes with "
            f"handtrack ({', '.join(MODELS)}). Files of format 1 do not have it: track the session again."
        )
    for what, theirs, ours in (
        ("bones", track.bone_names, model.skeleton.bone_names),
        ("parameters", track.parameter_names, model.parameter_names),
        ("joints", track.joint_names, model.joint_names),
    ):
        if tuple(theirs) != tuple(ours):
            odd = sorted(set(theirs) ^ set(ours)) or ["their order"]
            raise HandtrackError(
                f"{source}: its {what} are not those of the model '{track.model}' ({', '.join(odd[:3])} differ). Was the "
                "file made with another definition of that name? Track the session again."
            )
    return model


def anatomy_arrays(model: ArticulatedModel) -> dict[str, Array[*Axes]]:
    """Return what poses.npz says of a model, by key.

    `parents` (B,), −1 for the root; `rest_T_bone` (B, 4, 4) bone → root in the zero pose [m]; `bone_length` (B,) [m];
    `hinge_bone` (S − 6,) the bone that each parameter after the root's six turns, `hinge_axis` (S − 6, 3) about which axis of
    its rest frame, in this order; `parameter_limits` (S, 2) [m, rad]; `joint_bone` (J,) and `joint_point` (J, 3) [m], where
    each named joint is in its bone's frame; `axes`, `unit`.
    """
    skeleton = model.skeleton
    rest = model.bones(model.params_from({})).T_world_bone
    return {
        "parents": np.asarray(skeleton.parent, np.int64),
        "rest_T_bone": rest,
        "bone_length": skeleton.length,
        "hinge_bone": np.asarray(skeleton.hinge_bone, np.int64),
        "hinge_axis": skeleton.hinge_axis,
        "parameter_limits": model.limits.interval,
        "joint_bone": np.asarray(model.joint_bone, np.int64),
        "joint_point": model.joint_point,
        "axes": np.array(AXES),
        "unit": np.array("m"),
    }


def _scale(track: TrackResult, source: str) -> HandScale:
    if not track.scale:
        return HandScale()
    try:
        table = json.loads(track.scale)
    except ValueError as error:
        raise HandtrackError(f"{source}: its `scale` is no JSON ({error}).") from None
    return scale_from(table, source)
