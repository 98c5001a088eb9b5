"""Colours that people with any colour vision can tell apart (Okabe & Ito 2008)."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np

from handtrack.arrays import D3, Axes, Bytes, Floats, Ints, N

Colour = tuple[int, int, int]
"""red, green, blue, 0 … 255"""
_TOLD: dict[str, Any] = tomllib.loads(Path(__file__).with_name("palette.toml").read_text("utf-8"))


def _rgb(told: str) -> Colour:
    red, green, blue = bytes.fromhex(told[1:])
    return red, green, blue


def _table(name: str) -> dict[str, Colour]:
    return {key: _rgb(told) for key, told in _TOLD[name].items()}


FINGER_COLOURS, LIMB_COLOURS, FILTERS = map(_table, ("fingers", "limbs", "filters"))
"""of a hand's parts; of a body's; of the points that a filter dropped"""
GHOSTS, REJECTS = (tuple(map(_rgb, _TOLD[name])) for name in ("ghosts", "rejects"))
"""of poses that a frame may have, by rank; of matches that were thrown away, in the order of disparity.REJECTED"""
TERMS: dict[str, str] = _TOLD["terms"]
"""of the energy's parts on the timeline"""
STATUS: dict[int, tuple[str, str]] = {
    int(code): (word, colour) for code, (word, colour) in _TOLD["status"].items()
}
"""by a frame's status, −1 where it has none: word and colour"""
_ARM = ("clavicle", "upper_arm", "forearm", "hand", "shoulder", "elbow", "wrist")
_LEG = ("thigh", "shin", "foot", "hip", "knee", "ankle", "toe")
TRUTH = (255, 255, 255)
SURFACE = (196, 178, 164)
PIN = (213, 94, 0)
"""what somebody pinned"""
CONTRADICTED = (255, 32, 64)
"""a pin that the pose misses"""
PINNED = ("pinned", "#d55e00")
"""of a pose to which pins led"""
REFITTED = ("refitted", "#0072b2")
"""of a pose to which tuned settings led"""
ASIDE = ("before", "#e69f00")
"""of a pose that is only looked at"""
SEARCH_RESULT = ("found", "#ebebeb")
"""of a pose that a search found, like its ghost's"""
BRAND = (0, 114, 178)


def finger_of(name: str) -> str:
    """Return the finger that a bone or parameter belongs to, or `palm`; metacarpals of fingers are palm."""
    first, _, rest = name.partition("_")
    if first in FINGER_COLOURS and (
        "carpal" not in rest or (first == "thumb" and rest == "metacarpal")
    ):
        return first
    return "palm"


def limb_of(name: str) -> str | None:
    """Return the limb that a body's bone or parameter belongs to; None for the trunk, and for all of a hand."""
    side, _, rest = name.partition("_")
    if side in ("left", "right"):
        if rest.startswith(_ARM):
            return f"{side} arm"
        return f"{side} leg" if rest.startswith(_LEG) else None
    return "head" if side in ("neck", "head") else None


def colour_of(name: str) -> tuple[int, int, int]:
    """Return the colour of a bone or parameter, by its finger or limb."""
    limb = limb_of(name)
    return FINGER_COLOURS[finger_of(name)] if limb is None else LIMB_COLOURS[limb]


def colours_of(bone_names: tuple[str, ...], bones: Ints[N]) -> Bytes[N, D3]:
    """Return colours of things that sit on bones."""
    return linear([colour_of(bone_names[b]) for b in bones])


def linear(colours: object) -> Bytes[*Axes, D3]:
    """Return colours as the scene's light is computed; sent as they are, they would look washed out."""
    return np.rint(255 * light_of(colours)).astype(np.uint8)


def light_of(colours: object) -> Floats[*Axes, D3]:
    """Return how much light, 0 … 1, colours of 0 … 255 stand for (sRGB, IEC 61966-2-1)."""
    share = np.asarray(colours, dtype=float) / 255
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)


KEPT = (240, 228, 66)
RESIDUAL_MM = 10.0
_RAMP = np.array([_rgb(one) for one in _TOLD["ramp"]], float)


def residual_colours(residual_mm: Floats[N]) -> Bytes[N, D3]:
    """Return colours of distances to the model [mm]: blue inside, grey on it, orange outside."""
    share = np.nan_to_num(np.clip(residual_mm / RESIDUAL_MM, -1.0, 1.0))
    place = 0.5 * (share + 1.0) * (len(_RAMP) - 1)
    stops = np.arange(len(_RAMP))
    return np.stack([np.interp(place, stops, _RAMP[:, c]) for c in range(3)], axis=-1).astype(
        np.uint8
    )
