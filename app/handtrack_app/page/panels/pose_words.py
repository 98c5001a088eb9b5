"""Joint parameters as the page names them: by group, in words, in degrees and millimetres."""

from __future__ import annotations

import math

from handtrack_app.protocol.palette import limb_of

_LIMBS = ("Trunk", "Head", "Left arm", "Right arm", "Left leg", "Right leg")
GROUPS = ("Hand", "Wrist", "Thumb", "Index", "Middle", "Ring", "Little", *_LIMBS)
"""folders; the first holds the root, of a body too"""
_ROOT_LABELS = {
    "root_tx": "x mm", "root_ty": "y mm", "root_tz": "z mm",
    "root_rx": "turn x °", "root_ry": "turn y °", "root_rz": "turn z °",
}  # fmt: skip
_MOTIONS = {"flex": "flex °", "abd": "spread °"}
_TURNS = {
    "flex": "flex\u00a0°", "abd": "aside\u00a0°", "twist": "twist\u00a0°", "lean": "lean\u00a0°",
    "elevate": "raise\u00a0°", "protract": "forward\u00a0°",
}  # fmt: skip


def group_of(name: str) -> str:
    """Return the folder of a parameter."""
    if name.startswith("root_"):
        return "Hand"
    if (limb := limb_of(name)) is not None:
        return limb.capitalize()
    first = name.split("_", maxsplit=1)[0].capitalize()
    if first == "Spine":
        return "Trunk"
    return first if first in GROUPS else "Hand"


def label_of(name: str) -> str:
    """Return a parameter's label inside its folder."""
    if name in _ROOT_LABELS:
        return _ROOT_LABELS[name]
    first, *joint, motion = name.split("_")
    if limb_of(name) is not None or first == "spine":
        return " ".join([*(joint or [first]), _TURNS.get(motion, motion)])
    return " ".join([part.upper() for part in joint] + [_MOTIONS.get(motion, motion)])


def unit_of(name: str) -> float:
    """Return what a slider's unit is in metres or radians."""
    return 1e-3 if name.startswith("root_t") else math.pi / 180
