"""What page and engine say to each other. The page calls methods that the engine marks as a `Command`; the engine answers by snapshots, frozen
and picklable, with no viser in them.
"""

from __future__ import annotations

import inspect
import logging
import threading
from collections import deque
from collections.abc import Callable, Hashable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Generic, Literal, NamedTuple, TypeVar

import numpy as np

from handtrack.arrays import D2, D3, Array, B, Bytes, E, F, Floats, H, Ints, J, K, N, S, T, V, W
from handtrack.capture.clouds.cloud_filters import FilterReport
from handtrack.diagnostics.review import ReviewInterval
from handtrack.errors import HandtrackError, not_enough_memory
from handtrack.geometry.camera import Camera
from handtrack.model.shape import ShapeNumber
from handtrack.store.history import Span
from handtrack_app.log import ENGINE_LOG

# ---- Calls of the page: a method's name and its arguments, picklable


Method = TypeVar("Method", bound=Callable[..., Any])


@dataclass(frozen=True)
class Command:
    """Marks a method that the page may call: how its calls are treated before it runs."""

    latest: tuple[str, ...] | None = None
    """of waiting calls that are equal in these arguments (of a mapping: in its keys) the newest replaces the older ones; None: each is
    served"""
    edits: bool = False
    """it changes what is kept of the session: it is on disk, repeated, or named as lost"""
    job: bool = False
    """it takes long; once sent it is not repeated unasked"""
    view: bool = False
    """a subscription of the page: the latest is repeated to an engine that begins again"""
    is_ordered: bool = False
    """later edits depend on it: it is repeated in its turn"""
    tunes: bool = False
    """it changes what is tracked by: never while a job runs, and what holds then is shown"""
    files: bool = False
    """it writes files of the session, which a live one does not have"""
    signature: inspect.Signature = inspect.Signature()
    at_once: str = ""
    """the method of JobControl that acts as the call comes, before its turn, by the call's arguments"""

    def __call__(self, method: Method) -> Method:
        whole = inspect.signature(method)
        signature = whole.replace(parameters=[*whole.parameters.values()][1:])
        method.command = replace(self, signature=signature)  # type: ignore[attr-defined]
        return method


Commands = Mapping[str, Command]


def commands_of(*classes: type) -> dict[str, Command]:
    """Return all marked methods' commands by name."""
    return {
        name: command
        for cls in classes
        for name in dir(cls)
        if (command := getattr(getattr(cls, name), "command", None)) is not None
    }


@dataclass(frozen=True)
class Call:
    """A method of the engine with its arguments by name."""

    name: str
    arguments: Mapping[str, Any]
    command: Command = field(compare=False, repr=False)
    number: int = 0
    """counts a page's calls from 1; the engine reports up to which all is on disk (`WorkSnapshot.written`)"""

    @classmethod
    def of(
        cls, commands: Commands, name: str, given: tuple[Any, ...], named: Mapping[str, Any]
    ) -> Call:
        """Return a call. Raises TypeError for a name or argument that the engine does not have."""
        if name not in commands:
            raise TypeError(f"the engine has no command {name}.")
        return cls(name, commands[name].signature.bind(*given, **named).arguments, commands[name])

    @property
    def key(self) -> Hashable | None:
        """What it has in common with the waiting calls that it replaces; None: it replaces none."""
        if self.command.latest is None:
            return None
        values = (self.arguments.get(name) for name in self.command.latest)
        return self.name, *(tuple(v) if isinstance(v, Mapping) else v for v in values)

    @property
    def is_kept(self) -> bool:
        """Whether the page keeps it until the engine has done it."""
        return self.command.edits or self.command.job or self.command.is_ordered

    @property
    def is_step(self) -> bool:
        """Whether it depends on all calls before it, or those after it on it: none is moved past it."""
        return self.key is None and self.is_kept

    @property
    def words(self) -> str:
        """What it is about, to be named when it is lost."""
        given, spans = self.arguments, self.arguments.get("spans", ())
        if "stop" in given:
            spans = [(given["start"], given["stop"] - 1)]
        elif given.get("frame") is not None:
            spans = [(given["frame"], given["frame"])]
        about = [str(given[one]) for one in ("name", "camera", "number") if given.get(one)]
        words = " ".join([self.name.replace("_", " "), *about])
        return f"{words}, {_frames(spans)}" if spans else words


