"""Benchmark: a real hand marked by a person, tracked from its images alone, against robust triangulation of the same detected joints.

Data: marked_real_5cam and the hand detector's weights of the shared test data (HANDTRACK_DATA). Joints are detected, then first pose, size and the
detector's offsets are found and the hand is tracked as `handtrack detect --write` and `handtrack track SESSION --init auto` do; the marks are not in
the session. Compared are the points that two cameras see: the reference has no others. Figures are those of `handtrack evaluate`; the reference's
constant offsets are in the bones of the hand tracked by joints.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from types import MappingProxyType

import numpy as np

from handtrack import Camera, Session, TrackResult, evaluate
from handtrack.arrays import D2, D3, D21, C, F, Floats, N
from handtrack.bench.measuring import data_folder
from handtrack.detector.hand_detector import HandDetector
from handtrack.diagnostics.metrics import BENT_JOINTS
from handtrack.files.toml_edit import edit_toml
from handtrack.geometry.triangulation import missed_px, triangulated
from handtrack.model.articulated import keypoint_names
from handtrack.session.detection import JointDetection, camera_changes, keypoint_settings
from handtrack.session.layout import INIT_FILE, SESSION_FILE, TRUTH_FILE
from handtrack.session.truth import Truth
from tests.experiments.silhouettes.four_cameras import tracked_alone

RECORDING = "marked_real_5cam"
_ROUNDS = 30  # 99 % of a real hand's joints move by less than 0.2 mm in another 270
SCALE_PX = 3.0
"""of the reference's loss; joints are not weighted by the detector's confidences"""
LATE_S = {"cam0": 0.0166, "cam6": 0.0166}
"""[s] by how much these cameras' images are late: half a frame, by the marks (the recording's README)"""
USES: Mapping[str, dict[str, object]] = {
    "joints": {"silhouettes.weight": 0.0, "cloud.weight": 0.0},
    "joints_clouds": {"silhouettes.weight": 0.0},
    "everything": {},
}
"""settings; by joints alone tracking has the reference's input"""
_SHOWN = {
    "mm": "mpjpe_mm",
    "median_mm": "mpjpe_median_mm",
    "offset_free_mm": "offset_free_mm",
    "flexion_deg": "flexion_deg",
    "jitter_mm": "jitter_mm",
}
"""of `evaluate`'s figures, by what they are called here"""


def triangulated_landmarks() -> dict[str, object]:
    """Return figures of tracked landmarks and joint centres, and of triangulated points; ratio: of mean errors, by joints alone.

    `times_given`: where both know `LATE_S`; elsewhere the cameras' times are for tracking to find, and triangulation takes them as one.
    """
    with tempfile.TemporaryDirectory() as place:
        source = data_folder() / "sessions" / RECORDING
        session, truth = detected_session(source, Path(place) / RECORDING)
        points = triangulated_points(session)[truth.frame]
        tracks = {use: tracked_with(session, settings) for use, settings in USES.items()}
        in_time = triangulated_points(session, LATE_S)[truth.frame]
        lags = camera_changes(session, LATE_S, lambda camera: {"lag_s": LATE_S[camera.name]})
        edit_toml(session.folder / SESSION_FILE, lags, "a session's settings")
        tracks["times_given_joints"] = tracked_with(Session.open(session.folder), USES["joints"])
    assert truth.keypoints21 is not None
    common = np.where(np.isfinite(points), truth.keypoints21, np.nan)
    seen = replace(truth, keypoints21=common)
    figures: dict[str, object] = {}
    for use, track in tracks.items():
        definition = track.landmark_definition
        assert definition is not None, "joints were detected by two cameras"
        figures |= errors(f"{use}_landmarks", track.in_landmarks(definition), seen)
        figures |= errors(f"{use}_centres", track, seen)
    head: dict[str, object] = {}
    for times, found in (("", points), ("times_given_", in_time)):
        by_joints = tracks[f"{times}joints"].between(range(truth.frame[0], truth.frame[-1] + 1))
        figures |= errors(f"{times}triangulated", replace(by_joints, keypoints21=found), seen)
        ours, reference = (figures[f"{times}{which}_mm"] for which in ("joints_landmarks", "triangulated"))  # fmt: skip
        assert isinstance(ours, float) and isinstance(reference, float)
        head[f"{times}ratio"] = ours / reference
    head |= {
        "reference": f"robust triangulation, Cauchy {SCALE_PX:g} px, without confidences",
        "points": int(np.isfinite(common).all(axis=2).sum()),
    }
    return head | figures


