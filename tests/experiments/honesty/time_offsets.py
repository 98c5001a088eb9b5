"""Time offsets of one camera, estimated: python -m tests.experiments.honesty.time_offsets DATA OUT [MOTION:MESH ...]

Recordings as `recordings` makes them, by three cameras of which the second is late, or the last one turned, and their clean twins: which
offset is estimated, why the estimate ended, and the error beside the twin's.
"""

from __future__ import annotations

import sys
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from handtrack import FrameResult, Session, TrackingRun
from handtrack.session.run import Reporting
from handtrack.tracking.frame.control import Control
from handtrack.tracking.whole.refinement import Refinement
from tests.experiments.honesty import motions, recordings
from tests.experiments.honesty.meshes import read_meshes
from tests.experiments.honesty.people import as_person, somebody
from tests.experiments.tracked_frames import mean_mm

FAULTS = (
    ("", 0.0),
    ("late", 0.3),
    ("late", 0.5),
    ("late", 1.0),
    ("late", 1.5),
    ("turned", 0.0),
    ("turned late", 0.5),
)
"""and by how many frames the second camera is late; the first has none"""
CASES = ("curls:webxr", "waves:umetrack", "fist:webxr", "letters:umetrack")
CAMERAS = 3


def write(data: Path, out: Path, case: str) -> Iterator[Path]:
    """Yield the recording of each fault, written unless it is there; all are the same but for it."""
    motion, mesh = case.split(":")
    for faults, offset in FAULTS:
        folder = out / "_".join([motion, mesh, *faults.split(), f"{offset:g}"])
        if not folder.exists():
            rng = np.random.default_rng(zlib.crc32(case.encode()))
            who = somebody(rng)
            angles = motions.moving(motion, recordings.FRAMES + recordings.BEFORE, rng)
            person = as_person(read_meshes(data)[mesh], who)
            moving = recordings.moved(person, angles, motion, rng, who.left)
            rig = recordings.rig_of(CAMERAS, rng)
            recordings.LATE_FRAMES = offset
            recordings.write(folder, moving, rig, rng, frozenset(faults.split()))
        yield folder


def tracked(folder: Path) -> tuple[TrackingRun, list[FrameResult]]:
    """Return a recording's live pass."""
    run = TrackingRun.open(Session.open(folder))
    start, params = run.initial()
    live = run.track(run.session.frame_range, start, params, Control(refines=False))
    return run, sorted(live, key=lambda result: result.frame)


def mean_error_mm(folder: Path, frames: list[FrameResult]) -> float:
    """Return the mean distance of the 21 points from the truth [mm]."""
    truth = np.load(folder / "truth.npz")["keypoints21"]
    return mean_mm(np.array([r.keypoints21 for r in frames]), truth[[r.frame for r in frames]])


def main() -> None:
    """Print a row for each recording."""
    data, out = map(Path, sys.argv[1:3])
    for case in sys.argv[3:] or CASES:
        clean = np.nan
        for folder in write(data, out, case):
            run, live = tracked(folder)
            told = Reporting()
            found = run.refined(live, Control(observer=told))
            shared, error = Refinement.read(told.refinement), mean_error_mm(folder, found)
            clean = error if np.isnan(clean) else clean
            late = " ".join(f"{one.late_frames:+.2f}" for one in shared.cameras)
            print(
                f"{folder.name:28} late {late}  {shared.why} {shared.sweeps}  {error:5.2f} mm, {error / clean:4.2f} of clean, "
                f"live {mean_error_mm(folder, live):5.2f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