def _frames(spans: Iterable[tuple[int, int]]) -> str:
    """Return spans of frames, each first to last, in words."""
    named = [str(first) if first == last else f"{first} to {last}" for first, last in spans]
    one = len(named) == 1 and named[0].isdigit()
    return f"frame{'' if one else 's'} {', '.join(named)}"


class Caller:
    """Makes a call of each method that is called on it; the page has it as the engine (`Engine`)."""

    def __init__(self, send: Callable[[str, tuple[Any, ...], Mapping[str, Any]], None]) -> None:
        self._send = send

    def __getattr__(self, name: str) -> Callable[..., None]:
        if name.startswith("_"):
            raise AttributeError(name)
        return lambda *given, **named: self._send(name, given, named)


# ---- A queue that keeps only the newest of each kind where only the newest counts

Item = TypeVar("Item")


class Mailbox(Generic[Item]):
    """Thread-safe queue. Items with an equal `kind` (not None) replace one another: the latest wins."""

    def __init__(
        self,
        kind: Callable[[Item], Hashable | None],
        is_step: Callable[[Item], bool] = lambda _: False,
    ) -> None:
        """is_step: whether an item stays between what came before and after it: nothing from before it is replaced."""
        self._kind, self._is_step = kind, is_step
        self._items: deque[Item] = deque()
        self._ready = threading.Condition()
        self._closed = False

    def close(self) -> None:
        """Let nobody wait for an item any more; those that are there can still be taken."""
        with self._ready:
            self._closed = True
            self._ready.notify_all()

    def put(self, item: Item) -> None:
        """Add an item at the end, dropping a waiting one that it replaces."""
        kind = self._kind(item)
        with self._ready:
            if kind is not None:
                for place in range(len(self._items) - 1, -1, -1):
                    old = self._items[place]
                    if self._kind(old) == kind:
                        del self._items[place]
                        break
                    if self._is_step(old):
                        break
            self._items.append(item)
            self._ready.notify()

    def take(self, timeout: float | None = None) -> Item | None:
        """Return the oldest item, or None when `timeout` [s] has passed, or the box is empty and closed."""
        with self._ready:
            self._ready.wait_for(lambda: self._items or self._closed, timeout)
            return self._items.popleft() if self._items else None

    def __len__(self) -> int:
        return len(self._items)


# ---- The engine, as the page calls it


if TYPE_CHECKING:  # the page's process has no use for what the engine imports
    from handtrack_app.engine.camera_pictures import Painter
    from handtrack_app.engine.cloud_service import CloudService
    from handtrack_app.engine.job_control import JobControl
    from handtrack_app.engine.mask_service import MaskService
    from handtrack_app.engine.open_session import OpenSession
    from handtrack_app.engine.posing_service import PosingService
    from handtrack_app.engine.review_service import ReviewService
    from handtrack_app.engine.tuning_service import TuningService

    class Engine(  # type: ignore[misc]
        OpenSession,
        JobControl,
        PosingService,
        TuningService,
        ReviewService,
        Painter,
        CloudService,
        MaskService,
    ): ...
else:
    Engine = object


# ---- What the engine tells the page: snapshots


Image = Bytes[H, W, D3]
"""red, green, blue"""
Box = tuple[int, int, int, int]
"""x, y, width, height [px] in an image"""


@dataclass(frozen=True)
class ScoreSnapshot:
    """The score of one pose, and of the one that was fitted to its frame last."""

    frame: int
    values: tuple[float, ...]
    """(S,) joint parameters of the pose that it is of [m, rad]"""
    overlap: dict[str, float]
    """with the masks, 0 to 1, by camera"""
    energy: dict[str, float]
    """by its parts in words"""
    fitted_overlap: dict[str, float] | None = None
    """None: nothing was fitted there"""
    fitted_cost: float | None = None

    def is_of(self, frame: int, values: Floats[S]) -> bool:
        """Return whether it is of a pose, joint parameters [m, rad], and no other."""
        return (self.frame, self.values) == (frame, tuple(values.tolist()))


