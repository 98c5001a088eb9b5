"""Benchmarks: a real person, OpenPose joints in four cameras: fitted by all of them, and by one with hypotheses.

Data: pose2sim_body_4cam of the shared test data (HANDTRACK_DATA); its calibration is off by some 15 px a camera (its README). First pose, size,
the detector's offsets and the cameras' corrections are found as `handtrack track SESSION --init auto` finds them. There is no measured truth: the
fit by all four stands for it where one camera is judged.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from handtrack import (
    ArticulatedModel,
    Camera,
    FrameResult,
    HandScale,
    ImageKeypoints,
    Session,
    TrackingRun,
)
from handtrack.arrays import D2, Floats, J, N
from handtrack.bench.measuring import data_folder
from handtrack.capture.calibration.formats.read_calibration import named, read_calibration
from handtrack.capture.calibration.rig_file import write_rig
from handtrack.geometry.triangulation import triangulated
from handtrack.model.model_file import write_scale
from handtrack.session.first_pose import FirstPose
from handtrack.session.first_pose_search import find_first_poses
from handtrack.session.track_session import Refining
from handtrack.tracking.frame.control import Control
from handtrack.tracking.whole.refinement import Refinement

DATA = "pose2sim_body_4cam"
CAMERAS = ("cam01", "cam02", "cam03", "cam04")
_UNIT_M = 1e-3  # of the calibration
FRAMES, SHOWN, NEAR_MM = 100, 8, 80.0
SETTINGS: dict[str, object] = {"keypoints.sigma_px": 10.0, "prior.motion_sigma_deg": 2.5}
"""the calibration's error, as its README tells it; accelerations of an angle as in captured motion, for frames half as long"""


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


def person_session(folder: Path, cameras: Sequence[str], scale: HandScale | None) -> Session:
    """Write a session of the recording, seen by some of its cameras, into a new folder; scale: of a person who is known."""
    data = data_folder() / DATA
    file = data / "Calib.qca.txt"
    given, _ = named(read_calibration([file]), CAMERAS, str(file))
    folder.mkdir()
    write_rig(folder / "calibration.toml", given.rig(_UNIT_M))
    lines = ["[session]", "format = 1", 'name = "person"', "fps = 60.0", "", "[hand]"]
    lines += ['model = "body34"', f'scale = "{"body.json" if scale else "fit"}"']
    for name in cameras:
        lines += ["", "[[camera]]", f'name = "{name}"', 'keypoint_layout = "body_25b"']
        lines += [f'keypoints = "{name}/*.json"']
        shutil.copytree(data / "pose" / f"{name}_json", folder / name)
    (folder / "session.toml").write_text("\n".join(lines) + "\n")
    if scale:
        write_scale(folder / "body.json", scale)
    return Session.open(folder)


def tracked_alone(session: Session, frames: range, settings: Mapping[str, object]) -> Person:
    """Return a session tracked as `handtrack track SESSION --init auto` does, with settings that differ from its own."""
    look = TrackingRun.open(session, settings, use_init=False)
    first = find_first_poses(look, frames)[0]
    run = TrackingRun.open(session, settings, FirstPose.of(first))
    frame, start = run.initial()
    told = Refining()
    results = list(run.track(frames, frame, start, Control(observer=told)))
    count = len(frames)
    return Person(run, results[:count], results[count:], Refinement.read(told.refinement))


def residuals_px(
    run: TrackingRun, model: ArticulatedModel, results: Sequence[FrameResult], shared: Refinement | None = None
) -> Floats[N]:  # fmt: skip
    """Return how far from its joints the detector's points of the model are [px]. shared: cameras as it corrects them."""
    found = []
    for result in results:
        points = model.bones(model.transform.solver_params(result.parameters)).to_world(model.joint_bone, model.observed_point)  # fmt: skip
        for camera, names, pixels in _views(run, result.frame, shared):
            rows = [model.joint_names.index(name) for name in names]
            found.append(np.linalg.norm(camera.project(points[rows]) - pixels, axis=1))
    return _finite(np.concatenate(found))


