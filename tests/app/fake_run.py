"""A tracking run without images: a hand before two cameras, tracked by closing it a little each frame."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from handtrack import (
    ArticulatedModel,
    Camera,
    CameraRig,
    FrameResult,
    HandScale,
    HandtrackError,
    ImageKeypoints,
    Observation,
    PointCloud,
    Silhouette,
    Status,
    Tracker,
    TrackerSettings,
    TrackingRun,
    TrackResult,
    load_model,
)
from handtrack.arrays import Array, Bytes, Floats
from handtrack.capture.clouds.cloud_filters import CloudFilters
from handtrack.capture.live.live_feed import LiveFeed
from handtrack.model.kinematics import BonePoses
from handtrack.observation.observation import ImageView
from handtrack.session.clouds_settings import CloudSettings
from handtrack.session.first_pose.first_pose import FirstPose
from handtrack.session.formats.truth import Truth
from handtrack.session.ineffective_settings import ineffective_settings
from handtrack.session.run import ReportProgress
from handtrack.session.session_file import (
    CameraSettings,
    HandSettings,
    RecordingSettings,
    SessionFile,
)
from handtrack.session.session_state import CameraCorrection
from handtrack.session.sources.corrected_masks import CorrectedMasks
from handtrack.session.sources.session_pins import SessionPins
from handtrack.session.sources.views import MaskChoice
from handtrack.tracking.frame.assessment import OutlineFit
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.reason import Reason
from handtrack.tracking.frame.result import TrackLabels
from handtrack.tracking.state import Step
from handtrack.tracking.whole.refinement import CameraError, Refinement
from handtrack_app.engine.document import Document, renamed
from tests.sample_track import labels_of, posed_frame

FRAMES = 12


def _camera(name: str, rotation: Floats, size: tuple[int, int] = (96, 72)) -> Camera:
    matrix = np.array([[90.0, 0.0, 48.0], [0.0, 90.0, 36.0], [0.0, 0.0, 1.0]])
    hand = np.array([0.0, 0.09, 0.0])
    return Camera(
        name, size, matrix, np.zeros(5), rotation, np.array([0.0, 0.0, 0.45]) - rotation @ hand
    )


@dataclass(frozen=True, eq=False)
class FakeView:
    """A camera that is said to have masks; the front one has images."""

    camera: Camera
    depth: None = None

    @property
    def name(self) -> str:
        return self.camera.name

    def keypoints(self, frame: int, least_px: float) -> tuple[ImageKeypoints, ...]:
        return ()

    @property
    def settings(self) -> CameraSettings:
        return CameraSettings(self.name, masks="masks/*.png")

    def image(self, frame: int) -> Array | None:
        return np.full((72, 96, 3), 10 * frame, np.uint8) if self.name == "front" else None

    def depth_m(self, frame: int) -> Array | None:
        return None

    def hand_pixels(self, frame: int) -> Bytes | None:
        return None

    @property
    def corrections(self) -> CorrectedMasks:
        return CorrectedMasks(Path(), self.name, self.camera.size)

    def own_frame(self, frame: int) -> int | None:
        return frame

    def silhouette(self, frame: int) -> Silhouette | None:
        return None


@dataclass(frozen=True, eq=False)
class FakeSession:
    """Two cameras, twelve frames, truth, no files."""

    folder: Path
    name: str = "fake"
    fps: float = 25.0
    rig: CameraRig = field(default_factory=lambda: CameraRig((
        _camera("front", np.diag([1.0, -1.0, -1.0])),
        _camera("side", np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])),
    )))  # fmt: skip
    truth: Truth | None = None
    warnings: tuple[str, ...] = ()
    has_clouds: bool = False
    cloud_filters: CloudFilters = field(default_factory=CloudFilters)
    cloud_camera_centres: Floats | None = None
    is_counted: bool = True
    live: LiveFeed | None = None
    corrections: Mapping[str, CameraCorrection] = field(default_factory=dict)
    held: list[SessionPins] = field(default_factory=list)

    @property
    def pins(self) -> SessionPins:
        if not self.held:
            self.held.append(SessionPins(self.folder, self.rig))
        return self.held[0]

    @property
    def views(self) -> tuple[FakeView, ...]:
        return tuple(FakeView(camera) for camera in self.rig.cameras)

    @property
    def file(self) -> SessionFile:
        cameras = tuple(view.settings for view in self.views)
        return SessionFile(RecordingSettings(self.name, self.fps), HandSettings(), cameras)

    def with_masks(self, wanted: Mapping[str, MaskChoice]) -> FakeSession:
        raise HandtrackError("the fake session has no masks to be changed")

    def with_cameras(self, corrections: Mapping[str, CameraCorrection]) -> FakeSession:
        calibrated = FakeSession(self.folder).rig
        cameras = [
            corrections[c.name].error.corrected(c) if c.name in corrections else c
            for c in calibrated
        ]
        return replace(self, rig=CameraRig(tuple(cameras)), corrections=corrections)

    @property
    def corrected(self) -> dict[str, str]:
        return {name: one.error.figures for name, one in self.corrections.items()}

    def calibration_digest(self, camera: str) -> str:
        return camera

    def forget_observations(self) -> None:
        pass

    def view(self, camera: str) -> FakeView:
        return FakeView(self.rig[camera])

    def measured_cloud(self, frame: int) -> PointCloud | None:
        return None

    @property
    def frame_range(self) -> range:
        return range(FRAMES)

    @property
    def known_frames(self) -> range:
        return range(FRAMES)

    def time_s(self, frame: int) -> float:
        return frame / self.fps

    def observation(self, frame: int, silhouettes: bool = True, cloud: bool = True) -> Observation:
        return Observation(frame, frame / self.fps)

    def image(self, camera: str, frame: int) -> Array | None:
        return self.view(camera).image(frame)

    def images(self, frame: int) -> tuple[ImageView, ...]:
        return ()


@dataclass(frozen=True, eq=False)
class FakeRun:
    """Like TrackingRun as far as the workbench knows it. A frame takes `step_s`, in ten solver steps."""

    session: FakeSession
    model: ArticulatedModel
    settings: TrackerSettings = field(default_factory=TrackerSettings)
    first: FirstPose | None = None
    step_s: float = 0.02
    broken: bool = False
    sizing: Callable[[], object] = lambda: None
    doubt: Reason | None = None
    """of any pose, by itself"""
    forearm: bool = False
    stuck: Callable[[int], bool] = lambda _: False
    """whether a frame is not done yet, however long it has taken"""
    hungry: bool = False
    """a frame takes 100 GB"""
    refined_by: float = 0.0
    refined_size: float = 0.0
    """[rad] by which refining bends the index finger"""
    refined_cameras: tuple[CameraError, ...] = ()
    """what refining finds the cameras to be off by"""

    @property
    def notes(self) -> list[str]:
        return ineffective_settings(self.settings, self.session, self.model.kind)

    def with_values(self, overrides: Mapping[str, object]) -> FakeRun:
        settings = self.settings.with_values(overrides)
        wanted = settings.model.forearm
        forearm = self.forearm if wanted == "auto" else wanted == "true"
        name, coupling = settings.model.name or "hand26", settings.model.coupling
        model = load_model(name, coupling=coupling, forearm=forearm)
        return replace(self, settings=settings, model=model, forearm=forearm)

    def with_parameters(self, names: Sequence[str]) -> FakeRun:
        other = self.with_forearm(not self.forearm)
        return other if other.model.parameter_names == tuple(names) else self

    def observation(self, frame: int, bones: BonePoses | None = None) -> Observation:
        return self.session.observation(frame)

    def with_clouds(self, clouds: CloudSettings | None) -> FakeRun:
        raise HandtrackError("the fake session has no clouds")

    @property
    def arm(self) -> bool | float:
        return self.forearm

    def with_forearm(self, on: bool | float) -> FakeRun:
        model = load_model("hand26", coupling=self.model.coupling, forearm=on)
        return replace(self, forearm=on > 0, model=model)

    def with_arm_in_view(self, frame: int, params: Floats) -> FakeRun:
        return self

    def fit_of(self, frame: int, params: Floats) -> tuple[Reason | None, OutlineFit | None]:
        return self.doubt, None

    sizes_first = size_is_open = True

    def with_limits_of(self, other: FakeRun) -> FakeRun:
        return self

    def joint_params_from(self, other: FakeRun, joint_params: Floats) -> Floats:
        names = self.model.parameter_names
        return renamed(joint_params, other.model.parameter_names, names, self.model.rest)

    @property
    def tracker(self) -> Tracker:
        return Tracker(self.model, self.settings.with_values({"tracker.hypotheses": 1}))

    def observation_of(self, result: FrameResult) -> Observation:
        return self.session.observation(result.frame)

    @property
    def scale(self) -> HandScale:
        return self.model.scale

    def with_scale(self, scale: HandScale) -> FakeRun:
        model = load_model(
            "hand26", scale=scale, coupling=self.model.coupling, forearm=self.forearm
        )
        return replace(self, model=model)

    def fit_size(
        self,
        should_stop: Callable[[], bool] | None = None,
        on_progress: ReportProgress | None = None,
        tracked: Iterable[FrameResult] | None = None,
    ) -> FakeRun:
        if on_progress is not None:
            on_progress(0.5, "5 of 10 frames tracked", self._result(5, self.model.rest_params(), 3))
        self.sizing()  # it looks up too rarely
        return self.with_scale(HandScale(1.1))

    def initial(self) -> tuple[int, Floats]:
        return 3, self.model.rest_params()

    def track(
        self,
        frames: range,
        start_frame: int,
        start_params: Floats,
        control: Control = Control(),
        done: Sequence[Step] = (),
    ) -> Iterator[FrameResult]:
        path = [*range(start_frame, frames.stop), *range(start_frame - 1, frames.start - 1, -1)]
        for frame in path:
            while self.stuck(frame) and not control.should_stop():
                time.sleep(0.01)
            for _ in range(10):
                busy_for(self.step_s / 10)
                if control.should_stop():
                    return
            if self.broken and frame > start_frame:
                raise ValueError("a mistake of ours")
            if self.hungry:
                np.ones(12_500_000_000)
            result = self._result(frame, start_params, start_frame)
            if control.on_provisional is not None:
                control.on_provisional(result)
            yield result

    def refined(
        self,
        tracked: Sequence[FrameResult],
        control: Control = Control(),
        held: Mapping[int, Floats] | None = None,
        changed: Sequence[int] | None = None,
        pinned: Mapping[int, Floats] | None = None,
    ) -> list[FrameResult]:
        if not self.refined_by:
            return list(tracked)
        control.on_refined(0.5)
        if self.refined_size or self.refined_cameras:
            found_size = HandScale(self.refined_size) if self.refined_size else None
            control.on_shared(Refinement("converged", 1, self.refined_cameras, found_size).text)
        bend = self.model.parameter_names.index("index_mcp_flex")
        near = lambda frame: changed is None or min(abs(frame - k) for k in changed) <= 1  # noqa: E731
        found = []
        for result in tracked:
            joint = result.parameters.copy()
            joint[bend] += self.refined_by * near(result.frame)
            bones = self.model.bones(self.model.transform.solver_params(joint))
            places = self.model.joint_positions(bones)
            moved = replace(result, parameters=joint, joint_positions=places)
            found.append(moved if near(result.frame) else result)
        return found

    def _result(self, frame: int, params: Floats, first: int) -> FrameResult:
        joint = self.model.joint_params(params)
        joint[6:] = np.clip(joint[6:] + 0.02 * (frame - first), *self.model.limits.interval[6:].T)
        more = {"status": Status.DOUBTFUL if frame == 7 else Status.TRACKED, "energy": float(frame)}
        return posed_frame(self.model, frame, joint, self.session.fps, **more)

    @property
    def labels(self) -> TrackLabels:
        return labels_of(self.model, self.session.name)

    def result(self, frames: Iterable[FrameResult]) -> TrackResult:
        return self.labels.track(sorted(frames, key=lambda r: r.frame))


def busy_for(seconds: float) -> None:
    """Work like a solver: numbers, mostly in compiled code, some of it in Python."""
    until = time.perf_counter() + seconds
    matrix = np.ones((64, 64))
    while time.perf_counter() < until:
        for _ in range(20):
            np.linalg.solve(matrix + np.eye(64), matrix)


def fake_document(
    folder: Path,
    overrides: Mapping[str, object] | None = None,
    size_pending: bool = False,
    **options: Any,
) -> Document:
    """Return a document of the fake session; the truth is the relaxed hand."""
    model = load_model("hand26", coupling=str((overrides or {}).get("model.coupling", "26")))
    params = model.rest_params()
    points = np.tile(model.keypoints21(model.bones(params)), (FRAMES, 1, 1))
    truth = Truth(np.arange(FRAMES), None, points, (), None)
    session = FakeSession(folder, truth=truth)
    first = FirstPose(3, dict(zip(model.parameter_names, model.rest.tolist(), strict=True)))
    run = cast("TrackingRun", FakeRun(session, model, first=first, **options))
    return Document(run, 3, params, size_pending)