# ---- Masks


FileKind = Literal["setting", "clouds", "masks"]
"""of what session.toml can say of what is decided in the workbench"""
FILES, NO_MASKS = "files", "none"
"""in place of a method: files that session.toml names; no masks"""


@dataclass(frozen=True)
class MaskCameraCard:
    """Where one camera's masks come from."""

    name: str
    method: str
    """a method's name, `files` or `none`"""
    values: dict[str, object]
    """the method's settings in force"""
    roi: Box | None
    possible: tuple[str, ...]
    """methods that it has what it takes for"""


@dataclass(frozen=True)
class PictureSnapshot:
    """Pictures of one frame, RGB."""

    frame: int
    thumbnails: dict[str, Image] = field(default_factory=dict)
    screens: dict[tuple[str, str], Image] = field(default_factory=dict)
    """large, by camera and what is painted over it"""
    masks: dict[str, Image] = field(default_factory=dict)
    """small, the masks painted over the images"""
    corrected: dict[str, str] = field(default_factory=dict)
    """by camera of which a mask was made: whether this frame is corrected and how many are, in words"""
    problems: list[str] = field(default_factory=list)
    """why masks could not be made"""


# ---- The course of joint parameters


@dataclass(frozen=True)
class Curve:
    """The course of a joint parameter over the recording [m, rad]; NaN where it is not known."""

    name: str
    values: Floats[F]
    std: Floats[F]
    truth: Floats[N]
    """(F,), or empty where there is none"""


@dataclass(frozen=True)
class CurvesSnapshot:
    """Courses of joint parameters."""

    curves: tuple[Curve, ...]


@dataclass(frozen=True)
class CloseSnapshot:
    """Small pictures RGB of frames as they are tracked, close to the model and with its outline."""

    pictures: dict[int, Image]


# ---- The timeline: the whole recording, and what is new of it


COST, ERROR, PROBABILITY, VIEWS, MOVED = "cost", "error mm", "P(error)", "views", "changed mm"
"""lanes: a frame's cost; the error against the truth; how probably a joint is 25 mm off; the views that the cost is of; how far the
take that shows moved a joint from the one below it"""
TERM = "cost: "
"""before the words of a part of the cost: a lane, too"""


@dataclass(frozen=True)
class TimelineSnapshot:
    """The whole recording at a glance; rows are frames from `start`."""

    start: int
    status: Ints[F]
    """contracts §5; −1 untracked"""
    lanes: Mapping[str, Floats[F]]
    """numbers by their words, NaN where unknown; those of which something is known"""
    by_hand: tuple[int, ...] = ()
    """frames whose pose was given, by hand or by a search"""
    searched: tuple[int, ...] = ()
    """those of `by_hand` that a search gave"""
    accepted: frozenset[int] = frozenset()
    """frames that no tracking changes"""
    intervals: tuple[ReviewInterval, ...] = ()
    """worth a look, the worst first"""
    takes: tuple[Span, ...] = ()
    """what the track is composed of, ascending"""
    hidden: tuple[Span, ...] = ()
    """likewise, of takes that cannot show: they were tracked with another model than the one in force"""
    is_posed: bool = False
    """somebody said where the model is: by a first pose, by hand, or by tracking"""
    cameras_off: Mapping[str, str] = field(default_factory=dict)
    """by how much cameras are surely off, in words, by their names: what can be corrected"""
    cameras_corrected: Mapping[str, str] = field(default_factory=dict)
    """by how much others are corrected"""

    @property
    def stop(self) -> int:
        """The end of the frames."""
        return self.start + len(self.status)

    @property
    def has_poses(self) -> bool:
        """Whether a frame was tracked or set."""
        return bool((self.status >= 0).any() or self.by_hand)


