"""What the page asks of the engine: commands, frozen and picklable, with no viser in them.

The engine runs in a process of its own, or on threads of the page's (tests): nothing here is shared.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass

from handtrack_app.protocol.mask_commands import (
    CarryMasks,
    DropCorrection,
    MarkMaskBox,
    PaintMask,
    RestoreMasks,
    SaveMasks,
    SetMasks,
    WantMasks,
)
from handtrack_app.protocol.posing import (
    CopyPins,
    DropPins,
    ForgetPose,
    LookBefore,
    PullPlace,
    RefitWhileTuning,
    SetPin,
    SetPose,
    TakePose,
    WantLibrary,
)
from handtrack_app.protocol.reviewing import Accept, CompareTake, WantCurves


@dataclass(frozen=True)
class ShowFrame:
    """Show another frame. A newer one replaces an older one that still waits."""

    frame: int
    is_played: bool = False
    """it is told with all its pictures at one time; of a frame that somebody went to, they come later"""


@dataclass(frozen=True)
class Undo:
    """Take the latest step back: a pose, a setting, limits, filters, a size, a take."""

    version: int


@dataclass(frozen=True)
class Redo:
    """Make the step again that was undone last."""

    version: int


@dataclass(frozen=True)
class RestoreTake:
    """Make a take the current track, or some of its frames."""

    number: int
    span: tuple[int, int] | None = None
    """first to last; None: all"""


@dataclass(frozen=True)
class ShowTake:
    """Use the model that a take was tracked with, so that its frames show; the track stays composed as it is."""

    number: int


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
    both_ends: bool = False
    """between keyframes half of the frames are tracked from each"""


@dataclass(frozen=True)
class Refine:
    """Refine the tracked frames together, each by those after it and by poses set by hand as well."""


@dataclass(frozen=True)
class TrackLive:
    """Track what the cameras show from now on, from the pose shown."""


@dataclass(frozen=True)
class Record:
    """Record what the cameras show and what is tracked to a new session folder, or end that."""

    on: bool
    folder: str | None = None
    """None: a new one beside the session's"""


@dataclass(frozen=True)
class FitSize:
    """Fit the hand's size to the frames near the first pose."""


@dataclass(frozen=True)
class TakeSize:
    """Take the size that was fitted after tracking, and track everything again from the pose at `first`."""

    first: int


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
    tag: str = ""
    """as of a pose; several settings changed at one time have one"""


@dataclass(frozen=True)
class SaveSettings:
    """Write the settings that session.toml does not have into it."""


@dataclass(frozen=True)
class SetLimits:
    """Change the interval of a joint parameter [m, rad]; None restores the model's own."""

    name: str
    interval: tuple[float, float] | None
    tag: str = ""


@dataclass(frozen=True)
class SetShape:
    """Set a number of the person's shape [% or mm, as `ShapeNumber` has it]."""

    name: str
    value: float
    tag: str = ""


@dataclass(frozen=True)
class WantPictures:
    """Which pictures the page shows."""

    thumbnails: bool
    paint: str
    """over the small ones: `plain`, `outline`, `residual` or `field`"""
    screens: tuple[tuple[str, str], ...] = ()
    """cameras whose pictures stand behind the hand, each with what is painted over it"""


@dataclass(frozen=True)
class Export:
    """Send a file to one client: in a format of `handtrack export --to`, or `init`, the pose that is shown."""

    kind: str
    client_id: int
    up: str = ""
    """which of the world's axes points up, for formats whose readers take one for it; empty: nothing is turned"""


@dataclass(frozen=True)
class SaveTrack:
    """Write tracks/poses.npz."""


@dataclass(frozen=True)
class FindHand:
    """Look for the hand without any first pose, in one frame, or in the surest of several."""

    frame: int | None
    fetch: bool = False
    """get the detector's networks before"""


