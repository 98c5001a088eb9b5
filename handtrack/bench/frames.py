"""Benchmarks: whole frames as the tracker solves them, after decoding, what a second core brings, and the first frame of a program."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from handtrack.bench.measuring import (
    alone,
    alternating_timings,
    normal_equations,
    ratio_figures,
    recording,
)
from handtrack.errors import HandtrackError
from handtrack.model.model_file import load_model
from handtrack.session.bundled import bundled_session
from handtrack.session.run import TrackingRun
from handtrack.session.session import Session
from handtrack.terms.silhouettes import outline_overlap
from handtrack.tracking.frame.control import Control, Observer
from handtrack.tracking.frame.frame_task import TrackerState

FRAMES = 60
"""of the bundled recording; `webxr_depth_640` has fewer"""
_AFTER = 3
"""the first frames are left out: nothing vouches for them yet, and kernels are loaded"""


def frame_vs_blas() -> dict[str, Any]:
    """Return the median time of a frame of the bundled recording, after decoding."""
    return _frame(False)


def frame_p99_vs_median() -> dict[str, Any]:
    """Return how much longer the slowest frames take than the usual one, by the clock, on all cores, as a user meets
    them: from one solved frame to the next, reading and searches beside, those that a search has solved anew among them.
    """
    return _slowest(threads="")


def cloud_frame_vs_blas() -> dict[str, Any]:
    """Return the median time of a frame of `webxr_depth_640`, after its cloud was measured."""
    return _frame(True)


def two_cores() -> dict[str, Any]:
    """Return the time of one recording on two cores, by the clock, the reference being one core."""
    times: dict[str, list[float]] = {"1": [], "2": []}
    for _ in range(3):
        for threads, kept in times.items():
            kept.append(_whole(threads=threads)["ms"])
    return ratio_figures(
        times["2"],
        [times["1"]],
        f"{FRAMES} frames of the bundled recording with HANDTRACK_THREADS=1",
    )


def frame_times(session: Session, values: dict[str, object], count: int) -> tuple[list[float], int]:
    """Return each frame's time [ms] of the calling thread, searches included, what is seen being decoded before; and the
    pixels, or points, that the model is compared with in the middle frame.
    """
    run = TrackingRun.open(session, {"model.fit_size": False} | values)
    start, params = run.initial()
    tracker, state = run.tracker, TrackerState.beginning_at(params)
    own, rows = [], 0
    for frame in range(start, min(start + count, session.frame_count)):
        seen = run.observation(frame, tracker.expected_bones(state, frame))
        begun = time.thread_time()
        state, result = tracker.step(state, seen)
        own.append(1e3 * (time.thread_time() - begun))
        if frame == start + count // 2:
            bones = run.model.bones(run.model.transform.solver_params(result.parameters))
            overlap = outline_overlap(seen.silhouettes, run.model.ellipsoids["fine"], bones)
            rows = len(seen.cloud) if seen.cloud is not None else int(overlap.model.sum())
    return own[_AFTER:], rows


def times_between_frames(session: Session, values: dict[str, object], count: int) -> list[float]:
    """Return the time [ms] by the clock from each solved frame to the next one."""
    run = TrackingRun.open(session, {"model.fit_size": False} | values)
    start, params = run.initial()
    frames = range(start, min(start + count, session.frame_count))
    at: list[float] = []
    clock = Observer()
    clock.provisional = lambda result: at.append(time.perf_counter())
    for _ in run.track(frames, start, params, Control(observer=clock, refines=False)):
        pass
    return [1e3 * float(t) for t in np.diff(at)[_AFTER:]]


@alone
def _whole() -> dict[str, Any]:
    """Return how long some frames of the bundled recording take."""
    run = TrackingRun.open(
        Session.open(bundled_session("open_fist_open")), {"model.fit_size": False}
    )
    start, params = run.initial()
    begun = time.perf_counter()
    for _ in run.track(range(start, start + FRAMES), start, params):
        pass
    return {"ms": 1e3 * (time.perf_counter() - begun)}


@alone
def _frame(is_cloud: bool) -> dict[str, Any]:
    session = (
        recording("webxr_depth_640")
        if is_cloud
        else Session.open(bundled_session("open_fist_open"))
    )
    values: dict[str, object] = {"silhouettes.weight": 0.0} if is_cloud else {}
    own, rows = frame_times(session, values, FRAMES)
    width = len(load_model().transform.names)
    blas = alternating_timings(normal_equations(rows, width), 30)
    what_rows = (
        "the cloud's points" if is_cloud else "the pixels that the model covers in a middle frame"
    )
    words = f"BLAS float64 JᵀJ and Jᵀr of a formed {rows} × {width} Jacobian ({what_rows}), the quicker of two layouts"
    median, reference = float(np.median(own)), float(np.median(min(blas, key=min)))
    return {
        "ratio": median / reference,
        "ours_ms": median,
        "reference_ms": reference,
        "reference": words + "; one thread works, searches included",
    }


@alone
def _slowest() -> dict[str, Any]:
    bundled = Session.open(bundled_session("open_fist_open"))
    clocks = [times_between_frames(bundled, {}, FRAMES)]
    reference = "the median frame; the larger of both recordings"
    try:
        depth = recording("webxr_depth_640")
        clocks.append(times_between_frames(depth, {"silhouettes.weight": 0.0}, FRAMES))
    except HandtrackError:
        reference = "the median frame, without webxr_depth_640: the shared test data is not here"
    ratios = [float(np.percentile(clock, 99) / np.median(clock)) for clock in clocks]
    return {"ratio": max(ratios), "reference": reference}


# ---- the first frame of `handtrack track`, with compiled kernels at hand and without


_ROUNDS_WARM = 3
_TRACK = "import sys; from handtrack_app.cli import main; sys.exit(main(sys.argv[1:]))"
_IMPORTS = "import cv2, numba, numpy, scipy.optimize, scipy.spatial"


def first_pose_warm() -> dict[str, Any]:
    """Return the processor seconds of the first frame, all kernels compiled by an earlier run; the least of three."""
    with tempfile.TemporaryDirectory() as cache:
        _first_frame(cache)
        return _first_figures(min(_first_frame(cache) for _ in range(_ROUNDS_WARM)), cache)


def first_pose_cold() -> dict[str, Any]:
    """Return the processor seconds of the first frame on a machine where nothing was compiled before."""
    with tempfile.TemporaryDirectory() as cache:
        _seconds([sys.executable, "-c", f"{_IMPORTS}, handtrack_app.commands.track"], cache)
        return _first_figures(_first_frame(cache), cache)


def _first_figures(seconds: float, cache: str) -> dict[str, Any]:
    imports = min(_seconds([sys.executable, "-c", _IMPORTS], cache) for _ in range(_ROUNDS_WARM))
    return {
        "ratio": seconds / imports,
        "ours_s": seconds,
        "reference_s": imports,
        "reference": f"`{_IMPORTS}` in a process of its own; processor seconds of all threads",
    }


def _first_frame(cache: str) -> float:
    with tempfile.TemporaryDirectory() as folder:
        words = [
            "track",
            str(bundled_session("open_fist_open")),
            "--frames",
            "0:1",
            "--out",
            str(Path(folder) / "poses.npz"),
        ]
        return _seconds([sys.executable, "-c", _TRACK, *words], cache)


def _seconds(command: list[str], cache: str) -> float:
    """Return the processor seconds of a process. The folder `cache` keeps kernels, and Python's bytecode as an installer
    would have written it, whatever the environment says of that.
    """
    own = {"NUMBA_CACHE_DIR": cache, "PYTHONPYCACHEPREFIX": str(Path(cache) / "bytecode")}
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"} | own
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, env=environment, capture_output=True, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
