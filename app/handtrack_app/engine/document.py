"""What is open in the workbench: a tracking run, what was decided, poses set by hand, results. No threads, no viser."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from handtrack.arrays import Floats, P, S
from handtrack.errors import HandtrackError, unknown_name
from handtrack.model.articulated import ArticulatedModel, HandScale
from handtrack.model.model_file import scale_from, scale_table
from handtrack.model.pose_library import pose_names
from handtrack.session.clouds_settings import CloudSettings, read_clouds
from handtrack.session.first_pose.first_pose import FirstPose
from handtrack.session.posed_frames import solver_params_of
from handtrack.session.run import TrackingRun
from handtrack.session.session_file import SessionFile
from handtrack.session.sources.views import MaskChoice
from handtrack.session.takes.take_about import files_read
from handtrack.store.current_track import CurrentTrack, TakeFrames
from handtrack.store.history import Value
from handtrack.store.spans import Span
from handtrack.store.store import spans_of
from handtrack_app.engine.masks import mask_state
from handtrack_app.engine.posing import pin_state
from handtrack_app.engine.store import keys
from handtrack_app.engine.store.shelf import TakeShelf
from handtrack_app.engine.timeline import TrackedRows


def renamed(
    values: Floats[S], names: Sequence[str], new_names: Sequence[str], others: Floats[S]
) -> Floats[S]:
    """Return joint parameters of another model by name; those that are not known are `others`."""
    known: dict[str, float] = dict(zip(names, values.tolist(), strict=True))
    return np.array([known.get(name, other) for name, other in zip(new_names, others, strict=True)])


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
        self.start = run.model.joint_params(first_params)
        self.state: dict[str, Value] = {}
        """what was decided, by its keys (`engine.keys`); only `apply` changes it"""
        self.takes = TakeShelf()
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
        self.accepted: frozenset[int] = frozenset()
        """frames that the user has accepted: neither tracking nor refining changes them"""
        self.limits: dict[str, tuple[float, float]] = {}
        self.own_interval = run.model.limits.interval.copy()
        self.own_settings = dict(run.settings.flat())
        """as session.toml has them"""
        self._own_size = (run.scale, size_pending)
        self._own_arm = run.arm
        self._own_start = (self.first_frame, self.start)
        self.frame = self.first_frame
        self.shown = self.start.copy()
        self.before: Floats[S] | None = None
        """a pose that the frame had earlier, looked at in place of `shown` until anything else is done"""
        self._starts: dict[tuple[str, ...], Floats[S]] = {}
        """where other models start, by their parameters"""
        self.version = 0
        self.saved_clouds = self.clouds
        """the settings of [clouds] as session.toml has them"""
        self.saved_masks = self.masks
        """where each camera's masks come from, as session.toml has it"""
        self._read: tuple[SessionFile, dict[str, str]] | None = None
        self.size_pending = size_pending
        """the hand's size is to be fitted before the first tracking, or after it"""
        self.live_scale: HandScale | None = None
        """the size before refining found another, with which tracking begins"""
        self.offered_scale: HandScale | None = None
        """the size that was fitted after tracking, and is not taken yet"""
        self.offered_arm = run.arm
        """with `offered_scale`"""

    @property
    def model(self) -> ArticulatedModel:
        return self.run.model

    def files_read(self) -> dict[str, str]:
        """Return a digest of all that the session is read from; looked at once, for what was read once stays in memory."""
        file = self.run.session.file
        if self._read is None or self._read[0] is not file:
            self._read = file, files_read(self.run.session)
        return self._read[1]

    @property
    def leaves_forearm_open(self) -> bool:
        """Whether neither settings nor session.toml say if the model has a forearm."""
        asked = self.run.settings.model.forearm, self.run.session.file.hand.forearm
        return asked == ("auto", "auto")

    # ---- what was decided

    def value(self, key: str) -> Value:
        """Return what holds of a value of the state; of settings, size and clouds also where only the files say it."""
        kind, name = keys.parts(key)
        if kind == keys.SETTING:
            return self.run.settings.flat().get(name)
        if kind == keys.SIZE:
            live = {} if self.live_scale is None else {"live": scale_table(self.live_scale)}
            return scale_table(self.run.scale) | {"pending": self.size_pending} | live
        if kind == keys.CLOUDS:
            return {"table": None if self.clouds is None else self.clouds.table}
        if kind == keys.MASKS:
            return mask_state.choice_value(self.masks[name])
        if kind == keys.CORRECTION:
            return mask_state.corrected_value(self.run.session, name, self.state.get(key))
        if kind == keys.PINS:
            return pin_state.pins_value(self.run.session.pins.of(int(name)))
        if kind == keys.POSE and key not in self.state and int(name) not in self.results:
            # what is seen there now, so that undo can come back to it
            seen = self.pose_at(int(name)).tolist()
            names = self.model.parameter_names
            return {"parameters": dict(zip(names, seen, strict=True)), "carried": True}
        return self.run.arm if kind == keys.FOREARM else self.state.get(key)

    def decided(self, kind: str) -> list[str]:
        """Return the keys of a kind that the state has a value of."""
        return [key for key in self.state if keys.parts(key)[0] == kind]

    def apply(self, values: Mapping[str, Value]) -> None:
        """Let values hold from now on; None: as the session's files have it. Live or on opening the session again, whoever
        has the same state has the same document. Raises HandtrackError, and changes nothing, for what cannot be.
        """
        kinds = {keys.parts(key)[0] for key in values}
        self.before = None
        run = self._run_with(values)
        corrections = mask_state.corrections_in(run.session, values)
        pins = pin_state.pins_in(run.session, values)
        for key, value in values.items():
            if value is None:
                self.state.pop(key, None)
            else:
                self.state[key] = value
        if keys.SIZE in values:
            self._pend(values[keys.SIZE])
        if run is not self.run or keys.LIMITS in kinds:
            self._use(run, resized=keys.SIZE in values)
        if keys.SPANS in values:
            self._lay()
        if keys.ACCEPTED in values:
            self.accepted = keys.accepted_frames(values[keys.ACCEPTED])
        for key in values:
            kind, name = keys.parts(key)
            if kind == keys.POSE:
                self._derive_pose(int(name))
        for correction in corrections:
            correction.place.hold(correction.own_frame, correction.content)
        if corrections:
            self.run.session.look_again()
        for frame, own in pins.items():
            self.run.session.pins.hold(frame, own)
        if keys.START in values and self.run.first is None:
            self._start_at(values[keys.START])

    def _run_with(self, values: Mapping[str, Value]) -> TrackingRun:
        run = self.run
        if keys.FOREARM in values:
            wanted = values[keys.FOREARM]
            wanted = wanted if isinstance(wanted, bool | float) else self._own_arm
            run = (
                run if run.arm == wanted else run.with_forearm(np.inf if wanted is True else wanted)
            )
        settings = {
            name: self.own_settings[name] if value is None else value
            for key, value in values.items()
            for kind, name in (keys.parts(key),)
            if kind == keys.SETTING and (value is not None or name in self.own_settings)
        }
        if "method" in settings:  # the state says itself what that sets, and what was changed since
            settings = run.settings.flat() | settings
        if settings:
            run = run.with_values(settings)
        if keys.SIZE in values:
            scale = self._size_of(values[keys.SIZE])[0]
            run = run if run.scale == scale else run.with_scale(scale)
        if keys.CLOUDS in values:
            clouds = self._clouds_of(values[keys.CLOUDS])
            run = run if clouds == self.clouds else run.with_clouds(clouds)
        masks = {
            name: self._masks_of(name, value)
            for key, value in values.items()
            for kind, name in (keys.parts(key),)
            if kind == keys.MASKS
        }
        if masks and masks != {name: self.masks[name] for name in masks}:
            run = replace(run, session=run.session.with_masks(masks))
        return run

    def _masks_of(self, camera: str, value: Value) -> MaskChoice:
        if camera not in self.saved_masks:
            raise unknown_name("camera", camera, tuple(self.saved_masks))
        saved = self.saved_masks[camera]
        return saved if value is None else mask_state.choice_from(value, camera)

    def _size_of(self, value: Value) -> tuple[HandScale, bool]:
        if value is None:
            return self._own_size
        size = {key: part for key, part in value.items() if key not in ("pending", "live")}
        scale = scale_from(size, Path("the saved size"))
        return scale, bool(value.get("pending", False))

    def _clouds_of(self, value: Value) -> CloudSettings | None:
        if value is None:
            return self.saved_clouds
        table = value["table"]
        cameras = self.run.session.file.cameras
        return None if table is None else read_clouds(table, cameras, "[clouds]")

    def _pend(self, size: Value) -> None:
        self.size_pending, self.offered_scale = self._size_of(size)[1], None
        live = (size or {}).get("live")
        self.live_scale = None if live is None else self._size_of(live)[0]

    def _use(self, run: TrackingRun, resized: bool = False) -> None:
        """Change to another run; poses go by their names. What was made with a model comes back with it."""
        old, new = self.model.parameter_names, run.model.parameter_names
        untouched = np.allclose(self.shown, self.start)
        if run.model is not self.model:  # made anew: without the user's limits
            self.own_interval = run.model.limits.interval.copy()
        if new != old:
            self._starts[old] = self.start
            back = self._starts.pop(new, np.zeros(len(new)))
            self.start = renamed(self.start, old, new, back)
            self.shown = renamed(self.shown, old, new, self.start)
        self.limits = {
            name: (float(pair[0]), float(pair[1]))
            for key in self.decided(keys.LIMITS)
            for pair, name in ((self.state[key], keys.parts(key)[1]),)
            if name in new[6:]
        }
        interval = self.own_interval.copy()
        for name, pair in self.limits.items():
            interval[new.index(name)] = pair
        limits = replace(run.model.limits, interval=interval)
        self.run = replace(run, model=replace(run.model, limits=limits))
        if resized and self.run.first is not None and self.first_frame == self.run.first.frame:
            self.start = self.model.joint_params(self.run.initial()[1])
            if untouched:
                self.shown = self.start.copy()
        if new != old:
            self._derive_poses()
            self._lay()
            self.shown = self.pose_at(self.frame)
        self.shown = self.model.joint_params(solver_params_of(self.model, self.shown))

    def _lay(self) -> None:
        """Compose the current track; takes of another model do not show (`hidden`)."""
        laid = list[tuple[range, TakeFrames]]()
        self.laid, self.hidden = (), ()
        for span in spans_of(self.state.get(keys.SPANS)):
            take = self.takes.get(span.take)
            if take is None:
                continue
            if take.parameter_names == self.model.parameter_names:
                self.laid += (span,)
                laid.append((range(span.first, span.stop), take))
            else:
                self.hidden += (span,)
        self.results = CurrentTrack(laid)

    def _derive_poses(self) -> None:
        self.by_hand, self._carried = {}, {}
        for key in self.decided(keys.POSE):
            self._derive_pose(int(keys.parts(key)[1]))

    def _derive_pose(self, frame: int) -> None:
        given = self.state.get(keys.pose(frame))
        self.by_hand.pop(frame, None)
        self._carried.pop(frame, None)
        if given is not None and frame in self.frames:
            shelf = self._carried if given.get("carried", False) else self.by_hand
            shelf[frame] = self.posed(given)

    def posed(self, given: Value) -> Floats[S]:
        """Return the joint parameters of a pose as the state has it."""
        known, names = given["parameters"], self.model.parameter_names
        return np.array([float(known.get(n, at)) for n, at in zip(names, self.start, strict=True)])

    def _start_at(self, given: Value) -> None:
        """Where the session has no first pose, a pose that was taken from a search is where tracking begins."""
        if given is not None:
            self.first_frame, self.start = int(given["frame"]), self.posed(given)
        elif len(self._own_start[1]) == len(self.start):
            self.first_frame, self.start = self._own_start

    # ---- frames

    def see_frames(self) -> bool:
        """Take the session's frames as they are known by now; poses outside of them do not show. Return whether they
        changed.
        """
        known = self.run.session.known_frames
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
    def seen(self) -> Floats[S]:
        """The joint parameters (S,) of the pose that is looked at: as it is, or as it was before."""
        return self.shown if self.before is None else self.before

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

    def is_found(self, frame: int) -> bool:
        """Return whether a frame's pose is as a search found it."""
        return bool((self.state.get(keys.pose(frame)) or {}).get("found", False))

    def is_pinned(self, frame: int) -> bool:
        """Return whether a frame's pose is where its pins led."""
        return bool((self.state.get(keys.pose(frame)) or {}).get("pinned", False))

    def is_refitted(self, frame: int) -> bool:
        """Return whether a frame's pose is what was seen, fitted anew while settings were tuned."""
        return bool((self.state.get(keys.pose(frame)) or {}).get("refitted", False))

    def is_led(self, frame: int) -> bool:
        """Return whether the solver led to a frame's pose, by pins or settings: tracking solves it anew."""
        return self.is_pinned(frame) or self.is_refitted(frame)

    @property
    def pose_names(self) -> tuple[str, ...]:
        """The pose library of the model."""
        return pose_names(self.model.kind)

    def start_from(self, first: FirstPose) -> None:
        """Make the pose shown the one that tracking starts from; `first` is what was saved of it."""
        self.first_frame, self.start = self.frame, self.shown.copy()
        self.run = replace(self.run, first=first)

    def begin_at(self, frame: int) -> None:
        """Where the session has no first pose, take the one that was set or found at a frame; nothing is written."""
        if self.run.first is None and (frame in self.by_hand or frame in self.results):
            values = self.pose_at(frame)
            known = dict(zip(self.model.parameter_names, values.tolist(), strict=True))
            self.first_frame, self.start = frame, values.copy()
            self.run = replace(self.run, first=FirstPose(frame, known))

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
        return self.run.initial()[1] if pose is None else solver_params_of(self.model, pose)

    @property
    def is_posed(self) -> bool:
        """Whether anybody said where the hand is: else it stands somewhere in view."""
        return self.run.first is not None or bool(self.by_hand) or bool(self.results.layers)

    def keyframes(self, frames: range) -> dict[int, Floats[S]]:
        """Return the poses set by hand at some of the frames; not those to which the solver led."""
        return {
            f: self.by_hand[f] for f in sorted(self.by_hand) if f in frames and not self.is_led(f)
        }

    def guides(self, frames: range) -> dict[int, Floats[S]]:
        """Return the poses to which the solver led at some of the frames, by pins or settings."""
        return {f: self.by_hand[f] for f in sorted(self.by_hand) if f in frames and self.is_led(f)}

    def is_locked(self, frame: int) -> bool:
        """Return whether a frame was accepted, and its pose shows: not under another model."""
        return frame in self.accepted and (frame in self.by_hand or frame in self.results)

    def refuse_to_fit(self, frame: int) -> None:
        """Raise HandtrackError for a frame that was accepted."""
        if frame in self.accepted:
            raise HandtrackError(
                f"Frame {frame} is accepted, so no fit changes it. Let it go first: in the tab Review."
            )

    # ---- clouds

    @property
    def clouds(self) -> CloudSettings | None:
        """The settings of [clouds] in force."""
        return self.run.session.file.clouds

    @property
    def unsaved_clouds(self) -> tuple[str, ...]:
        """Names of the settings of [clouds] that differ from session.toml."""
        now, saved = ((c or CloudSettings()).table for c in (self.clouds, self.saved_clouds))
        return tuple(name for name in {**saved, **now} if now.get(name) != saved.get(name))

    # ---- masks

    @property
    def masks(self) -> dict[str, MaskChoice]:
        """Where each camera's masks come from."""
        return {view.name: mask_state.choice_of(view) for view in self.run.session.views}

    @property
    def unsaved_masks(self) -> tuple[str, ...]:
        """Names of the cameras whose masks come from elsewhere than session.toml says."""
        return tuple(n for n, choice in self.masks.items() if choice != self.saved_masks[n])