def freely_px(run: TrackingRun, shared: Refinement | None = None) -> Floats[N]:
    """Return how far from the cameras' joints points are that are triangulated freely, joint by joint [px]."""
    found = []
    for frame in range(FRAMES):
        views = list(_views(run, frame, shared))
        cameras, pixels = [camera for camera, _, _ in views], np.array([p for _, _, p in views])
        points = triangulated(cameras, pixels)
        off = [c.project(points) - seen for c, seen in zip(cameras, pixels, strict=True)]
        found.append(np.linalg.norm(off, axis=2).ravel())
    return _finite(np.concatenate(found))


def _finite(values: Floats[N]) -> Floats[N]:
    return values[np.isfinite(values)]


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


def four_cameras() -> dict[str, float]:
    """Return medians and 90 % quantiles of the residuals [px]: as it came, refined, refined and seen through the corrected cameras; and those of
    free triangulation, through the cameras as calibrated and corrected.
    """
    with tempfile.TemporaryDirectory() as place:
        session = person_session(Path(place) / "all", CAMERAS, None)
        found = tracked_alone(session, range(FRAMES), {})
        run, shared = found.run, found.shared
        kinds = {
            "live": residuals_px(run, run.model, found.live),
            "refined": residuals_px(run, found.model, found.refined),
            "refined_corrected": residuals_px(run, found.model, found.refined, shared),
            "triangulated": freely_px(run),
            "triangulated_corrected": freely_px(run, shared),
        }
    return {
        f"{kind}_{name}_px": float(np.percentile(off, q))
        for kind, off in kinds.items()
        for name, q in (("median", 50), ("p90", 90))
    }


def balancing() -> dict[str, float]:
    """Return single cameras' mean joint errors [mm] against the fit by all four, whose size they are given: of the best hypothesis of eight, also
    relative to the pelvis, of the one chosen, and of one alone.
    """
    figures = {}
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        every = tracked_alone(person_session(place / "all", CAMERAS, None), range(FRAMES), {})
        for camera in CAMERAS:
            session = person_session(place / camera, [camera], every.model.scale)
            several = _errors(session, every, SHOWN)
            best = several.min(axis=1)
            figures |= {
                f"{camera}_best_of_8_mm": float(best[:, 0].mean()),
                f"{camera}_best_of_8_within_80mm": float((best[:, 0] < NEAR_MM).mean()),
                f"{camera}_best_of_8_relative_mm": float(best[:, 1].mean()),
                f"{camera}_chosen_mm": float(several[:, 0, 0].mean()),
                f"{camera}_one_hypothesis_mm": float(_errors(session, every, 1)[:, 0, 0].mean()),
            }
    return figures


def _errors(session: Session, every: Person, hypotheses: int) -> Floats:
    """Return (F, 1 + hypotheses, 2) mean joint errors [mm] of the chosen pose and each hypothesis: as they are, relative to the pelvis."""
    first = FirstPose(0, {"root_tz": 1.0, "root_rx": np.pi / 2})  # upright: the world's z is up
    run = TrackingRun.open(session, {**SETTINGS, "tracker.hypotheses": hypotheses}, first)
    frame, start = run.initial()
    model = run.model
    true = {result.frame: result.joint_positions for result in every.refined}
    root = model.joint_names.index("pelvis")
    refined = {result.frame: result for result in run.track(range(FRAMES), frame, start)}
    rows = []
    for _, result in sorted(refined.items()):
        shown = [model.transform.solver_params(one.parameters) for one in result.alternatives]
        joints = [model.joint_positions(model.bones(params)) for params in shown[:hypotheses]]
        joints += [result.joint_positions] * (hypotheses - len(joints))
        off = np.array([result.joint_positions, *joints]) - true[result.frame]
        apart = off - off[:, root : root + 1]
        rows.append(
            np.stack([np.linalg.norm(d, axis=2).mean(axis=1) for d in (off, apart)], axis=1)
        )
    return 1e3 * np.array(rows)
