"""Benchmark: a hand of unknown shape scanned for five seconds, then a fist of the same hand with that shape held."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from handtrack import ArticulatedModel, HandScale, Session, TrackingRun, load_model
from handtrack.arrays import F, Floats, S
from handtrack.model.pose_library import named_pose
from handtrack.model.size import SizeParameters
from handtrack.session.track_session import Refining
from handtrack.simulation.simulate import Simulation, simulate
from handtrack.tracking.frame.control import Control
from handtrack.tracking.whole.refinement import Refinement
from tests.experiments.tracked_frames import mean_mm

FPS, SCAN_S, FIST_S = 10.0, 5.0, 3.0
_SCAN = ("open", "curl", "open", "pinch", "fist", "open")
_FIST = ("open", "fist", "fist", "open")
_TURN_RAD = np.deg2rad(60.0)  # either way, about the forearm
_SEEDS = (0, 1)
_SIZE = (320, 240)


def person_scan() -> dict[str, Any]:
    """Return mean joint errors [mm] of fists of hands drawn from adults', with the true shape, that of their scan, and the mean's."""
    figures: dict[str, Any] = {}
    for seed in _SEEDS:
        truth = drawn(np.random.default_rng(seed))
        with tempfile.TemporaryDirectory() as name:
            scan, fist = (
                recorded(Path(name) / what, truth, what, seed) for what in ("scan", "fist")
            )
            shapes = {"true": truth.scale, "scanned": scanned(scan), "mean": HandScale()}
            for shape, scale in shapes.items():
                figures[f"hand{seed}_{shape}_mm"] = _error_mm(fist.with_scale(scale))
    return figures | {"reference": "bar: scanned at most 0.5 mm above true"}


def _error_mm(run: TrackingRun) -> float:
    """Return the mean distance of the 21 keypoints to the truth."""
    track, truth = run.result(run.track(run.session.frame_range, *run.initial())), run.session.truth
    assert track.keypoints21 is not None and truth is not None and truth.keypoints21 is not None
    return mean_mm(track.keypoints21, truth.keypoints21)


def drawn(rng: np.random.Generator) -> ArticulatedModel:
    """Return an adult's hand, drawn from what is known of people."""
    size = SizeParameters(load_model())
    values = np.clip(rng.normal(size=len(size.names)), -2.0, 2.0)
    values *= ["forearm" not in name for name in size.names]
    return load_model(scale=size.scale(values))


def recorded(folder: Path, truth: ArticulatedModel, what: str, seed: int) -> TrackingRun:
    """Return the run of a simulated recording of a hand, for which the mean adult's is taken: three cameras' masks."""
    seconds, poses = (SCAN_S, _SCAN) if what == "scan" else (FIST_S, _FIST)
    joint = moved(truth, poses, round(FPS * seconds), _TURN_RAD if what == "scan" else 0.3)
    made = Simulation(size=_SIZE, fps=FPS, images=False, init_noise_m=0.003, seed=seed)
    session = Session.open(simulate(folder, made, known=(truth, joint, 0.5)))
    hand = replace(session.file.hand, scale=1.0)
    session.file = replace(session.file, hand=hand)
    return TrackingRun.open(session, {"model.fit_size": False, "model.forearm": "false"})


def scanned(run: TrackingRun) -> HandScale:
    """Return the person of a recording as tracking with scale = "fit" finds them, from the mean adult on."""
    hand = replace(run.session.file.hand, scale="fit")
    run.session.file = replace(run.session.file, hand=hand)
    run, told = run.with_values({"model.fit_size": "true"}).fit_size(), Refining()
    for _ in run.track(run.session.frame_range, *run.initial(), Control(observer=told)):
        pass
    return Refinement.read(told.refinement).scale or run.scale


def moved(
    model: ArticulatedModel, poses: tuple[str, ...], frames: int, turn: float
) -> Floats[F, S]:
    """Return joint parameters of poses joined smoothly while the hand turns about the forearm, to and fro."""
    from scipy.interpolate import PchipInterpolator

    time = np.linspace(0.0, 1.0, frames)
    keys = np.stack([named_pose(model, pose) for pose in poses])
    joint = PchipInterpolator(np.linspace(0.0, 1.0, len(keys)), keys, axis=0)(time)
    joint[:, 4] = turn * np.sin(2.0 * np.pi * time)
    joint[:, 1] -= 0.09  # the palm's middle, not the wrist, at the origin
    return np.asarray(joint)
