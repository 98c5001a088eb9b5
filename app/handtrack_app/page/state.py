"""What the user has chosen: plain data, no viser."""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass, field


@dataclass
class Display:
    """What is drawn."""

    mode: str = "Flesh"
    """`Flesh`, `Surface`, `Skeleton`, `Field` or `All`"""
    cameras: bool = True
    images: bool = True
    truth: bool = True
    handle: bool = True
    opacity: float = 1.0
    paint: str = "outline"
    """over the cameras' small pictures: `plain`, `outline`, `residual` or `field`"""
    ghosts: bool = True
    """poses that the frame may have, besides the one shown"""
    cloud: bool = True
    cloud_colour: str = "residual"
    """`residual` (distance to the model), `own` or `plain`"""
    cloud_size_mm: float = 1.6
    cloud_dropped: bool = False
    """also the points that a filter dropped"""
    cloud_picture: str = "images"
    """`images`, `stereo` or `none`"""
    cloud_wide: bool = False
    stereo_pair: tuple[str, str] | None = None
    hidden: bool = False
    """nothing is drawn of the model, for a look at the bare image"""
    masks: bool = False
    """over all cameras' small pictures"""
    skin_box: tuple[str, tuple[int, int, int, int]] | None = None
    """camera and x, y, w, h [px] of the marked patch of skin"""

    @property
    def flesh(self) -> bool:
        return self.mode in ("Flesh", "All")

    @property
    def surface(self) -> bool:
        return self.mode == "Surface"

    @property
    def skeleton(self) -> bool:
        return self.mode in ("Skeleton", "All")

    @property
    def field(self) -> bool:
        return self.mode in ("Field", "All")


@dataclass(frozen=True)
class Look:
    """What one page sees through, whatever others do."""

    through: str | None = None
    """a camera; None: it looks freely"""
    paint: str = "outline"
    """over the camera's image: `plain`, `outline`, `residual` or `mask`"""


@dataclass(frozen=True)
class PoseEdit:
    """A frame's pose as the user just set it."""

    frame: int
    values: tuple[float, ...]
    """(S,) joint parameters [m, rad]"""
    version: int


@dataclass
class UserState:
    """The page's side of the truth. Callbacks run on many threads: hold `lock` for more than one field."""

    names: tuple[str, ...] = ()
    frame: int = 0
    start: int = 0
    stop: int = 1
    values: tuple[float, ...] = ()
    """(S,) joint parameters as the user last set or saw them [m, rad]"""
    values_at: int | None = None
    """the frame that they are of"""
    version: int = 0
    looks_before: bool = False
    """the pose shown is as it was before the last step; `values` are as it is"""
    playing: bool = False
    tracking: bool = False
    """a job runs: what is only shown gives way"""
    speed: float = 1.0
    follow: bool = True
    """the view follows the tracker"""
    editor: int | None = None
    """the client whose changes count"""
    display: Display = field(default_factory=Display)
    looks: dict[int, Look] = field(default_factory=dict)
    """by client, of those that chose"""
    lock: threading.RLock = field(default_factory=threading.RLock)

    def value_of(self, name: str) -> float:
        """Return a joint parameter as the user last set or saw it [m, rad]."""
        with self.lock:
            return (
                self.values[self.names.index(name)] if self.values and name in self.names else 0.0
            )

    def look(self, client: int | None) -> Look:
        """Return what a page sees through."""
        return Look() if client is None else self.looks.get(client, Look())

    def edit(self, changes: dict[str, float]) -> PoseEdit | None:
        """Change joint parameters by name [m, rad]; return the new pose, None if nothing is valid or new."""
        with self.lock:
            valid = {
                n: float(v) for n, v in changes.items() if n in self.names and math.isfinite(v)
            }
            if not self.values or not valid:
                return None
            values = tuple(valid.get(n, v) for n, v in zip(self.names, self.values, strict=True))
            if values == self.values:
                return None
            self.values = values
            if (
                self.values_at is not None
            ):  # while it was played, the next frame was asked for already
                self.frame = self.values_at
            return PoseEdit(self.frame, values, self.begin_edit())

    def begin_edit(self) -> int:
        """Return the version of an edit that begins: poses shown before it no longer move the page's widgets."""
        with self.lock:
            self.version += 1
            self.follow = self.playing = False  # no frame comes over who edits
            return self.version

    def clamp_frame(self, frame: float) -> int | None:
        """Return a frame of the session for any number from a client; None for no number."""
        if not math.isfinite(frame):
            return None
        return int(min(max(round(frame), self.start), self.stop - 1))
