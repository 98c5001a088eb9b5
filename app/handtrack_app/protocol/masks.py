"""What the engine tells the page of masks: snapshots, as those of `snapshots`."""

from __future__ import annotations

from dataclasses import dataclass

from handtrack.arrays import D3, Bytes, H, W

FILES, NO_MASKS = "files", "none"
"""in place of a method: files that session.toml names; no masks"""


@dataclass(frozen=True)
class MaskCameraCard:
    """Where one camera's masks come from."""

    name: str
    size: tuple[int, int]
    """width and height of its images [px]"""
    method: str
    """a method's name, `files` or `none`"""
    values: dict[str, object]
    """the method's settings in force"""
    roi: tuple[int, int, int, int] | None
    possible: tuple[str, ...]
    """methods that it has what it takes for"""


@dataclass(frozen=True)
class MaskCard:
    """Where all cameras' masks come from."""

    cameras: tuple[MaskCameraCard, ...]
    unsaved: tuple[str, ...]
    """cameras that differ from session.toml"""
    words: str
    """what is to be said of it"""


@dataclass(frozen=True)
class MaskPicture:
    """The cameras' masks in one frame, painted over their images, RGB."""

    frame: int
    small: dict[str, Bytes[H, W, D3]]
    sheet: Bytes[H, W, D3] | None
    """the small ones side by side"""
    screens: dict[tuple[str, str], Bytes[H, W, D3]]
    """large, by camera and `mask`"""
    corrected: dict[str, str]
    """by camera, whether this frame is corrected and how many are, in words"""
    words: str = ""
    """what could not be made, and why"""
