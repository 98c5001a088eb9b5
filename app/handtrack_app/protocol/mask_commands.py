"""What the page asks of the engine about masks: where they come from, and painted corrections."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class WantMasks:
    """Whether the page shows masks over all cameras' images."""

    on: bool


FILES, NO_MASKS = "files", "none"
"""in place of a method: files that session.toml names; no masks"""


@dataclass(frozen=True)
class SetMasks:
    """Change where the masks of a camera come from (`method`), settings of the method, or the region of interest (`roi`)."""

    camera: str
    """empty: all that have what it takes"""
    values: tuple[tuple[str, object], ...]


@dataclass(frozen=True)
class MarkMaskBox:
    """Take a box x, y, w, h [px] of a camera's undistorted image as region of interest (`roi`) or as skin (`sample`)."""

    camera: str
    what: str
    box: tuple[int, int, int, int]
    frame: int


@dataclass(frozen=True)
class SaveMasks:
    """Write where masks come from into session.toml."""


@dataclass(frozen=True)
class RestoreMasks:
    """Go back to the masks as session.toml has them."""


@dataclass(frozen=True)
class PaintMask:
    """Paint a stroke over a camera's mask in a frame."""

    frame: int
    camera: str
    brush: str
    """`hand`, `not hand`, `unknown`, or `as it is` (not corrected)"""
    points: tuple[tuple[float, float], ...]
    """columns and rows [px] of the undistorted image"""
    radius_px: float
    tag: str = ""
    """of the drag; what follows soon with the same is one step of undo"""


@dataclass(frozen=True)
class DropCorrection:
    """Forget what was painted over a camera's mask in a frame."""

    frame: int
    camera: str


@dataclass(frozen=True)
class CarryMasks:
    """Carry what was painted in a frame on to so many frames before and behind it. camera: empty for all."""

    frame: int
    camera: str
    before: int
    behind: int
