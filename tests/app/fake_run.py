"""A tracking run without images: a hand before two cameras, tracked by closing it a little each frame."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from handtrack import (
    Camera,
    CameraRig,
    FrameResult,
    HandScale,
    Session,
    Status,
    TrackerSettings,
    TrackingRun,
    load_model,
)
from handtrack.session.first_pose import FirstPose
from handtrack.session.session_file import (
    CameraSettings,
    HandSettings,
    RecordingSettings,
    SessionFile,
)
from handtrack.session.sources.views import View
from handtrack.session.truth import Truth
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.reason import Reason
from handtrack.tracking.whole.refinement import CameraError, Refinement
from handtrack_app.engine.document import Document
from tests.cameras import pinhole
from tests.sample_track import posed_frame

FRAMES = 12
SPOT = (41, 29)
"""the middle of a white square of 3 px in the front camera's dark images"""
TURNS = {"front": [[1, 0, 0], [0, -1, 0], [0, 0, -1]], "side": [[0, 0, 1], [0, -1, 0], [1, 0, 0]]}


def _camera(name: str) -> Camera:
    turn = np.array(TURNS[name], float)
    shift = np.array([0.0, 0.0, 0.45]) - turn @ (0.0, 0.09, 0.0)
    return pinhole(name, (96, 72), 90.0, turn, shift, at=(48.0, 36.0))


class FakeView(View):
    """A camera that is said to have masks; the front one has images."""

    def _mask_files(self):
        return None

    def image(self, frame):
        if self.name != "front":
            return None
        image = np.full((72, 96, 3), 10 * frame, np.uint8)
        image[SPOT[1] - 1 : SPOT[1] + 2, SPOT[0] - 1 : SPOT[0] + 2] = 255
        return image


class FakeSession(Session):
    """Two cameras, twelve frames, truth, no files."""

    frame_count = FRAMES  # type: ignore[assignment]
    known_frames = range(FRAMES)  # type: ignore[assignment]

    def _views(self):
        return tuple(FakeView(self.folder, c, self.rig[c.name]) for c in self.file.cameras)


@dataclass(frozen=True)
class FakeRun(TrackingRun):
    """A frame takes `step_s`, in ten solver steps."""

    step_s: float = 0.02
    broken: bool = False
    sizing: Callable[[], object] = lambda: None
    doubt: Reason | None = None
    """of any pose, by itself"""
    stuck: Callable[[int], bool] = lambda _: False
    """whether a frame is not done yet, however long it has taken"""
    hungry: bool = False
    """a frame takes 100 GB"""
    refined_by: float = 0.0
    """[rad] by which refining bends the index finger"""
    refined_size: float = 0.0
    refined_cameras: tuple[CameraError, ...] = ()
    """what refining finds the cameras to be off by"""

    def fit_of(self, frame, params):
        return self.doubt, None

    def fit_size(self, control=Control(), tracked=None):
        control.observer.progress(0.5, "5 of 10 frames tracked", "size")
        control.observer.tried(self._result(5, self.model.rest_params(), 3))
        self.sizing()  # it looks up too rarely
        return self.with_scale(HandScale(1.1))

    def track(
        self, frames, start_frame, start_params, control=Control(), done=()
    ) -> Iterator[FrameResult]:
        path = [*range(start_frame, frames.stop), *range(start_frame - 1, frames.start - 1, -1)]
        for frame in path:
            while self.stuck(frame) and not control.should_stop():
                time.sleep(0.01)
            for _ in range(10):
                time.sleep(self.step_s / 10)
                if control.should_stop():
                    return
            if self.broken and frame > start_frame:
                raise ValueError("a mistake of ours")
            if self.hungry:
                np.ones(12_500_000_000)
            result = self._result(frame, start_params, start_frame)
            control.observer.provisional(result)
            yield result

    def refined(self, tracked, control=Control(), held=None, changed=None, pinned=None):
        if not self.refined_by:
            return list(tracked)
        control.observer.progress(0.5)
        if self.refined_size or self.refined_cameras:
            found_size = HandScale(self.refined_size) if self.refined_size else None
            control.observer.shared(
                Refinement("converged", 1, self.refined_cameras, found_size).text
            )
        bend = self.model.parameter_names.index("index_mcp_flex")
        found = []
        for result in tracked:
            if changed is None or min(abs(result.frame - k) for k in changed) <= 1:
                joint = result.parameters.copy()
                joint[bend] += self.refined_by
                result = self._posed(result.frame, joint)
            found.append(result)
        return found

    def _result(self, frame, params, first):
        joint = self.model.joint_params(params)
        joint[6:] = np.clip(joint[6:] + 0.02 * (frame - first), *self.model.limits.interval[6:].T)
        return self._posed(frame, joint)

    def _posed(self, frame, joint):
        more = {"status": Status.DOUBTFUL if frame == 7 else Status.TRACKED, "energy": float(frame)}
        return posed_frame(self.model, frame, joint, self.session.fps, **more)


def fake_document(folder: Path, size_pending: bool = False, **options: Any) -> Document:
    """Return a document of the fake session; the truth is the relaxed hand."""
    model = load_model("hand26")
    params = model.rest_params()
    cameras = tuple(CameraSettings(name, masks="masks/*.png") for name in TURNS)
    file = SessionFile(RecordingSettings("fake", 25.0), HandSettings(scale="fit"), cameras)
    session = FakeSession(folder, file, CameraRig(tuple(map(_camera, TURNS))))
    points = np.tile(model.keypoints21(model.bones(params)), (FRAMES, 1, 1))
    session.truth = Truth(np.arange(FRAMES), None, points, (), None)
    first = FirstPose(3, dict(zip(model.parameter_names, model.rest.tolist(), strict=True)))
    run = FakeRun(session, first, TrackerSettings(), 0.0, model, **options)
    return Document(run, 3, params, size_pending)
