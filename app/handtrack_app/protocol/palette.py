"""Colours that people with any colour vision can tell apart (Okabe & Ito 2008)."""

from __future__ import annotations

import numpy as np

from handtrack.arrays import D3, Axes, Bytes, Floats, Ints, N

FINGER_COLOURS: dict[str, tuple[int, int, int]] = {
    "palm": (168, 158, 150),
    "thumb": (230, 159, 0),
    "index": (86, 180, 233),
    "middle": (0, 158, 115),
    "ring": (240, 228, 66),
    "little": (204, 121, 167),
}
"""of a hand's parts"""
LIMB_COLOURS: dict[str, tuple[int, int, int]] = {
    "head": (196, 178, 164),
    "left arm": (230, 159, 0),
    "right arm": (86, 180, 233),
    "left leg": (240, 228, 66),
    "right leg": (0, 158, 115),
}
"""of a body's; its trunk is the palm's grey"""
_ARM = ("clavicle", "upper_arm", "forearm", "hand", "shoulder", "elbow", "wrist")
_LEG = ("thigh", "shin", "foot", "hip", "knee", "ankle", "toe")
TRUTH = (255, 255, 255)
SURFACE = (196, 178, 164)
STATUS = {
    -1: ("not tracked", "#3a3f47"),
    0: ("tracked", "#56b4e9"),
    1: ("low confidence", "#f0e442"),
    2: ("lost", "#d55e00"),
    3: ("set by hand", "#cc79a7"),
}
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
FILTERS: dict[str, tuple[int, int, int]] = {
    "range": (120, 124, 132),
    "crop": (86, 180, 233),
    "skin": (204, 121, 167),
    "component": (0, 114, 178),
    "voxel": (150, 142, 60),
    "outliers": (213, 94, 0),
    "most": (150, 142, 60),
}
"""of the points that a filter dropped; thinned ones look like those that stay, only darker"""
REJECTS = ((0, 0, 0), (213, 94, 0), (86, 180, 233), (240, 228, 66), (204, 121, 167))
"""of matches that were thrown away, in the order of disparity.REJECTED"""
GHOSTS = (
    (235, 235, 235), (86, 180, 233), (230, 159, 0), (204, 121, 167), (0, 158, 115), (240, 228, 66), (213, 94, 0),
    (0, 114, 178),
)  # fmt: skip
"""of poses that a frame may have, by rank"""
TERMS = {
    "silhouettes": "#009e73",
    "cloud→model": "#e69f00",
    "model→cloud": "#56b4e9",
    "lines of sight": "#e8e8e8",
    "keypoints": "#cc79a7",
    "pins": "#0072b2",
    "own terms": "#aa4499",
    "edges": "#f0e442",
    "intensity": "#d55e00",
    "priors": "#9aa0a8",
}
"""of the energy's parts on the timeline"""
RESIDUAL_MM = 10.0
_RAMP = np.array(
    [[0, 90, 200], [86, 170, 233], [226, 226, 222], [240, 170, 50], [200, 70, 0]], float
)


def residual_colours(residual_mm: Floats[N]) -> Bytes[N, D3]:
    """Return colours of distances to the model [mm]: blue inside, grey on it, orange outside."""
    share = np.nan_to_num(np.clip(residual_mm / RESIDUAL_MM, -1.0, 1.0))
    place = 0.5 * (share + 1.0) * (len(_RAMP) - 1)
    stops = np.arange(len(_RAMP))
    return np.stack([np.interp(place, stops, _RAMP[:, c]) for c in range(3)], axis=-1).astype(
        np.uint8
    )
