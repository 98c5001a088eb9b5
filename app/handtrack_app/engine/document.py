"""What is open in the workbench: a tracking run, what was decided, poses set by hand, results. No threads, no viser."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, replace
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from handtrack.arrays import D3, D21, F, Floats, Ints, K, P, S, evenly_spread
from handtrack.capture.masks.segmentation import MaskMethod, mask_method_table, read_mask_method
from handtrack.diagnostics.metrics import BENT_JOINTS, flexion_deg
from handtrack.diagnostics.review import failure_probability
from handtrack.errors import HandtrackError, unknown_name
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.ellipsoids import Ellipsoids
from handtrack.model.kinematics import BonePoses
from handtrack.observation.pins import Pin
from handtrack.observation.truth import mean_error_mm
from handtrack.session.first_pose import FirstPose
from handtrack.session.run import TrackingRun
from handtrack.session.session import Session
from handtrack.session.session_file import CloudSettings, SessionFile, read_clouds
from handtrack.session.session_state import (
    CameraCorrection,
    Correction,
    DecidedPose,
    DecidedSize,
    Edit,
    Key,
    MaskSource,
    SessionState,
    StartPose,
    decide,
)
from handtrack.session.sources.corrections import CorrectedMasks, decoded
from handtrack.session.sources.views import MaskChoice, View
from handtrack.session.takes import REFINED, files_read
from handtrack.store.history import Span
from handtrack.store.store import Store
from handtrack.store.take import CurrentTrack, Head, TakeFrames
from handtrack.tracking.frame.result import FrameResult, Status
from handtrack.tracking.whole.refinement import Refinement
from handtrack_app.protocol import (
    COST,
    ERROR,
    MOVED,
    PROBABILITY,
    TERM,
    VIEWS,
    FileKind,
    TakeCard,
)


class TakeCache:
    """Takes by their numbers."""

    def __init__(self, folder: Path | None = None, report: Callable[[str], None] = print) -> None:
        """folder: a session's tracks/; None: nothing is on disk. tell: takes a sentence for whatever is damaged."""
        self._store = None if folder is None else Store(folder)
        self._report = report
        self._known: dict[int, TakeFrames | None] = {}
        self._cards: tuple[CurrentTrack, tuple[TakeCard, ...]] | None = None

    def get(self, number: int) -> TakeFrames | None:
        """Return a take's frames; None of one that was removed or cannot be read."""
        if number not in self._known:
            self._known[number] = None if self._store is None else self._read(number, self._store)
        return self._known[number]

    def frames_of(self, number: int) -> tuple[int, ...]:
        """Return the frames that a take has."""
        return tuple(self.get(number) or ())

    def cards(self, track: CurrentTrack) -> tuple[TakeCard, ...]:
        """Return what is told of each take, the latest first. All takes are looked at, so once for a track."""
        if self._cards is None or self._cards[0] is not track:
            self._cards = track, self._cards_of(track)
        return self._cards[1]

    def _cards_of(self, track: CurrentTrack) -> tuple[TakeCard, ...]:
        there = {} if self._store is None else {take.number: take for take in self._store.takes()}
        shown = {number: track.count_of(take) for number, take in self._known.items() if take}
        cards = []
        for number in sorted({*there, *shown}, reverse=True):
            words = f"{len(self._known.get(number) or ())} frames, not on disk"
            if number in there:
                try:
                    about = there[number].about
                except HandtrackError:
                    continue  # begun by a program that was killed at once; `handtrack takes` tells of it
                first, stop = about.frames
                if stop - first == 1:
                    continue  # a single frame that was fitted: undo goes back to it
                when = about.begun.replace("T", " ").removesuffix("+00:00")
                size = there[number].bytes / 1e6
                kind = f"{REFINED}, " if about.by.endswith(REFINED) else ""
                words = f"{when} UTC, {kind}frames {first} to {stop - 1}, {size:.1f} MB"
            cards.append(TakeCard(number, words, shown.get(number, 0)))
        return tuple(cards)

    def put(self, number: int, take: TakeFrames) -> None:
        """Add a take that is being tracked."""
        self._known[number] = take

    def forget_cards(self) -> None:
        """A take has come to its end."""
        self._cards = None

    @property
    def next_number(self) -> int:
        """A number for a take that nothing is written of."""
        there = () if self._store is None else self._store.takes()
        return max([0, *self._known, *(take.number for take in there)]) + 1

    def _read(self, number: int, store: Store) -> TakeFrames | None:
        damage: list[str] = []
        try:
            take = store.take(number)
            return TakeFrames(take.about.labels, dict(take.frame_heads(damage)))
        except HandtrackError as error:
            damage.append(str(error))
        finally:
            for text in damage:
                self._report(text)
        return None


