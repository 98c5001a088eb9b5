"""What the engine tells the page: snapshots, frozen and picklable, with no viser in them."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field

import numpy as np

from handtrack.arrays import D2, D3, B, Bytes, E, Floats, H, Ints, J, K, M, N, S, T, V, W
from handtrack.errors import not_enough_memory
from handtrack.geometry.camera import Camera
from handtrack.model.shape import ShapeNumber
from handtrack.session.clouds_settings import CloudSettings
from handtrack_app.protocol.comparing import ComparedSnapshot, CurvesSnapshot
from handtrack_app.protocol.library import LibrarySnapshot, PoseName
from handtrack_app.protocol.log_file import ENGINE_LOG
from handtrack_app.protocol.masks import MaskCard, MaskPicture
from handtrack_app.protocol.score import ScoreSnapshot
from handtrack_app.protocol.timeline import TimelineChange, TimelineSnapshot

BEFORE = "before"
"""what a pose is that was looked at as it was before the last step, and holds no more"""
HAND_REACH_M = 0.11
"""how far a hand extends around its middle"""


@dataclass(frozen=True)
class PartCard:
    """A part of a body as the scene draws it: a closed mesh, fixed to a bone."""

    bone: int
    vertices: Floats[V, D3]
    """in that bone's frame [m]"""
    faces: Ints[T, D3]


@dataclass(frozen=True)
class CameraCard:
    """An undistorted camera as the scene draws it."""

    name: str
    size: tuple[int, int]
    matrix: Floats[D3, D3]
    rotation: Floats[D3, D3]
    """camera → world"""
    centre: Floats[D3]
    """world [m]"""

    @classmethod
    def of(cls, camera: Camera) -> CameraCard:
        """Return what the scene needs of a camera."""
        rotation = camera.rotation.T.copy()
        return cls(camera.name, camera.size, camera.matrix.copy(), rotation, camera.centre.copy())


SILHOUETTES, CLOUD, KEYPOINTS, IMAGES = "silhouettes", "cloud", "keypoints", "images"
SEEN = frozenset({SILHOUETTES, CLOUD, KEYPOINTS, IMAGES})
"""kinds of what a recording can show of the model"""


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
    scene_centre: Floats[D3]
    """where the cameras look, world [m]"""
    parameter_names: tuple[str, ...]
    driven: tuple[str, ...]
    """joint parameters that follow others under this coupling"""
    interval: Floats[S, D2]
    """limits in force [m, rad]"""
    own_interval: Floats[S, D2]
    """the model's own limits"""
    bone_names: tuple[str, ...]
    bone_length: Floats[B]
    ellipsoid_bone: Ints[E]
    radii: Floats[E, D3]
    """[m]"""
    settings: dict[str, object]
    own_settings: dict[str, object]
    """as session.toml has them"""
    has_truth: bool
    model: str
    joint_names: tuple[str, ...]
    stem_bones: tuple[str, ...]
    """of no finger or limb: a drag of them moves the whole"""
    poses: tuple[PoseName, ...]
    """the pose library"""
    kind: str = "hand"
    """`hand` or `body`"""
    seen: frozenset[str] = SEEN
    """of SEEN, what there is in the recording"""
    parts: tuple[PartCard, ...] = ()
    """what is drawn of a body instead of ellipsoids"""
    reach_m: float = HAND_REACH_M
    """how far the model extends around its middle: what is drawn is sized by it"""
    live: bool = False
    """whether its frames come from running cameras"""
    size_pending: bool = False
    """the hand's size is still to be fitted"""
    size: float = 1.0
    """of a mean adult's; that of the model in force"""
    shape: tuple[ShapeNumber, ...] = ()
    """of the model's person, number by number"""
    offered_size: float | None = None
    """likewise, fitted after tracking and not taken yet"""
    offered_words: str = ""
    """its length, how well that is known, and whether people have such hands"""


