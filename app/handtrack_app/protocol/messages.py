"""What the page and the worker say to each other: frozen, picklable, no viser in it.

Commands go to the worker, snapshots come back. The worker is a thread today; because nothing here is shared,
it can become a process without a change to page or worker.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from handtrack.arrays import Bytes, Floats, Ints
from handtrack.geometry.camera import Camera
from handtrack_app.protocol.cloud_messages import (
    CloudCard,
    CloudPicture,
    CloudSnapshot,
    RestoreClouds,
    SampleSkin,
    SaveClouds,
    SetClouds,
    SurfaceSnapshot,
    UseClouds,
    WantCloud,
    WantSurface,
)
from handtrack_app.protocol.guess_messages import FindHand, GuessesSnapshot, TakeGuess
from handtrack_app.protocol.model_card import HAND_REACH_M, PartCard

# ---- commands: page → worker ----------------------------------------------------------------------


@dataclass(frozen=True)
class ShowFrame:
    """Show another frame. A newer one replaces an older one that still waits."""

    frame: int


@dataclass(frozen=True)
class SetPose:
    """Set the whole pose of a frame by hand. A newer one replaces an older one that still waits."""

    frame: int
    values: tuple[float, ...]
    """(S,) joint parameters [m, rad]"""
    version: int
    """counts the user's edits; the answering snapshot carries it back"""


@dataclass(frozen=True)
class TakePose:
    """Replace a frame's pose by another one."""

    frame: int
    source: str
    """`start` (the first-frame pose), `previous` (the frame before), or a pose of the library, for the fingers"""
    version: int


@dataclass(frozen=True)
class PullTip:
    """Bend a finger so that its tip comes to a point. A newer one replaces an older one that still waits."""

    frame: int
    tip: str
    target: tuple[float, float, float]
    """world [m]"""
    version: int


@dataclass(frozen=True)
class ForgetPose:
    """Drop what was set by hand at a frame; the tracked pose shows again."""

    frame: int
    version: int


@dataclass(frozen=True)
class SavePose:
    """Write the pose shown to init.json."""


@dataclass(frozen=True)
class Track:
    """Track frames [start, stop) from the pose at `first` (shown there, set or tracked)."""

    start: int
    stop: int
    first: int
    anew: bool = False
    """start from the first-frame pose as saved, even if its frame was tracked before"""
    version: int = 0
    """of the user's edits, when fitting one frame is one"""


@dataclass(frozen=True)
class FitSize:
    """Fit the hand's size to the frames near the first pose."""


@dataclass(frozen=True)
class Follow:
    """Whether each frame is shown as it is tracked."""

    on: bool


@dataclass(frozen=True)
class Pause:
    """Hold tracking before its next frame, or go on."""

    on: bool


@dataclass(frozen=True)
class Cancel:
    """Stop tracking now; frames tracked so far stay."""


@dataclass(frozen=True)
class SetSetting:
    """Change a setting by its dotted name."""

    name: str
    value: object


@dataclass(frozen=True)
class SaveSettings:
    """Write the settings that session.toml does not have into it."""


@dataclass(frozen=True)
class SetLimits:
    """Change the interval of a joint parameter [m, rad]; None restores the model's own."""

    name: str
    interval: tuple[float, float] | None


@dataclass(frozen=True)
class WantPictures:
    """Which pictures the page shows."""

    thumbnails: bool
    screen: str | None
    """the camera whose picture is on the large screen, if any"""
    paint: str
    """`plain`, `outline`, `residual` or `field`"""


@dataclass(frozen=True)
class Export:
    """Send a file to one client: `csv`, `npz` or `init`."""

    kind: str
    client_id: int


@dataclass(frozen=True)
class SaveTrack:
    """Write tracks/poses.npz."""


Command = (
    ShowFrame | SetPose | TakePose | PullTip | ForgetPose | SavePose | Track | FitSize | Follow | Pause | Cancel | SetSetting
    | SaveSettings | SetLimits | WantPictures | WantSurface | WantCloud | SetClouds | UseClouds | SampleSkin | SaveClouds | RestoreClouds | Export
    | SaveTrack | FindHand | TakeGuess
)  # fmt: skip

# ---- snapshots: worker → page ---------------------------------------------------------------------