# ---- What the session's state says of masks


def mask_source(view: View) -> MaskSource:
    """Return where a camera's masks come from, as the state has it."""
    masks = view.settings.masks
    table = masks if isinstance(masks, str | None) else mask_method_table(masks)
    return MaskSource(table, view.settings.roi)


def usual_values(kind: type[MaskMethod]) -> dict[str, object]:
    """Return what a method's settings are unless said."""
    return {item.name: item.default for item in fields(kind) if item.default is not MISSING}


def correction_of(
    session: Session, at: tuple[str, int], correction: Correction | None
) -> tuple[CorrectedMasks, bytes | None]:
    """Return the corrected masks of a camera, and what they hold of its own frame; None: nothing. Raises HandtrackError."""
    camera, own_frame = at
    view = session.view(camera)
    if correction is None:
        return view.corrections, None
    decoded(correction.png, view.camera.size, f"the correction {camera}/{own_frame}")
    return view.corrections, correction.png


# ---- What the session's state says of pins


def pinning(pins: Mapping[int, Sequence[Pin]]) -> Edit:
    """Return the edit by which frames have these pins."""
    return decide(pins={f: tuple(own) or None for f, own in pins.items()})


# ---- The document


@dataclass(frozen=True, eq=False)
class Moment:
    """The model as it is posed at a frame: what pictures are made from; nothing of it changes later."""

    frame: int
    run: TrackingRun
    bones: BonePoses

    @cached_property
    def ellipsoids(self) -> Ellipsoids:
        """The model's, as it is posed."""
        return self.run.model.ellipsoids["fine"].posed(self.bones)

    @property
    def aside(self) -> int:
        """The bone that a close picture may cut off: a hand's forearm; −1 where there is none."""
        model = self.run.model
        return model.skeleton.bone("forearm") if model.has_forearm else -1


_COMPARED = 20  # tracked frames by which cameras are compared; lost ones among them do not count
_UNDECIDED = DecidedPose({})


