"""Benchmark: a real person, OpenPose joints in four cameras, nothing else given: how near are the body's joints in the images?

Data: pose2sim_body_4cam of the shared test data (HANDTRACK_DATA); its calibration is off by some 15 px a camera (its README). First pose, size,
the detector's offsets and the cameras' corrections are found as `handtrack track SESSION --init auto` finds them.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from handtrack.arrays import D2, Floats, J, N
from handtrack.files.toml_edit import edit_toml
from handtrack.geometry.camera import Camera
from handtrack.geometry.triangulation import triangulated
from handtrack.model.articulated import ArticulatedModel
from handtrack.observation.observation import ImageKeypoints
from handtrack.session.first_pose.first_pose_search import find_first_poses
from handtrack.session.layout import SESSION_FILE
from handtrack.session.run import TrackingRun
from handtrack.session.session import Session
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.result import FrameResult, Status
from handtrack.tracking.whole.refinement import Refinement
from tests.experiments.silhouettes.person_session import CAMERAS, write_session

FRAMES = 100


@dataclass(frozen=True, eq=False)
class Person:
    """A tracked recording: as it came, and refined."""

    run: TrackingRun
    live: Sequence[FrameResult]
    refined: Sequence[FrameResult]
    shared: Refinement
    """what all frames share"""

    @property
    def model(self) -> ArticulatedModel:
        """The person as all frames say."""
        scale = self.shared.scale
        return self.run.model if scale is None else self.run.with_scale(scale).model


def tracked(folder: Path, cameras: Sequence[str] = CAMERAS, frames: int = FRAMES) -> Person:
    """Return the recording tracked from nothing but the joints of some cameras; folder: an empty one, for the session."""
    write_session(folder, cameras)
    edit_toml(folder / SESSION_FILE, {"hand.scale": "fit"}, "a session's settings")
    return tracked_alone(Session.open(folder), range(frames), {})


def tracked_alone(session: Session, frames: range, settings: Mapping[str, object]) -> Person:
    """Return a session tracked as `handtrack track SESSION --init auto` does, with settings that differ from its own."""
    look = TrackingRun.open(session, settings, use_init=False)
    first = find_first_poses(look, frames)[0]
    run = TrackingRun.open(session, settings, first.first_pose)
    frame, start = run.initial()
    told: list[str] = []
    control = Control(on_shared=told.append)
    results = list(run.track_with(control, frames, frame, start))
    count = len(frames)
    return Person(run, results[:count], results[count:], Refinement.read(told[-1]))


def residuals_px(
    run: TrackingRun, model: ArticulatedModel, results: Sequence[FrameResult], shared: Refinement | None = None
) -> dict[str, Floats[N, D2]]:  # fmt: skip
    """Return, by camera, how far from its joints the detector's points of the model are [px]. shared: cameras as it corrects them."""
    found: dict[str, list[Floats]] = {}
    for result in results:
        points = model.bones(model.transform.solver_params(result.parameters)).to_world(model.joint_bone, model.seen_point)  # fmt: skip
        for camera, names, pixels in _views(run, result.frame, shared):
            off = camera.project(points[[model.joint_names.index(name) for name in names]]) - pixels
            found.setdefault(camera.name, []).append(off[np.isfinite(off).all(axis=1)])
    return {name: np.concatenate(parts) for name, parts in found.items()}


def freely_px(run: TrackingRun, shared: Refinement | None = None) -> Floats[N]:
    """Return how far from the cameras' joints points are that are triangulated freely, joint by joint [px]."""
    found = []
    for frame in range(FRAMES):
        views = list(_views(run, frame, shared))
        cameras, pixels = [camera for camera, _, _ in views], np.array([p for _, _, p in views])
        points = triangulated(cameras, pixels)
        off = [c.project(points) - seen for c, seen in zip(cameras, pixels, strict=True)]
        found.append(np.linalg.norm(off, axis=2).ravel())
    every = np.concatenate(found)
    return every[np.isfinite(every)]


def _views(
    run: TrackingRun, frame: int, shared: Refinement | None
) -> Iterator[tuple[Camera, tuple[str, ...], Floats[J, D2]]]:
    """Yield each camera with all of its joints; those of several sigmas are sets of their own."""
    sets: dict[Camera, list[ImageKeypoints]] = {}
    for one in run.observation(frame).keypoints:
        assert isinstance(one, ImageKeypoints)
        sets.setdefault(one.camera, []).append(one)
    for camera, parts in sets.items():
        pixels = np.array([one.pixels for one in parts])
        known = np.asarray(np.isfinite(pixels).all(axis=2))
        merged = np.where(known[..., None], pixels, 0.0).sum(axis=0)
        merged[~known.any(axis=0)] = np.nan
        yield (camera if shared is None else shared.corrected(camera)), parts[0].names, merged


def four_cameras() -> dict[str, object]:
    """Return medians and 90 % quantiles of the residuals [px]: as it came, refined, refined and seen through the corrected cameras; those of free
    triangulation, through the cameras as calibrated and corrected; and of each camera that was left out, how the fit by the other three lies in it: by
    how much all of it is aside, and how far joints are about that.
    """
    figures: dict[str, object] = {"truth": "none: all are distances in the images"}
    with tempfile.TemporaryDirectory() as place:
        (folder := Path(place) / "all").mkdir()
        found = tracked(folder)
        run, shared = found.run, found.shared
        kinds = {
            "live": residuals_px(run, run.model, found.live),
            "refined": residuals_px(run, found.model, found.refined),
            "corrected": residuals_px(run, found.model, found.refined, shared),
        }
        for kind, by_camera in kinds.items():
            figures |= _said(kind, np.concatenate(list(by_camera.values())))
            for camera, off in by_camera.items():
                figures[f"{kind}_{camera}_offset_px"] = np.median(off, axis=0).round(1).tolist()
        figures |= _said("freely", freely_px(run)) | _said("freely_corrected", freely_px(run, shared))  # fmt: skip
        figures["tracked"] = sum(r.status == Status.TRACKED for r in found.refined)
        figures["frames"] = len(found.refined)
        for left in CAMERAS:
            (folder := Path(place) / left).mkdir()
            three = tracked(folder, [name for name in CAMERAS if name != left])
            off = residuals_px(run, three.model, three.refined)[left]
            figures[f"left_out_{left}_offset_px"] = np.median(off, axis=0).round(1).tolist()
            figures |= _said(f"left_out_{left}_about_it", off - np.median(off, axis=0))
    return figures


def _said(kind: str, off: Floats) -> dict[str, float]:
    far = off if off.ndim == 1 else np.linalg.norm(off, axis=1)
    return {f"{kind}_median_px": float(np.median(far)), f"{kind}_90_percent_px": float(np.percentile(far, 90))}  # fmt: skip