def tracked_with(session: Session, settings: Mapping[str, object]) -> TrackResult:
    """Return a session as `tracked_alone` tracks it with settings."""
    person = tracked_alone(session, session.frame_range, dict(settings))
    return person.run.with_scale(person.model.scale).result(person.refined)


def detected_session(source: Path, folder: Path) -> tuple[Session, Truth]:
    """Return a recording with its detected joints, written to a new folder, and the truth, which is not in it."""
    shutil.copytree(source, folder, copy_function=shutil.copyfile)
    truth = Session.open(folder).truth
    assert truth is not None
    for name in (TRUTH_FILE, INIT_FILE):
        (folder / name).unlink()
    session = Session.open(folder)
    if any(camera.keypoints for camera in session.file.cameras):
        return session, truth
    detector = HandDetector.open(data_folder() / "hand_detector" / "hand_landmarker.task")
    detection = JointDetection(session, detector)
    for frame in session.frame_range:
        detection.step(frame)
    where = [camera for camera, row in detection.write().items() if row["found"]]
    changes = camera_changes(session, where, keypoint_settings)
    edit_toml(folder / SESSION_FILE, changes, "a session's settings")
    return Session.open(folder), truth


def triangulated_points(
    session: Session, late_s: Mapping[str, float] = MappingProxyType({})
) -> Floats[F, D21, D3]:
    """Return the detected joints in space, world [m]; NaN where fewer than two cameras see one.

    late_s: of cameras; where theirs were in time lies between two images, or at one where the other does not show them.
    """
    names, frames = keypoint_names(), session.frame_range
    views = [view for view in session.views if view.keypoint_files is not None]
    cameras = [view.camera.without_distortion() for view in views]
    pixels = np.full((len(frames), len(views), len(names), 2), np.nan)
    for n, frame in enumerate(frames):
        for row, view in enumerate(views):
            for joints in view.keypoints(frame, 1.0):
                known = np.flatnonzero(np.isfinite(joints.pixels).all(axis=1))
                columns = [names.index(joints.names[k]) for k in known]
                pixels[n, row, columns] = joints.pixels[known]
    for row, view in enumerate(views):
        share = late_s.get(view.camera.name, 0.0) * session.fps
        own = pixels[:, row]
        between = (1.0 - share) * own + share * np.concatenate([own[1:], own[-1:]])
        pixels[:, row] = np.where(np.isfinite(between), between, own)
    return np.array([robustly_triangulated(cameras, seen, SCALE_PX) for seen in pixels])


def robustly_triangulated(
    cameras: Sequence[Camera], pixels: Floats[C, N, D2], scale_px: float
) -> Floats[N, D3]:
    """Return points whose images are nearest to where cameras see them, world [m]; NaN as `triangulated` has it.

    Cauchy's loss of the distances in the images, ½ s² log(1 + (r/s)²) with s = scale_px: beyond that, a camera counts for ever
    less. Reweighted least squares from the plain solution, where a distance from a line of sight is depth / focal length
    times that in the image.
    """
    points = triangulated(cameras, pixels)
    focal = np.array([np.sqrt(np.prod(np.diag(camera.matrix)[:2])) for camera in cameras])
    for _ in range(_ROUNDS):
        depth = np.stack([camera.to_camera(points)[:, 2] for camera in cameras])
        missed = missed_px(cameras, pixels, points)
        with np.errstate(invalid="ignore", divide="ignore"):
            weights = (focal[:, None] / depth) ** 2 / (1.0 + (missed / scale_px) ** 2)
        points = triangulated(cameras, pixels, weights=np.nan_to_num(weights, posinf=0.0))
    return points


def errors(name: str, track: TrackResult, truth: Truth) -> dict[str, object]:
    """Return `evaluate`'s figures of a track, and the mean errors of the fingers' flexion and of the thumb's, by names that begin so."""
    found = evaluate(track, truth)
    shown: dict[str, object] = {f"{name}_{k}": found[figure] for k, figure in _SHOWN.items()}
    for part, free in product(("thumb", "finger"), ("", "offset_free_")):
        bent = [joint for joint in BENT_JOINTS if joint.startswith("thumb") == (part == "thumb")]
        angles = [found[f"flexion_{joint}_{free}deg"] for joint in bent]
        known = [angle for angle in angles if angle is not None]
        shown[f"{name}_{part}_flexion_{free}deg"] = float(np.mean(known))
    return shown
