"""What is open in the workbench: a tracking run, poses set by hand, results. No threads, no viser."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from handtrack.arrays import Floats, P, S
from handtrack.errors import HandtrackError, unknown_name
from handtrack.model.articulated import ArticulatedModel, HandScale
from handtrack.model.pose_library import named_pose, pose_names
from handtrack.session.clouds_settings import CloudSettings
from handtrack.session.first_pose.first_pose import FirstPose
from handtrack.simulation.body_motion import BODY_POSES, body_pose
from handtrack.tracking.frame.result import FrameResult
from handtrack_app.engine.inverse_kinematics import reach, tip_names
from handtrack_app.engine.run import Run
from handtrack_app.engine.timeline import TrackedRows

_FAR = 100.0  # [m] nobody's hand is further from the world's origin


def drivers(model: ArticulatedModel) -> list[int]:
    """Return (P,) for each solver parameter the joint parameter that stands for it on the page."""
    chosen = []
    for p, name in enumerate(model.transform.names):
        same = name in model.parameter_names
        column = np.abs(model.transform.matrix[:, p])
        chosen.append(model.parameter_names.index(name) if same else int(np.argmax(column)))
    return chosen


def params_of(model: ArticulatedModel, values: Floats[S]) -> Floats[P]:
    """Return solver parameters, within limits, for joint parameters as set on the page.

    Under a coupling the driving joints count and the driven ones follow.
    """
    values = np.clip(np.nan_to_num(values, nan=0.0), -_FAR, _FAR)
    transform = model.transform
    params = np.array(
        [
            (values[s] - transform.offset[s]) / transform.matrix[s, p]
            for p, s in enumerate(drivers(model))
        ]
    )
    return model.clipped(params)


@dataclass(frozen=True)
class ModelWork:
    """What was made with a model that is not the one in force."""

    start: Floats[S]
    shown: Floats[S]
    by_hand: dict[int, Floats[S]] = field(default_factory=dict)
    results: dict[int, FrameResult] = field(default_factory=dict)
    limits: dict[str, tuple[float, float]] = field(default_factory=dict)

    def pose_at(self, frame: int) -> Floats[S]:
        if frame in self.by_hand:
            return self.by_hand[frame]
        return self.results[frame].parameters if frame in self.results else self.shown


def renamed(
    values: Floats[S], names: Sequence[str], new_names: Sequence[str], others: Floats[S]
) -> Floats[S]:
    """Return joint parameters of another model by name; those that are not known are `others`."""
    known: dict[str, float] = dict(zip(names, values.tolist(), strict=True))
    return np.array([known.get(name, other) for name, other in zip(new_names, others, strict=True)])


class Document:
    """A run and everything the user and the tracker made of it.

    The pose of a frame is what was set by hand there, else what was tracked, else the last one shown.
    """

    def __init__(
        self, run: Run, first_frame: int, first_params: Floats[P], size_pending: bool = False
    ) -> None:
        self.run = run
        self.frames: range = run.session.known_frames
        self.first_frame = int(first_frame)
        self.start = run.model.joint_params(first_params)
        self.by_hand: dict[int, Floats] = {}
        self.found: dict[int, Floats] = {}
        """poses that a search found, by frame: they stand in `by_hand`, and are called found until they are edited"""
        self.results: dict[int, FrameResult] = {}
        self.rows = TrackedRows(self.frames)
        """what the timeline knows of them"""
        self.limits: dict[str, tuple[float, float]] = {}
        self._other_models: dict[tuple[str, ...], ModelWork] = {}
        """by the parameters of the model that it was made with"""
        self.own_interval = run.model.limits.interval.copy()
        self.own_settings = dict(run.settings.flat())
        """as session.toml has them"""
        self.frame = self.first_frame
        self.shown = self.start.copy()
        self.version = 0
        self.saved_clouds = self.clouds
        """the settings of [clouds] as session.toml has them"""
        self.size_pending = size_pending
        """the hand's size is to be fitted before the first tracking, or after it"""
        self.offered_scale: HandScale | None = None
        """the size that was fitted after tracking, and is not taken yet"""

    @property
    def model(self) -> ArticulatedModel:
        return self.run.model

    # ---- frames

    def see_frames(self) -> bool:
        """Take the session's frames as they are known by now; what lies outside of them goes. Return whether they changed."""
        known = self.run.session.known_frames
        if known == self.frames:
            return False
        self.frames, self.rows = known, TrackedRows(known)
        self.results = {f: result for f, result in self.results.items() if f in known}
        self.by_hand = {f: pose for f, pose in self.by_hand.items() if f in known}
        self.found = {f: pose for f, pose in self.found.items() if f in known}
        return True

    # ---- poses

    def show(self, frame: int) -> None:
        """Go to a frame (the nearest one of the session)."""
        self.frame = min(max(int(frame), self.frames.start), self.frames.stop - 1)
        self.shown = self.pose_at(self.frame)

    def pose_at(self, frame: int) -> Floats[S]:
        """Return the joint parameters of a frame."""
        if frame in self.by_hand:
            return self.by_hand[frame]
        if frame in self.results:
            return self.results[frame].parameters
        return self.start if frame == self.first_frame else self.shown

    def set_pose(self, frame: int, values: Sequence[float]) -> None:
        """Set a frame's pose by hand, moved into the limits, and show it."""
        given = np.asarray(values, dtype=float)
        if given.shape != (len(self.model.parameter_names),):
            return  # sent before the model changed
        self.frame = min(max(int(frame), self.frames.start), self.frames.stop - 1)
        self.shown = self.model.joint_params(params_of(self.model, given))
        self.by_hand[self.frame] = self.shown

    def set_found(self, frame: int, values: Sequence[float]) -> None:
        """Set a frame's pose to one that a search found, and show it."""
        self.set_pose(frame, values)
        if self.frame in self.by_hand:
            self.found[self.frame] = self.by_hand[self.frame]

    def is_found(self, frame: int) -> bool:
        """Return whether a frame's pose is as a search found it; undo may bring it back."""
        given, found = self.by_hand.get(frame), self.found.get(frame)
        return (
            given is not None and found is not None and bool(np.allclose(given, found, atol=1e-6))
        )

    def take_pose(self, frame: int, source: str) -> None:
        """Replace a frame's pose by the first-frame pose, by the frame before, or by the library's fingers."""
        current = self.pose_at(frame)
        if source in self.pose_names:
            body = self.model.kind == "body"
            taken = body_pose(self.model, source) if body else named_pose(self.model, source)
            taken[:6] = current[:6]
        elif source == "previous":
            known = [f for f in (*self.by_hand, *self.results) if f < frame]
            taken = self.pose_at(max(known)) if known else self.start
        else:
            taken = self.start
        self.set_pose(frame, taken.tolist())

    def pull_tip(self, frame: int, tip: str, target: Sequence[float]) -> None:
        """Bend a finger so that its tip comes to a point, and show it."""
        point = np.asarray(target, dtype=float)
        if tip in self.tip_names and point.shape == (3,) and np.isfinite(point).all():
            params = params_of(self.model, self.pose_at(frame))
            bent = self.model.joint_params(reach(self.model, params, tip, point))
            self.set_pose(frame, bent.tolist())

    @property
    def pose_names(self) -> tuple[str, ...]:
        """The pose library of the model."""
        return tuple(BODY_POSES) if self.model.kind == "body" else pose_names()

    @property
    def tip_names(self) -> tuple[str, ...]:
        return tip_names(self.model)

    def forget_pose(self, frame: int) -> None:
        """Drop what was set by hand at a frame."""
        self.by_hand.pop(frame, None)
        self.show(frame)

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

    def see_arm(self) -> bool:
        """Give the model a forearm if the frame shown has one beyond the hand; return whether it got one."""
        run = self.run.with_arm_in_view(self.frame, params_of(self.model, self.shown))
        if run is self.run:
            return False
        self.replace_run(run)
        return True

    def start_params(self, frame: int, anew: bool = False) -> Floats[P]:
        """Return solver parameters that tracking from a frame starts with.

        anew: at the first frame, its saved pose as `handtrack track` takes it, unless the user has moved it since.
        """
        first = self.run.first
        if anew and first is not None and first.frame == frame and frame not in self.by_hand:
            return self.run.initial()[1]
        return params_of(self.model, self.pose_at(frame))

    @property
    def is_posed(self) -> bool:
        """Whether anybody said where the hand is: else it stands somewhere in view."""
        return self.run.first is not None or bool(self.by_hand) or bool(self.results)

    def keyframes(self, frames: range) -> dict[int, Floats[P]]:
        """Return the poses set by hand at some of the frames, as solver parameters."""
        return {
            f: params_of(self.model, self.by_hand[f]) for f in sorted(self.by_hand) if f in frames
        }

    def accept(self, result: FrameResult, replaces_hand: bool = True) -> None:
        """Keep a tracked frame. It replaces a pose set by hand there, if tracking started from that."""
        if replaces_hand:
            self.by_hand.pop(result.frame, None)
        self.results[result.frame] = result

    # ---- settings

    def replace_run(self, run: Run) -> None:
        """Change to a run with another model or other settings; poses stay, by their names. What was made with a model
        is put aside while another one is looked at, and comes back with it.
        """
        old, new = self.model.parameter_names, run.model.parameter_names
        self.own_interval = run.model.limits.interval.copy()
        found = [frame for frame in self.by_hand if self.is_found(frame)]
        if new != old:
            self._other_models[old] = ModelWork(
                self.start, self.shown, self.by_hand, self.results, self.limits
            )
            none = np.zeros(len(new))
            back = self._other_models.pop(new, ModelWork(none, none))
            self.start = renamed(self.start, old, new, back.start)
            self.shown = renamed(self.shown, old, new, back.shown)
            self.by_hand = {
                frame: renamed(values, old, new, back.pose_at(frame))
                for frame, values in self.by_hand.items()
            }
            self.results = back.results
            kept = {name: pair for name, pair in self.limits.items() if name in new}
            self.limits = {n: pair for n, pair in back.limits.items() if n not in old} | kept
            self.found = {frame: self.by_hand[frame] for frame in found}
        self.run = run
        self._apply_limits()
        self.shown = self.model.joint_params(params_of(self.model, self.shown))

    def set_scale(self, scale: HandScale, pending: bool = False) -> None:
        """Change the hand's size. The first pose is fitted anew, unless the user set it. pending: it is to be fitted."""
        untouched = self.start
        self.replace_run(self.run.with_scale(scale))
        self.size_pending, self.offered_scale = pending, None
        if self.run.first is not None and self.first_frame == self.run.first.frame:
            self.start = self.model.joint_params(self.run.initial()[1])
            if self.shown is untouched or np.allclose(self.shown, untouched):
                self.shown = self.start.copy()

    def set_limits(self, name: str, interval: tuple[float, float] | None) -> None:
        """Change the interval of a joint parameter [rad]; None restores the model's own."""
        names = self.model.parameter_names
        if name not in names[6:]:
            raise unknown_name("parameter with limits", name, names[6:])
        if interval is None:
            self.limits.pop(name, None)
        else:
            low, high = sorted(float(np.clip(v, -np.pi, np.pi)) for v in interval)
            if not np.isfinite(low + high):
                raise HandtrackError(f"limits of {name}: expected two angles, found {interval}.")
            self.limits[name] = (low, high)
        self._apply_limits()
        self.shown = self.model.joint_params(params_of(self.model, self.shown))

    def _apply_limits(self) -> None:
        interval = self.own_interval.copy()
        for name, pair in self.limits.items():
            interval[self.model.parameter_names.index(name)] = pair
        model = replace(self.model, limits=replace(self.model.limits, interval=interval))
        self.run = replace(self.run, model=model)

    # ---- clouds

    @property
    def clouds(self) -> CloudSettings | None:
        """The settings of [clouds] in force."""
        return self.run.session.file.clouds

    def use_clouds(self, settings: CloudSettings | None) -> None:
        """Take other settings of [clouds] from now on. Raises HandtrackError, and changes nothing."""
        self.run = self.run.with_clouds(settings)

    @property
    def unsaved_clouds(self) -> tuple[str, ...]:
        """Names of the settings of [clouds] that differ from session.toml."""
        now, saved = ((c or CloudSettings()).table for c in (self.clouds, self.saved_clouds))
        return tuple(name for name in {**saved, **now} if now.get(name) != saved.get(name))
