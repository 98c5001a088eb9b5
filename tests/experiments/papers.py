"""Benchmark: the three papers' experiments, each by its own method (`--set method=…`) and by ours.

Small sizes that end in minutes; each experiment has a benchmark of its own with more of it. Parts that need the shared test
data (HANDTRACK_DATA) are left out where that is absent. Run: handtrack bench papers.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from handtrack.arrays import Floats, N
from handtrack.bench.measuring import data_folder, recording
from handtrack.diagnostics.metrics import evaluate
from handtrack.errors import HandtrackError
from handtrack.model.model_file import load_model
from handtrack.session.run import TrackingRun
from handtrack.simulation.simulate import simulated_rig
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.sequence import track_frames
from tests.experiments.clouds import poor_clouds
from tests.experiments.jumps import dance_appearance, minima, real_person
from tests.experiments.silhouettes import binary_fist, field_recovery
from tests.experiments.tracked_frames import mean_mm

Figures = dict[str, float | int | str]
OURS: dict[str, object] = {"tracker.estimate": "forward"}
"""the live pass: a paper's method knows no frame after"""
POOR: poor_clouds.ModeSearch = {
    "hand26_paper2004": ("hand26", {"method": "paper2004"}),
    "glove9_paper2004": ("glove9", {"method": "paper2004"}),
    "hand26_ours": ("hand26", {}),
}
"""the whole hand, and the simple model that the paper falls back on"""
STEREO: Mapping[str, dict[str, object]] = {
    "paper2004": {"method": "paper2004"},
    "paper2004_crop_40mm": {"method": "paper2004", "cloud.crop_mm": 40.0},
    "ours_cloud_alone": {**OURS, "silhouettes.weight": 0.0, "keypoints.weight": 0.0},
    "ours": OURS,
}

INSIDE = (-1.0, -0.6, -0.5)
"""other values of a mask's inside, which the 2007 paper does not say"""
WHY: Mapping[str, dict[str, bool]] = {
    "as_the_paper": {},
    "robust_likelihood": {"plain_sums": False},
    "surface_in_view": {"whole_surface": False},
    "both": {"plain_sums": False, "whole_surface": False},
}
"""what of the 2004 method is taken away, to see what it costs"""


def papers(frames: int = 25, poses: int = 40) -> Figures:
    """Return the figures of all experiments, and how long each took; frames: of each stereo recording and the dance."""
    parts: dict[str, Callable[[], Figures]] = {
        "paper2007_fields": lambda: fields(poses),
        "paper2007_fist": fist,
        "paper2004_poor_clouds": poor,
        "paper2004_synthetic_stereo": lambda: stereo("webxr_stereo_768", frames),
        "paper2004_why": lambda: why("webxr_stereo_768"),
        "paper2004_real_stereo": lambda: stereo("d405_real_stereo", frames),
        "paper2003_table1": table1,
        "paper2003_dance": lambda: dance(frames),
        "paper2003_person": lambda: person(frames),
    }
    figures: Figures = {}
    for name, part in parts.items():
        began = time.process_time()
        try:
            found = part()
        except HandtrackError as error:
            found = {"left_out": str(error)}
        figures |= {f"{name}_{key}": value for key, value in found.items()}
        figures[f"{name}_cpu_s"] = time.process_time() - began
    return figures


def fields(poses: int) -> Figures:
    """Return how many poses are found again in field images of two cameras, in either scale of the field."""
    model, cameras = load_model(), simulated_rig(2).cameras
    rows = {
        scale: [
            field_recovery.recover(model, cameras, seed, scale == "paper") for seed in range(poses)
        ]
        for scale in ("paper", "normalised")
    }
    found = {scale: np.array([row.error_mm for row in rows[scale]]) for scale in rows}
    near = {
        scale: float((error < field_recovery.CONVERGED_MM).mean()) for scale, error in found.items()
    }
    return {f"{scale}_scale_found": share for scale, share in near.items()}


def fist_errors(cameras: int, settings: Mapping[str, object] | TrackerSettings) -> Floats[N]:
    """Return the mean joint error [mm] of each frame of the fist, masks of so many cameras."""
    return binary_fist.track(binary_fist.scene(cameras), settings).error_mm


def fist() -> Figures:
    """Return errors of a hand that closes and opens, seen as masks by two and by six cameras."""
    figures: Figures = {}
    closed = slice(binary_fist.FIST.start, binary_fist.FIST.stop)
    faithful = TrackerSettings().with_values({"method": "paper2007"})
    ways: dict[str, Mapping[str, object] | TrackerSettings] = {
        "paper2007": faithful,
        "paper2007_limits": faithful.with_values({"solver.limits": "bounds"}),
        **{
            f"paper2007_inside_{inside}": replace(
                faithful, traits=replace(faithful.traits, inside=inside)
            )
            for inside in INSIDE
        },
        "ours": OURS,
    }
    for cameras in (2, 6):
        for way, settings in ways.items():
            error = fist_errors(cameras, settings)
            figures |= {
                f"{way}_{cameras}cam_mean_mm": float(error.mean()),
                f"{way}_{cameras}cam_fist_mm": float(error[closed].mean()),
                f"{way}_{cameras}cam_last_mm": float(error[-1]),
            }
    return figures