@dataclass(frozen=True)
class CameraCard:
    """An undistorted camera as the scene draws it."""

    name: str
    size: tuple[int, int]
    matrix: Floats
    rotation: Floats
    """(3, 3) camera → world"""
    centre: Floats
    """(3,) world [m]"""

    @classmethod
    def of(cls, camera: Camera) -> CameraCard:
        """Return what the scene needs of a camera."""
        rotation = camera.rotation.T.copy()
        return cls(camera.name, camera.size, camera.matrix.copy(), rotation, camera.centre.copy())


@dataclass(frozen=True)
class SessionSnapshot:
    """What is open: everything the page is built from."""

    name: str
    folder: str
    fps: float
    start: int
    stop: int
    first_frame: int
    cameras: tuple[CameraCard, ...]
    parameter_names: tuple[str, ...]
    driven: tuple[str, ...]
    """joint parameters that follow others under this coupling"""
    interval: Floats
    """(S, 2) limits in force [m, rad]"""
    own_interval: Floats
    """(S, 2) the model's own limits"""
    bone_names: tuple[str, ...]
    bone_length: Floats
    ellipsoid_bone: Ints
    radii: Floats
    """(E, 3) [m]"""
    settings: dict[str, object]
    own_settings: dict[str, object]
    """as session.toml has them"""
    has_truth: bool
    model: str
    tip_names: tuple[str, ...]
    pose_names: tuple[str, ...]
    """the pose library"""
    kind: str = "hand"
    """`hand` or `body`"""
    parts: tuple[PartCard, ...] = ()
    """what is drawn of a body instead of ellipsoids"""
    reach_m: float = HAND_REACH_M
    """how far the model extends around its middle: what is drawn is sized by it"""


@dataclass(frozen=True)
class PoseSnapshot:
    """The hand at one frame, ready to draw."""

    frame: int
    version: int
    values: Floats
    """(S,) joint parameters [m, rad]"""
    bone_position: Floats
    bone_rotation: Floats
    """(B, 3) and (B, 3, 3)"""
    centre: Floats
    rotation: Floats
    """ellipsoids: (E, 3) and (E, 3, 3)"""
    tips: Floats
    """(T, 3) fingertips, world [m]"""
    origin: str
    """`set` by hand, `found` by a search and not edited since, `tracked`, or `carried` over from elsewhere"""
    status: int
    """contracts §5, or −1 where nothing was tracked"""
    energy: float
    std: Floats | None
    """(S,) [m, rad]"""
    truth: Floats | None
    """(K, 3) true keypoints, world [m]"""
    error_mm: float
    """mean distance to the truth; NaN without"""
    note: str = ""
    """why the frame is doubtful or lost"""


@dataclass(frozen=True)
class PictureSnapshot:
    """Pictures of one frame, RGB."""

    frame: int
    thumbnails: dict[str, Bytes] = field(default_factory=dict)
    screen: str | None = None
    screen_image: Bytes | None = None


@dataclass(frozen=True)
class StripSnapshot:
    """The whole recording at a glance; rows are frames from `start`."""

    start: int
    status: Ints
    """(F,) contracts §5; −1 untracked"""
    energy: Floats
    error_mm: Floats
    """(F,) NaN where unknown"""
    by_hand: tuple[int, ...]
    """frames whose pose was given, by hand or by a search"""
    terms: dict[str, Floats] = field(default_factory=dict)
    """(F,) the energy's parts in words"""
    found: tuple[int, ...] = ()
    """those of `by_hand` that a search gave"""


@dataclass(frozen=True)
class ProgressSnapshot:
    """What the worker is doing."""

    state: str
    """`opening`, `preparing`, `idle`, `tracking` or `paused`"""
    text: str
    done: int = 0
    total: int = 0
    eta_s: float = 0.0
    job: str = ""
    """`tracking`, `sizing` or `finding`, while one runs"""


@dataclass(frozen=True)
class Notice:
    """Something to tell the user in words."""

    level: str
    """`info`, `done`, `warning` or `error`"""
    title: str
    text: str


@dataclass(frozen=True)
class Download:
    """A file for one client."""

    name: str
    data: bytes
    client_id: int


@dataclass(frozen=True)
class RerunPage:
    """Where rerun's viewer shows the residuals."""

    url: str


Snapshot = (
    SessionSnapshot | PoseSnapshot | PictureSnapshot | StripSnapshot | ProgressSnapshot | Notice | Download
    | RerunPage | SurfaceSnapshot | CloudSnapshot | CloudPicture | CloudCard
    | GuessesSnapshot
)  # fmt: skip