@dataclass(frozen=True)
class PinCard:
    """A pin of the frame shown, and how the pose meets it."""

    camera: str
    words: str
    """what is pinned"""
    pixel: tuple[float, float]
    """of the camera's undistorted image"""
    place: tuple[float, float, float]
    """where the pose has it, world [m]"""
    meant: tuple[float, float, float]
    """the nearest place on the pin's ray"""
    off_px: float

    @property
    def off_m(self) -> float:
        """How far the pose has it from the pin's ray [m]."""
        return float(np.linalg.norm(np.subtract(self.place, self.meant)))


@dataclass(frozen=True)
class PoseSnapshot:
    """The hand at one frame, ready to draw."""

    frame: int
    version: int
    values: Floats[S]
    """joint parameters [m, rad]"""
    bone_position: Floats[B, D3]
    bone_rotation: Floats[B, D3, D3]
    centre: Floats[E, D3]
    rotation: Floats[E, D3, D3]
    """of ellipsoids"""
    origin: str
    """`set` by hand, `pinned`: where pins led, `refitted`: where settings led, `found` by a search and not edited since, `tracked`,
    `carried` over from elsewhere, or `BEFORE`
    """
    status: int
    """contracts §5, or −1 where nothing was tracked"""
    energy: float
    std: Floats[S] | None
    """[m, rad]"""
    truth: Floats[K, D3] | None
    """true keypoints, world [m]"""
    error_mm: float
    """mean distance to the truth; NaN without"""
    note: str = ""
    """why the frame is doubtful or lost"""
    joints: Floats[J, D3] = field(default_factory=lambda: np.zeros((0, 3)))
    """world [m]"""
    pins: tuple[PinCard, ...] = ()
    accepted: bool = False
    """no tracking changes it"""
    beside: tuple[PictureSnapshot | MaskPicture, ...] | None = None
    """of a frame that is played: its pictures; None: they come later"""

    @property
    def middle(self) -> Floats[D3]:
        """The middle of the hand [m]: of its ellipsoids near the palm and fingers."""
        return np.median(self.centre, axis=0)


@dataclass(frozen=True)
class PictureSnapshot:
    """Pictures of one frame, RGB."""

    frame: int
    thumbnails: dict[str, Bytes[H, W, D3]] = field(default_factory=dict)
    sheet: Bytes[H, W, D3] | None = None
    """the thumbnails side by side"""
    screens: dict[tuple[str, str], Bytes[H, W, D3]] = field(default_factory=dict)
    """large, by camera and what is painted over it"""
    version: int = 0
    """of the user's edits, as the pose that is painted over them"""


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
    """`tracking`, `sizing`, `finding` or `carrying`, while one runs"""
    frame: int | None = None
    """the frame that was tracked last"""


@dataclass(frozen=True)
class LiveCameraCard:
    """What became of one running camera's images since tracking began."""

    name: str
    used: int
    dropped: int
    """came while an earlier frame was still worked on"""
    missing: int
    """frames in which it showed nothing in time"""
    gone: str
    """why it gives no more images; empty while it does"""


@dataclass(frozen=True)
class LiveSnapshot:
    """How it goes with running cameras."""

    cameras: tuple[LiveCameraCard, ...]
    recording: str
    """the folder; empty while nothing is recorded"""
    recorded: int
    """frames"""


@dataclass(frozen=True)
class Notice:
    """Something to tell the user in words."""

    level: str
    """`info`, `done`, `guide` (what to do first), `warning` or `error`"""
    title: str
    text: str

    @classmethod
    def of_mistake(cls, error: object, title: str = "Internal error") -> Notice:
        """Return what the user is told of a mistake of ours; a lack of memory is none."""
        if isinstance(error, MemoryError):
            return cls("error", "Not enough memory", str(not_enough_memory("This", error)))
        what = error if isinstance(error, str) else f"{type(error).__name__}: {error}"
        text = f"Something went wrong inside handtrack ({what}). Your poses are safe. Details are in {ENGINE_LOG}."
        return cls("error", title, text)


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