@dataclass(frozen=True)
class TimelineChange:
    """Some rows of the timeline anew, while tracking goes on: what is told does not grow with the recording."""

    frames: range
    """of the whole timeline"""
    row: Ints[N]
    status: Ints[N]
    lanes: Mapping[str, Floats[N]]

    def over(self, strip: TimelineSnapshot) -> TimelineSnapshot:
        """Return a timeline with these rows; as it was if it is of other frames, as a whole one is on its way then."""
        if self.frames != range(strip.start, strip.stop):
            return strip

        def put(values: Array[F], new: Array[N]) -> Array[F]:
            whole = values.copy()
            whole[self.row] = new
            return whole

        unknown = np.full(len(strip.status), np.nan)
        lanes = {word: put(strip.lanes.get(word, unknown), new) for word, new in self.lanes.items()}
        return replace(strip, status=put(strip.status, self.status), lanes={**strip.lanes, **lanes})


# ---- The session, and the pose shown


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


SILHOUETTES, CLOUD, KEYPOINTS, IMAGES = "silhouettes", "cloud", "keypoints", "images"
OBSERVED = frozenset({SILHOUETTES, CLOUD, KEYPOINTS, IMAGES})
"""kinds of what a recording can show of the model"""


@dataclass(frozen=True)
class CloudCard:
    """Where clouds come from and the settings in force."""

    source: str
    """`stereo`, `depth`, `files`, or empty: this session has no clouds"""
    values: dict[str, object]
    """settings of [clouds] in force by name, with the usual ones filled in; None is off"""
    image_cameras: tuple[str, ...]
    pairs: tuple[tuple[str, str], ...]
    """pairs of cameras that can be matched, those in use first"""

    @property
    def pair(self) -> tuple[str, str] | None:
        """The first pair."""
        return next(iter(self.pairs), None)


@dataclass(frozen=True)
class SessionSnapshot:
    """What is open: everything the page is built from."""

    name: str
    folder: str
    fps: float
    first_frame: int
    cameras: tuple[Camera, ...]
    """undistorted"""
    clouds: CloudCard
    masks: tuple[MaskCameraCard, ...]
    mask_words: str
    """what is to be said of where masks come from"""
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
    unsaved: Mapping[FileKind, tuple[str, ...]]
    """of each kind the names of what differs from session.toml: settings, those of [clouds], and cameras whose masks do"""
    has_truth: bool
    model: str
    joint_names: tuple[str, ...]
    stem_bones: tuple[str, ...]
    """of no finger or limb: a drag of them moves the whole"""
    poses: Mapping[str, str]
    """the pose library: what a pose is called → its name"""
    kind: str
    """`hand` or `body`"""
    observed: frozenset[str]
    """of OBSERVED, what there is in the recording"""
    parts: tuple[PartCard, ...]
    """what is drawn of a body instead of ellipsoids"""
    reach_m: float
    """how far the model extends around its middle: what is drawn is sized by it"""
    live: bool
    """whether its frames come from running cameras"""
    size_pending: bool
    """the hand's size is still to be fitted"""
    shape: tuple[ShapeNumber, ...]
    """of the model's person, number by number"""

    @property
    def can_be_found(self) -> bool:
        """Whether there is what a search for the model looks at."""
        return self.kind == "hand" or KEYPOINTS in self.observed


class Hold(NamedTuple):
    """A place of the model that is taken hold of: a joint; or a bone, and a point in its frame [m]."""

    joint: str = ""
    bone: str = ""
    point: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def words(self) -> str:
        """What it is."""
        return (self.joint or self.bone).replace("_", " ")


