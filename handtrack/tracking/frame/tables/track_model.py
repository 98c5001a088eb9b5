"""The model that a tracked sequence is of, built again from what the sequence says of it."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from handtrack.errors import HandtrackError
from handtrack.model.articulated import ArticulatedModel, HandScale
from handtrack.model.model_file import MODELS, load_model, model_from_definition, scale_from

if TYPE_CHECKING:
    from handtrack.tracking.frame.result import TrackResult


def model_of(track: TrackResult, source: str = "this result") -> ArticulatedModel:
    """Return the model that a result was tracked with, of the same size, without couplings.

    It is built from the result's definition; without one (format 1), a shipped model of that name
    is taken if it has the same bones, parameters and joints.

    Parameters
    ----------
    source
        Where the result is from, for errors.

    Raises
    ------
    HandtrackError
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


def _scale(track: TrackResult, source: str) -> HandScale:
    if not track.scale:
        return HandScale()
    try:
        table = json.loads(track.scale)
    except ValueError as error:
        raise HandtrackError(f"{source}: its `scale` is no JSON ({error}).") from None
    return scale_from(table, source)
