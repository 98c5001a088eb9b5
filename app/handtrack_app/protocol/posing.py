"""What the page asks of the engine about the pose of a frame: set, taken, pulled at, pinned, looked at as it was, fitted anew."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SetPose:
    """Set the whole pose of a frame by hand. A newer one replaces an older one that still waits."""

    frame: int
    values: tuple[float, ...]
    """(S,) joint parameters [m, rad]"""
    version: int
    """counts the user's edits; the answering snapshot carries it back"""
    tag: str = ""
    """the control that is moved: what follows soon with the same is one step of undo"""
    is_stroke: bool = False
    """the tag is of this one drag: one step, however long it takes"""
    words: str = "Pose"
    """what is done, for undo"""


@dataclass(frozen=True)
class TakePose:
    """Replace a frame's pose by another one."""

    frame: int
    source: str
    """`start` (the first-frame pose), `previous` (the frame before), or a pose of the library, for the fingers"""
    version: int


@dataclass(frozen=True)
class PullPlace:
    """Bend a finger or limb so that a joint, or a point of a segment, comes to a point. A newer one of the same drag replaces an
    older one that still waits.
    """

    frame: int
    target: tuple[float, float, float]
    """world [m]"""
    version: int
    joint: str = ""
    """or a bone, and a point in its frame [m]"""
    bone: str = ""
    point: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tag: str = ""
    """of the drag"""


@dataclass(frozen=True)
class SetPin:
    """Let a joint, or a point of a segment, lie at a pixel of a camera's undistorted image. A newer one of the same drag
    replaces an older one that still waits.
    """

    frame: int
    camera: str
    pixel: tuple[float, float]
    version: int
    joint: str = ""
    """or a bone, and a point in its frame [m]"""
    bone: str = ""
    point: tuple[float, float, float] = (0.0, 0.0, 0.0)
    by_images: bool = True
    """what was seen holds the rest of the hand; else it changes least"""
    tag: str = ""
    """of the drag"""


@dataclass(frozen=True)
class DropPins:
    """Drop one of a frame's pins by its place in the list, or all (None)."""

    frame: int
    which: int | None
    version: int
    by_images: bool = True


@dataclass(frozen=True)
class CopyPins:
    """Copy a frame's pins to so many frames before and behind it, moved as what was tracked moves."""

    frame: int
    before: int
    behind: int
    version: int


@dataclass(frozen=True)
class ForgetPose:
    """Drop what was set by hand at a frame; the tracked pose shows again."""

    frame: int
    version: int


@dataclass(frozen=True)
class LookBefore:
    """Show the frame's pose as it was before the last step that changed it, or as it is; a look, no edit."""

    on: bool


@dataclass(frozen=True)
class WantLibrary:
    """Send one client the pose library in pictures."""

    client_id: int


@dataclass(frozen=True)
class RefitWhileTuning:
    """Whether a changed setting or limit fits the frame shown anew at once."""

    on: bool
