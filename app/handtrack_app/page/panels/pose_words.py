"""Joint parameters as the page names them: by group, in words, in degrees and millimetres."""

from __future__ import annotations

import math
from collections.abc import Sequence

from handtrack_app.protocol.palette import limb_of

_LIMBS = ("Trunk", "Head", "Left arm", "Right arm", "Left leg", "Right leg")
PLACE, OTHERS = "Position", "Others"
_ORDER = (PLACE, "Wrist", "Thumb", "Index", "Middle", "Ring", "Little", *_LIMBS, OTHERS)
_LARGE_M = 0.5
"""what reaches farther is placed by centimetres, else by millimetres: a body's 1.75 m are as many of these as a hand's 190 mm of those"""
_MOTIONS = {"flex": "flex °", "abd": "abduction °"}
_TURNS = {
    "flex": "flex\u00a0°", "abd": "abduction\u00a0°", "twist": "twist\u00a0°", "lean": "lean\u00a0°",
    "elevate": "elevation\u00a0°", "protract": "protraction\u00a0°",
}  # fmt: skip


def length_unit(reach_m: float) -> tuple[str, float]:
    """Return the unit in which a model is placed, and what it is in metres. reach_m: how far the model extends."""
    return ("cm", 1e-2) if reach_m > _LARGE_M else ("mm", 1e-3)


def groups_of(names: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Return a model's parameters by folder, in the order of the folders."""
    groups = {group: tuple(n for n in names if group_of(n) == group) for group in _ORDER}
    return {group: members for group, members in groups.items() if members}


def group_of(name: str) -> str:
    """Return the folder of a parameter."""
    if name.startswith("root_"):
        return PLACE
    if (limb := limb_of(name)) is not None:
        return limb.capitalize()
    first = name.split("_", maxsplit=1)[0].capitalize()
    if first == "Spine":
        return "Trunk"
    return first if first in _ORDER else OTHERS


def label_of(name: str, length: str = "mm") -> str:
    """Return a parameter's label inside its folder. length: the unit of a place."""
    if name.startswith("root_t"):
        return f"{name[-1]} {length}"
    if name.startswith("root_r"):
        return f"turn {name[-1]} °"
    first, *joint, motion = name.split("_")
    if limb_of(name) is not None or first == "spine":
        return " ".join([*(joint or [first]), _TURNS.get(motion, motion)])
    return " ".join([part.upper() for part in joint] + [_MOTIONS.get(motion, motion)])


def unit_of(name: str, length: float = 1e-3) -> float:
    """Return what a slider's unit is in metres or radians. length: of a place [m]."""
    return length if name.startswith("root_t") else math.pi / 180


_JOINTS = {
    "cmc": "CMC", "mcp": "MCP", "pip": "PIP", "dip": "DIP", "ip": "IP",
}  # fmt: skip
_LONG_MOTIONS = {
    "flex": "flexion", "abd": "abduction", "twist": "axial rotation", "dev": "deviation", "lean": "lateral flexion",
    "elevate": "elevation", "protract": "protraction",
}  # fmt: skip


def title_of(name: str) -> str:
    """Return a parameter's name in words: `Index PIP flexion`."""
    if name.startswith("root_"):
        return f"{'Position' if name[5] == 't' else 'Rotation'} {name[-1]}"
    *parts, motion = name.split("_")
    joint = " ".join(_JOINTS.get(part, part) for part in parts)
    return f"{joint[:1].upper()}{joint[1:]} {_LONG_MOTIONS.get(motion, motion)}"