def poor() -> Figures:
    """Return the palm's error in poor clouds of 320 × 240."""
    truth, seen = poor_clouds.scene(0)
    figures: Figures = {}
    for way in POOR:
        error = poor_clouds.palm_mm(way, poor_clouds.track(way, truth, seen, POOR), truth, POOR)
        figures |= {
            f"{way}_median_mm": float(np.median(error)),
            f"{way}_within_15mm": float((error <= poor_clouds.BAR_MM).mean()),
        }
    return figures


def stereo(name: str, frames: int) -> Figures:
    """Return errors of the 21 joints on a recording of one or more stereo pairs; of a real hand against its reference."""
    session = recording(name)
    reference = data_folder() / "sessions" / name / "reference_dlt.npz"
    figures: Figures = {"frames": frames}
    for way, values in STEREO.items():
        run = TrackingRun.open(session, {"model.fit_size": False, **values})
        first, start = run.initial()
        wanted = range(first, first + frames)
        found = list(track_frames(run.tracker, run.observation, first, start, wanted))
        if session.truth is not None:
            truth = session.truth
            rows = np.isin(truth.frame, wanted)
            assert truth.keypoints21 is not None
            part = replace(
                truth,
                frame=truth.frame[rows],
                keypoints21=truth.keypoints21[rows],
                joint_positions=None,
            )
            measures = evaluate(run.result(found), part)
            figures[f"{way}_mean_mm"] = float(measures["mpjpe_mm"] or np.nan)
            figures[f"{way}_p95_mm"] = float(measures["p95_mm"] or np.nan)
        else:
            with np.load(reference) as file:
                known = dict(zip(file["frame"].tolist(), file["keypoints21"], strict=True))
            off = [
                np.linalg.norm(r.keypoints21 - known[r.frame], axis=1)
                for r in found
                if r.keypoints21 is not None and r.frame in known
            ]
            each = 1e3 * np.nanmedian(np.array(off), axis=1)
            figures[f"{way}_median_mm"] = float(np.median(each))
            figures[f"{way}_p90_mm"] = float(np.quantile(each, 0.9))
        figures[f"{way}_tracked"] = sum(r.status == 0 for r in found)
    return figures


def why(name: str, frames: int = 8) -> Figures:
    """Return the mean error of all joints on a stereo recording with parts of the 2004 method taken away."""
    session = recording(name)
    figures: Figures = {}
    truth = session.truth
    assert truth is not None
    assert truth.keypoints21 is not None
    run = TrackingRun.open(session, {"model.fit_size": False, "method": "paper2004"})
    first, start = run.initial()
    wanted = range(first, first + frames)
    for way, traits in WHY.items():
        settings = replace(run.settings, traits=replace(run.settings.traits, **traits))
        tracker = replace(run.tracker, settings=settings)
        found = track_frames(tracker, run.observation, first, start, wanted)
        joints = np.stack([r.keypoints21 for r in found if r.keypoints21 is not None])
        figures[f"{way}_mm"] = mean_mm(joints, truth.keypoints21[np.isin(truth.frame, wanted)])
    return figures


def table1(samples: int = 500, poses: int = 10) -> Figures:
    """Return the heads of Table 1: minima by jumps and by random samples, at equal samples and in all."""
    found = minima.measure(samples, poses)
    figures: Figures = {
        key: found[key]
        for key in (
            "kjs1_leaves", "kjs1_distinct_share", "kjs2_distinct_share", "minima_kjs1_at_equal_samples",
            "most_minima_css_at_equal_samples", "most_minima_ss_at_equal_samples",
        )
    }  # fmt: skip
    most = {
        name: max(row["minima"] for row in found["rows"] if row["name"] == name)
        for name in ("KJS1", "CSS", "SS")
    }
    return figures | {f"most_minima_{name.lower()}": count for name, count in most.items()}


def dance(frames: int) -> Figures:
    """Return overlap and error of a dance before one camera, by edges and intensity."""
    what = dance_appearance.dance(frames)
    figures: Figures = {"frames": frames}
    ways = {"paper2003": {"method": "paper2003"}, "ours": dance_appearance.WAYS["memory_8"]}
    for way, settings in ways.items():
        found = dance_appearance.track(what, settings)
        figures |= {
            f"{way}_overlap_mean": float(found.overlap.mean()),
            f"{way}_overlap_last": float(found.overlap[-1]),
            f"{way}_error_mm": float(found.error_mm.mean()),
        }
    return figures


def person(frames: int) -> Figures:
    """Return errors of a real person in one camera's video, by edges and intensity."""
    with tempfile.TemporaryDirectory() as folder:
        return real_person.figures(Path(folder), frames)