@dataclass(frozen=True)
class Guess:
    """One pose of the list."""

    share: float
    """0 to 1: how probable it is held to be"""
    words: str


@dataclass(frozen=True)
class GuessesSnapshot:
    """Poses that explain a frame, the surest first, and their bones to be drawn."""

    frame: int
    kind: str
    """`found` without a first pose, `carried` by the tracker, or empty: there are none"""
    guesses: tuple[Guess, ...] = ()
    owner: Ints[N] = field(default_factory=lambda: np.zeros(0, np.int64))
    """the guess that each bone belongs to"""
    position: Floats[N, D3] = field(default_factory=lambda: np.zeros((0, 3)))
    """where bones begin, world [m]"""
    rotation: Floats[N, D3, D3] = field(default_factory=lambda: np.zeros((0, 3, 3)))
    """bone → world; bones lie along y"""
    length: Floats[N] = field(default_factory=lambda: np.zeros(0))
    """[m]"""
    is_new: bool = False
    """just found: the surest is to be taken"""


@dataclass(frozen=True)
class SurfaceSnapshot:
    """The solver's surface at one pose."""

    frame: int
    version: int
    vertices: Floats[V, D3]
    """world [m]"""
    faces: Ints[T, D3]


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
    points: Floats[N, D3]
    """world [m]; of very many, a random part"""
    colors: Bytes[N, D3] | None
    """RGB"""
    residual_mm: Floats[N]
    """distance to the model's surface, negative inside; NaN where there is no such surface"""
    dropped: Floats[M, D3]
    """world [m] points that a filter dropped, thinned ones not among them"""
    measured: int
    left: int
    counts: tuple[FilterCount, ...] = ()
    words: str = ""
    """what is to be said of it"""


@dataclass(frozen=True)
class CloudPicture:
    """The picture of the cloud panel."""

    frame: int
    image: Bytes[H, W, D3]
    """RGB"""
    wide: bool
    words: str


@dataclass(frozen=True)
class CloudSelection:
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


@dataclass(frozen=True)
class TakeCard:
    """One tracking of the session."""

    number: int
    words: str
    """when, which frames, how large"""
    shown: int
    """how many of its frames are of the current track"""


@dataclass(frozen=True)
class WorkSnapshot:
    """What is on disk of the user's work."""

    saved: str
    """`saved`, `saving`, `unsaved` (it could not be written, and is tried again) or `kept nowhere`; empty of a live session"""
    takes: tuple[TakeCard, ...]
    """the latest first"""
    written: int = 0
    """the number of the last call that is on disk, as are all before it: `calls.Call`"""
    done: int = 0
    """of the last that was done, on disk or not"""
    past: tuple[str, ...] = ()
    """what undo takes back, the latest first; of many steps the latest"""
    undone: tuple[str, ...] = ()
    """what redo makes again, likewise"""


@dataclass(frozen=True)
class Shown:
    """There is something to be looked at, or why not."""

    failure: Exception | None


@dataclass(frozen=True)
class Opened:
    """The session can be worked in, or why not."""

    failure: Exception | None


Snapshot = (
    SessionSnapshot | PoseSnapshot | PictureSnapshot | TimelineSnapshot | TimelineChange | ProgressSnapshot | Notice
    | Download | RerunPage | SurfaceSnapshot | CloudSnapshot | CloudPicture | CloudCard
    | ComparedSnapshot | CurvesSnapshot | ScoreSnapshot | LibrarySnapshot | MaskCard | MaskPicture | GuessesSnapshot | LiveSnapshot | WorkSnapshot
    | Shown | Opened
)  # fmt: skip


def kind_of(snapshot: object) -> Hashable | None:
    """Return what a newer snapshot has in common with one that still waits, and that it replaces; None: it replaces none. Of progress
    each state is told: who waits for a job's beginning or end misses neither, however quick the job.
    """
    if isinstance(snapshot, Notice | Download | TimelineChange):
        return None
    return type(snapshot), snapshot.state if isinstance(snapshot, ProgressSnapshot) else ""