@dataclass(frozen=True)
class TakeGuess:
    """Set the pose of a frame to one of the list."""

    frame: int
    index: int
    version: int
    """of the user's edits"""


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
class SampleSkin:
    """Fit the skin's ellipse to a box x, y, w, h [px] of a camera's image of a frame; None: to all images in which hand is painted."""

    frame: int
    camera: str
    box: tuple[int, int, int, int] | None
    size: float


@dataclass(frozen=True)
class SaveClouds:
    """Write the settings of [clouds] into session.toml."""


@dataclass(frozen=True)
class RestoreClouds:
    """Go back to the settings of [clouds] as session.toml has them."""


@dataclass(frozen=True)
class StartAgain:
    """Start the engine that ended too often; for whoever keeps its process."""


Command = (
    ShowFrame | SetPose | TakePose | PullPlace | SetPin | DropPins | CopyPins | ForgetPose | LookBefore | WantLibrary | RefitWhileTuning | SavePose | Track | Refine | FitSize | TakeSize | Follow | Pause | Cancel | SetSetting
    | SaveSettings | SetLimits | SetShape | WantPictures | WantSurface | WantCloud | SetClouds | SampleSkin | SaveClouds | RestoreClouds | Export
    | WantMasks | SetMasks | MarkMaskBox | SaveMasks | RestoreMasks | PaintMask | DropCorrection | CarryMasks
    | SaveTrack | FindHand | TakeGuess | TrackLive | Record | Undo | Redo | RestoreTake | ShowTake | CompareTake | WantCurves | Accept | StartAgain
)  # fmt: skip


@dataclass(frozen=True)
class Numbered:
    """A command and its number: the engine says up to which number all is on disk (`WorkSnapshot.written`)."""

    command: Command
    number: int
    """counts a page's commands from 1"""


_LATEST_WINS = (
    ShowFrame,
    WantPictures,
    WantCloud,
    WantSurface,
    WantMasks,
    SampleSkin,
    CompareTake,
    WantCurves,
)


def kind_of(request: object) -> Hashable | None:
    """Return what a newer command has in common with one that still waits, and that it replaces; None: it replaces none."""
    if isinstance(request, Numbered):
        return kind_of(request.command)
    if isinstance(request, SetClouds):
        return ("clouds", *(name for name, _ in request.values))
    if isinstance(request, SetMasks):
        return ("masks", request.camera, *(name for name, _ in request.values))
    if isinstance(request, SetSetting):
        return ("setting", request.name)
    if isinstance(request, SetLimits):
        return ("limits", request.name)
    if isinstance(request, SetShape):
        return ("shape", request.name)
    if isinstance(request, SetPin):
        return (SetPin, request.frame, request.camera, request.tag)
    if isinstance(request, SetPose):
        return (SetPose, request.frame)  # an edit never replaces another frame's
    if isinstance(request, PullPlace):
        return (PullPlace, request.frame, request.joint, request.bone, request.tag)
    return type(request) if isinstance(request, _LATEST_WINS) else None


VIEWS = (
    WantPictures, WantSurface, WantCloud, WantMasks, Follow, CompareTake, WantCurves, RefitWhileTuning,
)  # fmt: skip
"""what the page wants until it says otherwise: subscriptions, of which the latest of each counts"""
JOBS = (
    Track, Refine, FitSize, TakeSize, FindHand, TrackLive, CarryMasks, Record, Export, WantLibrary,
)  # fmt: skip
"""what takes a while and is asked for once: it is not done again unasked"""
_PASSING = (Pause, Cancel, LookBefore, StartAgain)


def is_edit(command: Command) -> bool:
    """Return whether a command changes what is kept of the session: it is to be on disk, or to be named."""
    return not isinstance(command, (*VIEWS, *JOBS, *_PASSING, ShowFrame))


def is_step(request: object) -> bool:
    """Return whether a command depends on all that was asked before it, or they on it: none is moved past it."""
    if isinstance(request, Numbered):
        request = request.command
    return (
        isinstance(request, Command)
        and kind_of(request) is None
        and not isinstance(request, (*VIEWS, *_PASSING))
    )
