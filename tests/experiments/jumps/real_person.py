"""Benchmark part: a monocular video of a real person, by the 2003 paper's own method.

Data: pose2sim_body_4cam of the shared test data (HANDTRACK_DATA). One camera's video is looked at by edges and intensity; joints, found by
OpenPose, begin in its first frame, where the pose is given, too, as the fit by all four cameras has it. After it no joint is
looked at: those of the video, and that fit, are what poses are compared with. It is a part of `handtrack bench papers`.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from handtrack.arrays import F, Floats
from handtrack.bench.measuring import data_folder
from handtrack.errors import HandtrackError
from handtrack.model.model_file import write_scale
from handtrack.observation.observation import ImageKeypoints
from handtrack.session.first_pose.first_pose import FirstPose
from handtrack.session.run import TrackingRun
from handtrack.tracking.frame.result import FrameResult, Status
from handtrack.tracking.sequence import track_frames
from tests.experiments.silhouettes import balancing
from tests.experiments.silhouettes.person_session import CAMERAS, DATA, write_session

CAMERA = "cam03"
SHOWN: Mapping[str, dict[str, object]] = {"paper2003": {"method": "paper2003"}}
"""ours looks at joints, where there are some: `handtrack bench balancing`"""


@dataclass(frozen=True, eq=False)
class Followed:
    """A person followed in one camera's video."""

    run: TrackingRun
    results: tuple[FrameResult, ...]
    own_mm: Floats[F]
    """mean joint error, relative to the pelvis, against the fit by all four cameras"""
    best_mm: Floats[F]
    """of the best of the hypotheses carried"""
    pixels: Floats[F]
    """median distance of the model's joints from those that OpenPose finds [px]"""


def fitted_by_all(folder: Path) -> balancing.Balancing:
    """Return the recording's fit by all cameras, written to an empty folder. Raises HandtrackError without the data."""
    if not (data_folder() / DATA).is_dir():
        raise HandtrackError(f"no {DATA} in the shared test data {data_folder()}.")
    return balancing.tracked(folder, CAMERAS, None)


def follow(
    folder: Path, known: balancing.Balancing, settings: Mapping[str, object], frames: int
) -> Followed:
    """Return the first frames of the video followed, in an empty folder; known: the fit by all cameras."""
    session = write_session(folder, [CAMERA])
    video = data_folder() / DATA / "videos" / f"{CAMERA}.mp4"
    shutil.copyfile(video, folder / video.name)
    text = (folder / "session.toml").read_text()
    asked = f'name = "{CAMERA}"\n'
    (folder / "session.toml").write_text(text.replace(asked, f'{asked}images = "{video.name}"\n'))
    write_scale(folder / "body.json", known.run.model.scale)
    first = dict(
        zip(known.run.model.parameter_names, known.refined[0].parameters.tolist(), strict=True)
    )
    run = TrackingRun.open(type(session).open(folder), dict(settings), FirstPose(0, first))
    begin, start = run.initial()
    results = tuple(track_frames(run.tracker, run.observation, begin, start, range(frames)))
    model, rows = run.model, []
    for result in results:
        true = known.refined[result.frame].joint_positions
        poses = [p.parameters for p in result.alternatives] or [result.parameters]
        places = [
            model.joint_positions(model.bones(model.transform.solver_params(p))) for p in poses
        ]
        off = np.array([result.joint_positions, *places]) - true
        errors = 1e3 * np.linalg.norm(off - off[:, :1], axis=2).mean(axis=1)
        rows.append((errors[0], errors.min(), _pixels(known, run, result)))
    own, best, pixels = np.array(rows).T
    return Followed(run, results, own, best, pixels)


def _pixels(known: balancing.Balancing, run: TrackingRun, result: FrameResult) -> float:
    off = []
    for seen in known.run.observation(result.frame).keypoints:
        if isinstance(seen, ImageKeypoints) and seen.camera.name == CAMERA:
            index = [run.model.joint_names.index(name) for name in seen.names]
            off.append(seen.camera.project(result.joint_positions[index]) - seen.pixels)
    return float(np.nanmedian(np.linalg.norm(np.concatenate(off), axis=1)))


def figures(folder: Path, frames: int) -> dict[str, float | int | str]:
    """Return errors of each way, of all frames and of the last."""
    (folder / "all").mkdir()
    known = fitted_by_all(folder / "all")
    found: dict[str, float | int | str] = {"frames": frames}
    for way, settings in SHOWN.items():
        (folder / way).mkdir()
        one = follow(folder / way, known, settings, frames)
        found |= {
            f"{way}_own_mm": float(one.own_mm.mean()),
            f"{way}_best_of_8_mm": float(one.best_mm.mean()),
            f"{way}_own_last_mm": float(one.own_mm[-1]),
            f"{way}_pixels": float(one.pixels.mean()),
            f"{way}_pixels_last": float(one.pixels[-1]),
            f"{way}_tracked": sum(r.status == Status.TRACKED for r in one.results),
        }
    return found