class Document:
    """A run and everything the user and the tracker made of it.

    What was decided stands in `state`, and all else follows from that (`apply`). The pose of a frame is what was set by
    hand there, else what was tracked, else the last one shown.
    """

    def __init__(
        self,
        run: TrackingRun,
        first_frame: int,
        first_params: Floats[P],
        size_pending: bool = False,
    ) -> None:
        self.run = run
        self.frames: range = run.session.known_frames
        self.first_frame = int(first_frame)
        self._start = run.model.named(run.model.joint_params(first_params))
        """by name; of other models that were in force, too"""
        self.state = SessionState()
        """what was decided; only `become` changes it"""
        self.takes = TakeCache()
        self.by_hand: dict[int, Floats] = {}
        self._carried: dict[
            int, Floats
        ] = {}  # what was seen at a frame before it was posed, where undo went back
        self.results = CurrentTrack()
        self.laid: tuple[Span, ...] = ()
        """what it is composed of, the uppermost last"""
        self.hidden: tuple[Span, ...] = ()
        """likewise, of takes with another model than the one in force, which cannot show"""
        self.rows = TrackedRows(self.frames)
        """what the timeline knows of them"""
        self.accepted = self.state.accepted_frames
        """frames that the user has accepted: neither tracking nor refining changes them"""
        self.own_interval = run.model.limits.interval.copy()
        self._own_size, self._own_arm_m = DecidedSize(run.scale, size_pending), run.arm_m
        self._own_start = (self.first_frame, self._start)
        self.frame = self.first_frame
        self.shown = self.start
        self.before: Floats[S] | None = None
        """a pose that the frame had earlier, looked at in place of `shown` until anything else is done"""
        self.version = 0
        self.saved = self.settings
        """as session.toml has them"""
        self._read: tuple[SessionFile, dict[str, str]] | None = None

    @property
    def model(self) -> ArticulatedModel:
        return self.run.model

    @property
    def session(self) -> Session:
        return self.run.session

    @property
    def start(self) -> Floats[S]:
        """The joint parameters of the pose with which tracking begins."""
        return self._by_name({})

    def _by_name(self, known: Mapping[str, float]) -> Floats[S]:
        """Return joint parameters of the model; those that are not known are the start's."""
        values = {**self._start, **known}
        return np.array([values.get(name, 0.0) for name in self.model.parameter_names])

    def files_read(self) -> dict[str, str]:
        """Return a digest of all that the session is read from; looked at once, for what was read once stays in memory."""
        file = self.session.file
        if self._read is None or self._read[0] is not file:
            self._read = file, files_read(self.session)
        return self._read[1]

    # ---- what was decided

    def in_force(self, key: Key) -> Any:
        """Return what holds of one thing: what was decided, or what the session's files say. Of a pose, what is seen: undo comes
        back to it.
        """
        kind, entry = key
        session, known = self.session, self.state.get(key)
        if kind in self.saved:
            return self.settings[kind] if entry is None else self.settings[kind].get(entry)
        if kind == "size":
            return replace(self.size, scale=self.run.scale)
        if kind == "pins":
            return session.pins.of(entry) or None
        if kind == "forearm":
            return self.run.arm_m
        if kind == "correction" and known is None:
            content = session.view(entry[0]).corrections.content(entry[1])
            return None if content is None else Correction(content)
        if kind == "pose" and known is None and entry not in self.results:
            return DecidedPose(self.model.named(self.pose_at(entry)), carried=True)
        return known

    def apply(self, edit: Edit) -> None:
        """Make an edit that nobody keeps. Raises HandtrackError, and changes nothing, for what cannot be."""
        self.become(edit(self.state))

    def become(self, state: SessionState) -> None:
        """Let a state hold from now on. Live or on opening the session again, whoever has the same state has the same document.
        Raises HandtrackError, and changes nothing, for what cannot be.
        """
        changed: dict[str, dict[Any, Any]] = defaultdict(dict)
        for (kind, entry), value in state.changed(self.state).items():
            changed[kind][entry] = value
        self.before = None
        run = self._run_with(changed)
        corrections = [
            (correction_of(run.session, at, value), at[1])
            for at, value in changed["correction"].items()
        ]
        pins = {
            frame: [*map(run.session.pins.as_written, own or ())]
            for frame, own in changed["pins"].items()
        }
        self.state = state
        if run is not self.run or changed["limits"]:
            self._use(run, resized=bool(changed["size"]))
        if changed["camera"]:
            self.see_frames()
        if changed["spans"]:
            self._lay()
        if changed["accepted"]:
            self.accepted = state.accepted_frames
        for frame in changed["pose"]:
            self._derive_pose(frame)
        for (place, content), own_frame in corrections:
            place.hold(own_frame, content)
        if corrections:
            self.session.forget_observations()
        for frame, own in pins.items():
            self.session.pins.hold(frame, own)
        if changed["start"] and self.run.first is None:
            self._start_at(state.start)

    def _run_with(self, changed: Mapping[str, Mapping[Any, Any]]) -> TrackingRun:
        """Return the run with what is another in force, by kind and entry."""
        run, own = self.run, self.saved["setting"]
        for arm_m in changed["forearm"].values():
            wanted = self._own_arm_m if arm_m is None else arm_m
            run = run if run.arm_m == wanted else run.with_forearm(wanted)
        settings = {
            name: own[name] if value is None else value
            for name, value in changed["setting"].items()
            if value is not None or name in own
        }
        if "method" in settings:  # the state says itself what that sets, and what was changed since
            settings = run.settings.flat() | settings
        if settings:
            run = run.with_values(settings)
        if "model.name" in settings:  # the one before may know less of the person
            run = run.with_scale(self.size.scale)
        for size in changed["size"].values():
            scale = (size or self._own_size).scale
            run = run if run.scale == scale else run.with_scale(scale)
        for table in changed["clouds"].values():
            table = self.saved["clouds"] if table is None else table
            if table != self.settings["clouds"]:
                cameras = run.session.file.cameras
                run = run.with_clouds(read_clouds(table, cameras, "[clouds]") if table else None)
        if changed["camera"]:
            known = {**run.session.corrections, **changed["camera"]}
            known = {name: value for name, value in known.items() if value is not None}
            run = replace(run, session=run.session.with_cameras(known))
        masks, known = dict[str, MaskChoice](), self.settings["masks"]
        for name, value in changed["masks"].items():
            if name not in known:
                raise unknown_name("camera", name, tuple(known))
            source = value or self.saved["masks"][name]
            if source != known[name]:
                method = source.masks
                if isinstance(method, dict):
                    method = read_mask_method(method, f"masks of camera '{name}'")
                masks[name] = method, source.roi
        return replace(run, session=run.session.with_masks(masks)) if masks else run

    @property
    def size(self) -> DecidedSize:
        """The size in force; whether it is still to be fitted, before the first tracking or after it; and the one before refining found
        another, with which tracking begins.
        """
        return self.state.size or self._own_size

    def _use(self, run: TrackingRun, resized: bool = False) -> None:
        """Change to another run; poses go by their names. What was made with a model comes back with it."""
        shown, names = self.model.named(self.shown), run.model.parameter_names
        is_same, untouched = names == (*shown,), np.allclose(self.shown, self.start)
        if run.model is not self.model:  # made anew: without the user's limits
            self.own_interval = run.model.limits.interval.copy()
        interval = self.own_interval.copy()
        for name in self.state.limits.keys() & names[6:]:
            interval[names.index(name)] = self.state.limits[name]
        limits = replace(run.model.limits, interval=interval)
        self.run = replace(run, model=replace(run.model, limits=limits))
        self.shown = self._by_name(shown)
        if resized and self.run.first is not None and self.first_frame == self.run.first.frame:
            start = self.model.joint_params(self.run.initial()[1])
            self._start = {**self._start, **self.model.named(start)}
            if untouched:
                self.shown = self.start
        if not is_same:
            self._derive_poses()
            self._lay()
            self.shown = self.pose_at(self.frame)
        self.shown = self.model.joint_params(self.model.params_within_limits(self.shown))

    def _lay(self) -> None:
        self.results, self.laid, self.hidden = self.composed(self.state.spans)

    def composed(
        self, spans: Sequence[Span]
    ) -> tuple[CurrentTrack, tuple[Span, ...], tuple[Span, ...]]:
        """Return the track that spans make, those that show, and those of takes with another model, which do not."""
        layers, laid, hidden = list[tuple[range, TakeFrames]](), list[Span](), list[Span]()
        for span in spans:
            take = self.takes.get(span.take)
            if take is None:
                continue
            if take.parameter_names == self.model.parameter_names:
                laid.append(span)
                layers.append((range(span.first, span.stop), take))
            else:
                hidden.append(span)
        return CurrentTrack(layers), tuple(laid), tuple(hidden)

    def _derive_poses(self) -> None:
        self.by_hand, self._carried = {}, {}
        for frame in self.state.pose:
            self._derive_pose(frame)

    def _derive_pose(self, frame: int) -> None:
        decided = self.state.pose.get(frame)
        self.by_hand.pop(frame, None)
        self._carried.pop(frame, None)
        if decided is not None and frame in self.frames:
            poses = self._carried if decided.carried else self.by_hand
            poses[frame] = self.posed(decided)

    def posed(self, decided: DecidedPose | StartPose) -> Floats[S]:
        """Return the joint parameters of a pose."""
        return self._by_name(decided.parameters)

    def _start_at(self, decided: StartPose | None) -> None:
        """Where the session has no first pose, a pose that was taken from a search is where tracking begins."""
        frame, known = self._own_start
        if decided is not None:
            frame, known = decided.frame, decided.parameters
        self.first_frame, self._start = frame, {**self._start, **known}

    # ---- frames

    def see_frames(self) -> bool:
        """Take the session's frames as they are known by now; poses outside of them do not show. Return whether they
        changed.
        """
        known = self.session.known_frames
        if known == self.frames:
            return False
        self.frames, self.rows = known, TrackedRows(known)
        self._derive_poses()
        return True

    # ---- poses

    def show(self, frame: int) -> None:
        """Go to a frame (the nearest one of the session)."""
        self.frame, self.before = self.clamped(frame), None
        self.shown = self.pose_at(self.frame)

    @property
    def displayed(self) -> Floats[S]:
        """The joint parameters (S,) of the pose that is looked at: as it is, or as it was before."""
        return self.shown if self.before is None else self.before

    @property
    def moment(self) -> Moment:
        """What is looked at."""
        return Moment(self.frame, self.run, self.model.bones_within_limits(self.displayed))

    def clamped(self, frame: int) -> int:
        """Return the nearest frame of the session."""
        return min(max(int(frame), self.frames.start), self.frames.stop - 1)

    def pose_at(self, frame: int) -> Floats[S]:
        """Return the joint parameters of a frame."""
        if frame in self.by_hand:
            return self.by_hand[frame]
        if frame in self.results:
            return self.results[frame].parameters
        if frame in self._carried:
            return self._carried[frame]
        return self.start if frame == self.first_frame else self.shown

    def truth_at(self, frame: int) -> Floats[D21, D3] | None:
        """Return the true keypoints of a frame, or joints (J, 3) of a body, world [m]."""
        truth = self.session.truth
        return None if truth is None else truth.points_at(frame, self.model.joint_names)

    def error_mm(self, frame: int, bones: BonePoses) -> float:
        """Return the mean distance of a frame's posed model to the truth [mm]; NaN without."""
        model = self.model
        points = model.keypoints21(bones) if model.has_keypoints21 else model.joint_positions(bones)
        return mean_error_mm(points, self.truth_at(frame))

    def decided_pose(self, frame: int) -> DecidedPose:
        """Return what was decided of a frame's pose; an empty one where nothing was."""
        return self.state.pose.get(frame, _UNDECIDED)

    def start_from(self, first: FirstPose) -> None:
        """Let tracking start from a pose."""
        self.first_frame, self._start = first.frame, {**self._start, **first.parameters}
        self.run = replace(self.run, first=first)

    def begin_at(self, frame: int) -> None:
        """Where the session has no first pose, take the one that was set or found at a frame; nothing is written."""
        if self.run.first is None and (frame in self.by_hand or frame in self.results):
            self.start_from(FirstPose(frame, self.model.named(self.pose_at(frame))))

    def start_pose(self, frame: int, anew: bool = False) -> Floats[S] | None:
        """Return the pose that tracking from a frame starts with.

        anew: None at the first frame: its saved pose as `handtrack track` takes it, unless the user has moved it since.
        """
        first = self.run.first
        is_saved = anew and first is not None and first.frame == frame
        return None if is_saved and frame not in self.by_hand else self.pose_at(frame)

    def start_params(self, frame: int, anew: bool = False) -> Floats[P]:
        """Return the same as solver parameters."""
        pose = self.start_pose(frame, anew)
        return self.run.initial()[1] if pose is None else self.model.params_within_limits(pose)

    @property
    def is_posed(self) -> bool:
        """Whether anybody said where the hand is: else it stands somewhere in view."""
        return self.run.first is not None or bool(self.by_hand) or bool(self.results.layers)

    def is_locked(self, frame: int) -> bool:
        """Return whether a frame was accepted, and its pose shows: not under another model."""
        return frame in self.accepted and (frame in self.by_hand or frame in self.results)

    def refuse_to_fit(self, frame: int) -> None:
        """Raise HandtrackError for a frame that was accepted."""
        if frame in self.accepted:
            raise HandtrackError(
                f"Frame {frame} is accepted, so no fit changes it. Release it first, in the Review tab."
            )

    # ---- cameras

    def some_results(self) -> list[FrameResult]:
        """Return tracked frames by which cameras are compared, evenly spread."""
        tracked = [frame for frame in self.frames if frame in self.results]
        return [self.results[tracked[row]] for row in evenly_spread(len(tracked), _COMPARED)]

    @property
    def camera_errors(self) -> dict[str, CameraCorrection]:
        """Corrections of the cameras that are surely off, as the track's last estimate of the whole recording found them, and
        that do not count yet.
        """
        session, corrections = self.session, dict[str, CameraCorrection]()
        for span in reversed(self.laid):
            take = self.takes.get(span.take)
            if take is None or take.labels.refinement is None:
                continue
            for error in Refinement.read(take.labels.refinement).cameras:
                earlier = session.corrections.get(error.name)
                known = error.name in session.rig and bool(error.words)
                if known and (earlier is None or span.take > earlier.take):
                    digest = session.calibration_digest(error.name)
                    corrections[error.name] = CameraCorrection(error, span.take, digest)
            break
        return corrections

    # ---- what session.toml may have otherwise

    @property
    def clouds(self) -> CloudSettings | None:
        """The settings of [clouds] in force."""
        return self.session.file.clouds

    @property
    def settings(self) -> dict[str, Mapping[str, Any]]:
        """What holds of all that session.toml can say, by FileKind: settings, the table [clouds], and by camera where masks come from."""
        return {
            "setting": self.run.settings.flat(),
            "clouds": {} if self.clouds is None else self.clouds.table,
            "masks": {view.name: mask_source(view) for view in self.session.views},
        }

    def unsaved(self, kind: FileKind) -> tuple[str, ...]:
        """Return the names of what is another than in session.toml: settings, those of [clouds], or cameras whose masks are."""
        now, saved = self.settings[kind], self.saved[kind]
        return tuple(name for name in {**saved, **now} if now.get(name) != saved.get(name))


