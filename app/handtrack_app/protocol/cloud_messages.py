"""What page and worker say to each other about clouds and the solver's surface: frozen, picklable."""

from __future__ import annotations

from dataclasses import dataclass

from handtrack.arrays import Bytes, Floats, Ints
from handtrack.session.clouds_settings import CloudSettings

# ---- commands: page → worker ----------------------------------------------------------------------


@dataclass(frozen=True)
class WantSurface:
    """Whether the page shows the solver's surface."""

    on: bool


@dataclass(frozen=True)
class WantCloud:
    """What the page shows of point clouds; nothing else is computed."""

    points: bool = False
    dropped: bool = False
    """also the points that a filter dropped"""
    picture: str = "none"
    """`images`, `stereo` or `none`"""
    wide: bool = False
    pair: tuple[str, str] | None = None
    """cameras of the stereo preview; None: the session's first pair"""
    box: tuple[str, tuple[int, int, int, int]] | None = None
    """camera and x, y, w, h [px] of the marked patch of skin"""


@dataclass(frozen=True)
class SetClouds:
    """Change settings of [clouds] by name; None: as it is usual, False: off."""

    values: tuple[tuple[str, object], ...]


@dataclass(frozen=True)
class UseClouds:
    """Take these settings of [clouds], all of them: undo."""

    settings: CloudSettings | None


@dataclass(frozen=True)
class SampleSkin:
    """Fit the skin's ellipse to a box x, y, w, h [px] of a camera's image of a frame."""

    frame: int
    camera: str
    box: tuple[int, int, int, int]
    size: float


@dataclass(frozen=True)
class SaveClouds:
    """Write the settings of [clouds] into session.toml."""


@dataclass(frozen=True)
class RestoreClouds:
    """Go back to the settings of [clouds] as session.toml has them."""


# ---- snapshots: worker → page ---------------------------------------------------------------------


@dataclass(frozen=True)
class SurfaceSnapshot:
    """The solver's surface at one pose."""

    frame: int
    version: int
    vertices: Floats
    """(V, 3) world [m]"""
    faces: Ints


@dataclass(frozen=True)
class FilterCount:
    """What one filter did to a cloud."""

    name: str
    text: str
    before: int
    after: int


@dataclass(frozen=True)
class CloudSnapshot:
    """The cloud of one frame, as the tracker gets it, against the hand shown."""

    frame: int
    points: Floats
    """(N, 3) world [m]; of very many, a random part"""
    colors: Bytes | None
    """(N, 3) RGB"""
    residual_mm: Floats
    """(N,) distance to the model's surface, negative inside; NaN where there is no such surface"""
    dropped: Floats
    """(M, 3) world [m] points that a filter dropped, thinned ones not among them"""
    measured: int
    left: int
    counts: tuple[FilterCount, ...] = ()
    words: str = ""
    """what is to be said of it"""


@dataclass(frozen=True)
class CloudPicture:
    """The picture of the cloud panel."""

    frame: int
    image: Bytes
    """(H, W, 3) RGB"""
    wide: bool
    words: str


@dataclass(frozen=True)
class CloudCard:
    """Where clouds come from and the settings in force."""

    source: str
    """`stereo`, `depth`, `files`, or empty: this session has no clouds"""
    values: dict[str, object]
    """settings of [clouds] in force by name, with the usual ones filled in; None is off"""
    image_cameras: tuple[str, ...]
    pairs: tuple[tuple[str, str], ...]
    """pairs of cameras that can be matched"""
    pair: tuple[str, str] | None
    """the first pair in use"""
    sizes: dict[str, tuple[int, int]]
    """width and height of the cameras' images [px]"""
    unsaved: tuple[str, ...]
    """settings that differ from session.toml"""
    settings: CloudSettings | None = None
    """the settings in force as they are"""
