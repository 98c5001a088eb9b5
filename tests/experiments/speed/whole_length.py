"""Benchmark: refining a recording as a whole, by its length: processor seconds a frame, and memory."""

from __future__ import annotations

import resource
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from handtrack import Observation, Session, TrackingRun
from handtrack.bench.measuring import alone
from handtrack.model.kinematics import BonePoses
from handtrack.simulation.simulate import Simulation, simulate
from handtrack.tracking.sequence import refine_recording
from handtrack.tracking.size.person import Subject

_LENGTHS = (250, 500, 1000)
"""frames; 10,000 take most of an hour"""
_MADE = 50
"""frames that are made; they come again, to and fro, each with masks of its own"""
_MB = 1024.0


def whole_length() -> dict[str, Any]:
    """Return seconds of the processor a frame and the memory's peak [MB] of each length, masks of three cameras.

    The ratio is of seconds a frame, the longest beside the shortest.
    """
    figures: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder:
        simulate(Path(folder), Simulation(frames=_MADE, images=False))
        for length in _LENGTHS:
            figures |= _measure(folder, length)
    first, last = (figures[f"frames_{n}_ms_a_frame"] for n in (_LENGTHS[0], _LENGTHS[-1]))
    more = figures[f"frames_{_LENGTHS[-1]}_mb"] - figures[f"frames_{_LENGTHS[0]}_mb"]
    return {
        "ratio": last / first,
        "reference": f"the same of {_LENGTHS[0]} frames",
        "kb_a_frame": 1e3 * more / max(_LENGTHS[-1] - _LENGTHS[0], 1),
    } | figures


@alone
def _measure(folder: str, length: int) -> dict[str, Any]:
    run = TrackingRun.open(Session.open(Path(folder)), {"tracker.estimate": "forward"})
    live = {result.frame: result for result in run.track(range(_MADE), *run.initial())}
    way = np.concatenate([np.arange(_MADE), np.arange(_MADE)[::-1]])

    def observe(frame: int, bones: BonePoses | None) -> Observation:
        seen = run.observation(int(way[frame % len(way)]), bones)
        own = tuple(replace(one, mask=one.mask.copy()) for one in seen.silhouettes)
        return replace(seen, frame=frame, time_s=frame / run.session.fps, silhouettes=own)

    tracked = [
        replace(live[int(way[n % len(way)])], frame=n, time_s=n / run.session.fps)
        for n in range(length)
    ]
    subject = Subject(lambda scale: run.with_scale(scale).model)
    began = time.process_time()
    refine_recording(replace(run.tracker, subject=subject), observe, tracked)
    seconds = time.process_time() - began
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / _MB
    return {f"frames_{length}_ms_a_frame": 1e3 * seconds / length, f"frames_{length}_mb": peak}