# ---- What the timeline and the plots show of tracked frames, row by row, as far as it was read


_AT_ONCE = 100  # frames that are read whole at one look, about 20 ms
TERM_WORDS = {
    "coverage": "silhouettes",
    "conic_field": "silhouettes",
    "cloud_distance": "cloud→model",
    "cloud_emptiness": "model→cloud",
    "cloud_rays": "lines of sight",
    "keypoints": "keypoints",
    "pins": "pins",
    "own": "own terms",
    "edges": "edges",
    "intensity": "intensity",
} | dict.fromkeys(
    (
        "rest",
        "posture",
        "motion",
        "keyframe",
        "stabilise",
        "stay",
        "collision",
        "proportions",
        "prior",
    ),
    "priors",
)
"""by the name of a term"""


class TrackedRows:
    """What the timeline shows of tracked frames; rows are frames from `frames.start`."""

    def __init__(self, frames: range) -> None:
        count = len(frames)
        self.frames = frames
        self.status: Ints[F] = np.full(count, -1, dtype=np.int64)
        self.lanes: dict[str, Floats[F]] = {}
        """numbers by their words, as of TimelineSnapshot; NaN where a frame has none"""
        self.values: Floats[F, S] = np.zeros((count, 0))
        """joint parameters of the frames read so far [m, rad], NaN elsewhere"""
        self.std: Floats[F, S] = np.zeros((count, 0))
        self.bent: Floats[F, K] = np.full((count, len(BENT_JOINTS)), np.nan)
        """by how much the truth bends each of BENT_JOINTS more [rad]"""
        self.changed: set[int] = set()
        """rows that were not told yet"""
        self._known: dict[int, Head] = {}
        self._track: CurrentTrack | None = None
        self._looked: list[int] = []  # at how many of each take's frames
        self._unread: dict[int, None] = {}
        """frames of which only what stands in their heads is known"""

    def follow(self, document: Document) -> None:
        """Take the track as it is now; `read_more` does the rest of it."""
        for frame in self._new(document.results):
            self._look(document.results, frame)
        self.read_more(document)

    def heads(self) -> list[Head]:
        """Return what is known of the tracked frames without their arrays, ascending."""
        return [self._known[frame] for frame in sorted(self._known)]

    def _new(self, track: CurrentTrack) -> Iterable[int]:
        """Return the frames that may have changed since the last look: all of another track, else those taken since."""
        takes = [take for _, take in track.layers]
        before = self._looked if track is self._track else None
        self._track, self._looked = track, [len(take.puts) for take in takes]
        if before is None:
            return [*self._known.keys() - (there := set(track)), *there]
        return [f for take, n in zip(takes, before, strict=True) for f in take.puts[n:]]

    def _look(self, track: CurrentTrack, frame: int) -> None:
        head = track.head(frame)
        if head is not None and self._known.get(frame) is head:
            return
        self._forget(frame)
        if head is None or frame not in self.frames:
            return
        row = frame - self.frames.start
        self._known[frame] = head
        self.status[row] = int(head.status)
        self._unread[frame] = None
        self.changed.add(row)
        self._put(COST, row, head.energy)
        for word, cost in cost_parts(head.energies).items():
            self._put(TERM + word, row, cost)
        if np.isfinite(head.p_off_25mm) or head.status in (Status.DOUBTFUL, Status.LOST):
            self._put(PROBABILITY, row, failure_probability(head))
        if head.views:
            self._put(VIEWS, row, head.views)

    def _put(self, word: str, row: int, value: float) -> None:
        if word not in self.lanes:
            self.lanes[word] = np.full(len(self.frames), np.nan)
        self.lanes[word][row] = value

    def read_more(self, document: Document) -> bool:
        """Read more frames whole that were not read yet; return whether any is left."""
        for frame in list(islice(self._unread, _AT_ONCE)):
            del self._unread[frame]
            if frame in document.results:
                self._read(document, frame)
        return bool(self._unread)

    def _read(self, document: Document, frame: int) -> None:
        result, truth = document.results[frame], document.truth_at(frame)
        row, values = frame - self.frames.start, result.parameters
        estimate = result.joint_positions if result.keypoints21 is None else result.keypoints21
        self._put(ERROR, row, mean_error_mm(estimate, truth))
        self._put(MOVED, row, moved_mm(result, document.results.below(frame)))
        if self.values.shape[1] != len(values):
            shape = len(self.frames), len(values)
            self.values, self.std = (np.full(shape, np.nan) for _ in range(2))
        self.values[row], self.std[row] = values, result.parameter_std
        if truth is not None and result.keypoints21 is not None:
            own, true = flexion_deg(np.stack([result.keypoints21, truth]))
            self.bent[row] = np.deg2rad(true - own)
        self.changed.add(row)

    @property
    def is_whole(self) -> bool:
        """Whether all frames were read."""
        return not self._unread

    def _forget(self, frame: int) -> None:
        self._unread.pop(frame, None)
        if self._known.pop(frame, None) is not None:
            row = frame - self.frames.start
            self.changed.add(row)
            self.status[row] = -1
            for values in (*self.lanes.values(), self.values, self.std, self.bent):
                values[row] = np.nan


def cost_parts(energies: Mapping[str, float]) -> dict[str, float]:
    """Return the parts of a frame's energy by their words."""
    parts: dict[str, float] = {}
    for name, cost in energies.items():
        word = TERM_WORDS.get(name, name)
        parts[word] = parts.get(word, 0.0) + cost
    return parts


def moved_mm(result: FrameResult, before: FrameResult | None) -> float:
    """Return how far the furthest joint of a frame is from where it was [mm]; NaN where that is not known."""
    if before is None or before.joint_positions.shape != result.joint_positions.shape:
        return float("nan")
    moves = np.linalg.norm(result.joint_positions - before.joint_positions, axis=1)
    return float(1e3 * moves.max())