@dataclass(frozen=True)
class PinCard:
    """A pin of the frame shown, and how the pose meets it."""

    camera: str
    words: str
    """what is pinned"""
    pixel: tuple[float, float]
    """of the camera's undistorted image"""
    place: Floats[D3]
    """where the pose has it, world [m]"""
    meant: Floats[D3]
    """the nearest place on the pin's ray"""
    off_px: float

    @property
    def off_m(self) -> float:
        """How far the pose has it from the pin's ray [m]."""
        return float(np.linalg.norm(self.place - self.meant))


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
    note: str
    """why the frame is doubtful or lost"""
    joints: Floats[J, D3]
    """world [m]"""
    pins: tuple[PinCard, ...]
    accepted: bool
    """no tracking changes it"""
    beside: tuple[PictureSnapshot, ...] | None = None
    """of a frame that is played: its pictures; None: they come later"""

    @property
    def middle(self) -> Floats[D3]:
        """The middle of the hand [m]: of its ellipsoids near the palm and fingers."""
        return np.median(self.centre, axis=0)


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

    @property
    def is_busy(self) -> bool:
        """Whether a job runs."""
        return self.state in ("tracking", "paused", "preparing")


COUNTED = ("used", "dropped", "missing")
"""what becomes of running cameras' images: the second came while an earlier frame was still worked on; the third are frames in which
a camera showed nothing in time
"""


@dataclass(frozen=True)
class LiveSnapshot:
    """How it goes with running cameras."""

    counts: Mapping[str, Mapping[str, int]]
    """by camera its images of each kind of COUNTED since tracking began"""
    gone: Mapping[str, str]
    """by camera why it gives no more images; empty while it does"""
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
    of_recording: bool = False
    """about the recording itself, such as a contradicting camera: holds until it is tracked anew"""
    client_id: int | None = None
    """of the page that alone shows a notification of what is done; None: all do"""

    @classmethod
    def about_recording(cls, text: str) -> Notice:
        """Return a warning about the recording itself."""
        return cls("warning", "About this recording", text, of_recording=True)

    @classmethod
    def of_error(cls, error: Exception, title: str) -> Notice:
        """Return what the user is told of an error, for the page must go on: its own words; of a mistake of ours, which is logged, that it
        is one.
        """
        if isinstance(error, MemoryError):
            return cls("error", "Not enough memory", str(not_enough_memory("This", error)))
        if isinstance(error, HandtrackError):
            return cls("error", title, str(error))
        logging.getLogger(__name__).error("internal error", exc_info=error)
        what = f"{type(error).__name__}: {error}"
        text = f"Something went wrong inside handtrack ({what}). Your poses are safe. Details are in {ENGINE_LOG}."
        return cls("error", "Internal error", text)


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
class CloudSnapshot:
    """The cloud of one frame, as the tracker gets it, against the hand shown."""

    frame: int
    points: Floats[N, D3]
    """world [m]; of very many, a random part"""
    colors: Bytes[N, D3] | None
    """RGB"""
    residual_mm: Floats[N]
    """distance to the model's surface, negative inside; NaN where there is no such surface"""
    measured: int
    left: int
    counts: tuple[FilterReport, ...]
    words: str
    """what is to be said of it"""


@dataclass(frozen=True)
class CloudPicture:
    """The picture of the cloud panel."""

    frame: int
    images: dict[str, Image]
    """RGB, by what they show"""
    wide: bool
    words: str


@dataclass(frozen=True)
class CloudSelection:
    """What the page shows of point clouds; nothing else is computed."""

    points: bool = False
    picture: str = "none"
    """`images`, `stereo` or `none`"""
    wide: bool = False
    pair: tuple[str, str] | None = None
    """cameras of the stereo preview; None: the session's first pair"""
    surface: bool = False
    """the one that the solver fits to clouds"""


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
class Opened:
    """There is something to be looked at, or why not."""

    failure: Exception | None
    is_whole: bool
    """it can be worked in, too"""


Snapshot = (
    SessionSnapshot | PoseSnapshot | PictureSnapshot | TimelineSnapshot | TimelineChange | ProgressSnapshot | Notice
    | Download | RerunPage | SurfaceSnapshot | CloudSnapshot | CloudPicture
    | CurvesSnapshot | CloseSnapshot | ScoreSnapshot | GuessesSnapshot | LiveSnapshot | WorkSnapshot
    | Opened
)  # fmt: skip
