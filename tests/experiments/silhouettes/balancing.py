"""Benchmark: a real person in four cameras, OpenPose joints, fitted by all of them and by one with hypotheses.

Data: pose2sim_body_4cam of the shared test data (HANDTRACK_DATA). There is no measured truth, and the cameras are some 20 to
30 mm off (its README): the fit by all four stands for the truth of the single camera. `handtrack bench balancing`.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from handtrack.arrays import D3, Floats, J
from handtrack.geometry.triangulation import triangulated as lines_meet
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.model_file import load_model, write_scale
from handtrack.observation.observation import ImageKeypoints
from handtrack.session.first_pose.first_pose import FirstPose
from handtrack.session.run import TrackingRun
from handtrack.simulation.retarget import fitted_model
from handtrack.tracking.frame.result import Alternative, FrameResult, Status
from tests.experiments.silhouettes import four_cameras
from tests.experiments.silhouettes.person_session import CAMERAS, write_session

FRAMES, SHOWN, NEAR_MM = 100, 8, 80.0
SETTINGS: dict[str, object] = {"keypoints.sigma_px": 10.0, "prior.motion_sigma_deg": 2.5}
"""the calibration's error, as its README tells it; accelerations as in monocular_dance, for frames half as long"""


def triangulated(seen: Sequence[ImageKeypoints]) -> tuple[tuple[str, ...], Floats[J, D3]]:
    """Return joint names and positions world [m] from all cameras that see each, NaN where fewer than two do."""
    pixels = np.stack([view.pixels for view in seen])
    return seen[0].names, lines_meet([view.camera for view in seen], pixels)


@dataclass(frozen=True, eq=False)
class Balancing:
    """A tracked stretch of the recording."""

    run: TrackingRun
    results: tuple[FrameResult, ...]
    """the best hypothesis of each frame"""
    refined: tuple[FrameResult, ...]
    """all frames together"""


def tracked(
    folder: Path, cameras: Sequence[str], body: Path | None, **settings: object
) -> Balancing:
    """Return the recording tracked by some cameras. body: a saved body, or None to fit it to all cameras' joints."""
    session = write_session(folder, cameras)
    if body is not None:
        (folder / "body.json").write_bytes(body.read_bytes())
    values = {**SETTINGS, **settings}
    first = FirstPose(0, {"root_tz": 1.0, "root_rx": np.pi / 2})  # upright: the world's z is up
    run = TrackingRun.open(session, values, first)
    if body is None:
        model = _fitted(run)
        write_scale(folder / "body.json", model.scale)
        run = run.with_scale(model.scale)
    frame, start = run.initial()
    best: dict[int, FrameResult] = {}
    refined: dict[int, FrameResult] = {}
    for result in run.track(range(FRAMES), frame, start):
        best.setdefault(result.frame, result)
        refined[result.frame] = result
    return Balancing(run, tuple(best.values()), tuple(refined.values()))


def _fitted(run: TrackingRun) -> ArticulatedModel:
    points = [triangulated(run.observation(f).keypoints) for f in range(0, FRAMES, 4)]  # type: ignore[arg-type]
    places = np.stack([p for _, p in points])
    return fitted_model(lambda scale: load_model("body34", scale=scale), points[0][0], places)


def balancing() -> dict[str, Any]:
    """Return single cameras' joint errors [mm] against the fit by all four, whose person, size and offsets, they are given."""
    figures: dict[str, Any] = {
        "truth": "none; single cameras are compared with the fit by all four"
    }
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        (place / "all").mkdir()
        everything = four_cameras.tracked(place / "all")
        body = place / "body.json"
        write_scale(body, everything.model.scale)
        for camera in CAMERAS:
            for label, count in (("hypotheses", SHOWN), ("single", 1)):
                folder = place / f"{camera}_{label}"
                folder.mkdir()
                alone = tracked(folder, [camera], body, **{"tracker.hypotheses": count})
                figures |= _compared(f"{camera}_{label}", alone, everything)
    return figures


def _compared(label: str, alone: Balancing, everything: four_cameras.Person) -> dict[str, float]:
    """Return errors of one camera's poses against the fit by all, live and refined, as they are and relative to the pelvis [mm]; how many
    frames are within the bar; and of the refined ones how many are called tracked, and are beyond twice what is stated.
    """
    model = everything.model
    root = model.joint_names.index("pelvis")
    true = {r.frame: r.joint_positions for r in everything.refined}
    figures: dict[str, float] = {}
    for name, results in (("live", alone.results), ("refined", alone.refined)):
        rows = []
        for result in results:
            shown = [_joints(model, pose) for pose in result.alternatives[:SHOWN]]
            off = np.array([result.joint_positions, *shown]) - true[result.frame]
            apart = off - off[:, root : root + 1]
            far = [1e3 * np.linalg.norm(d, axis=2).mean(axis=1) for d in (off, apart)]
            rows.append([far[0][0], far[0].min(), far[1][0], far[1].min()])
        columns = ("own", "best", "own_root_relative", "best_root_relative")
        for column, errors in zip(columns, np.array(rows).T, strict=True):
            figures[f"{label}_{name}_{column}_mm"] = float(errors.mean())
            figures[f"{label}_{name}_{column}_near"] = float((errors < NEAR_MM).mean())
    beyond = [
        ((r.joint_positions - true[r.frame]) ** 2).sum(axis=1).mean()
        > 4.0 * np.trace(r.joint_covariance, axis1=1, axis2=2).mean()
        for r in alone.refined
    ]
    said = [r.status == Status.TRACKED for r in alone.refined]
    figures[f"{label}_tracked"] = float(np.mean(said))
    figures[f"{label}_beyond_2_sigma"] = float(np.mean(beyond))
    figures[f"{label}_tracked_beyond_2_sigma"] = float(np.mean(np.array(beyond) & np.array(said)))
    return figures


def _joints(model: ArticulatedModel, pose: Alternative) -> Floats:
    """Return (J, 3) the joints of one of a frame's poses, world [m]."""
    return model.joint_positions(model.bones(model.transform.solver_params(pose.parameters)))
