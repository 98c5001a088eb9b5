"""The model that a new session tracks: as the user says, or the usual one of what is tracked; and a body's settings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from handtrack.capture.joints.body_points import height
from handtrack.capture.joints.subject import BODY, HAND, Subject
from handtrack.errors import HandtrackError
from handtrack.model.model_file import load_model
from handtrack.session.session_file import is_definition
from handtrack.simulation.simulate import BODY_TRACKING
from handtrack_app.commands.new_session.joints import GivenSubject

_USUAL = {HAND: "hand26", BODY: "body34"}
_JOINT_ERROR_M = 0.025
"""of a detector's joints of bodies, against markers: 16 to 50 mm (Needham et al. 2021)"""


@dataclass(frozen=True)
class GivenModel:
    """A model that the user named."""

    setting: str
    """as session.toml names it"""
    file: Path | None
    """a definition, to be copied into the session"""
    kind: Subject


def given_model(name: str | None) -> GivenModel | None:
    """Return the model of a name or a definition's path; None where none is given. Raises HandtrackError."""
    if name is None:
        return None
    file = Path(name) if is_definition(name) else None
    if file is not None and not file.is_file():
        raise HandtrackError(f"--model {name}: no such file; expected a definition, or {_names()}.")
    kind = BODY if load_model(name).kind == "body" else HAND
    return GivenModel(name if file is None else file.name, file, kind)


def _names() -> str:
    return " or ".join(_USUAL.values())


def usual_model(kind: Subject) -> str:
    """Return the name of the model of a hand or a body."""
    return _USUAL[kind]


def tracking_of(
    subject: GivenSubject, sizes: Mapping[str, tuple[int, int]]
) -> Mapping[str, object]:
    """Return [tracking] of what is tracked: of a body as coarse as it is large. sizes: of cameras' images [px]."""
    if subject.kind is not BODY:
        return {}
    heights = [
        height(points)
        for name, joints in subject.joints.items()
        for points in joints.pixels(sizes[name]).values()
    ]
    if not heights:
        return dict(BODY_TRACKING)
    sigma_px = float(np.median(heights)) * _JOINT_ERROR_M / BODY.size_m
    return BODY_TRACKING | {"keypoints": {"sigma_px": round(max(sigma_px, 0.1), 1)}}
