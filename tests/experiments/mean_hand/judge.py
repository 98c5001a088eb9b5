"""How a definition tracks hands that are not in it: python -m tests.experiments.mean_hand.judge OUT DEFINITION… [-- RECORDING…]

OUT: a folder of sessions that `python -m tests.experiments.mean_hand.recordings OUT` wrote. DEFINITION: `hand26`, or a file.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from handtrack import Session, TrackingRun
from handtrack.arrays import D3, D21, F, Floats
from handtrack.diagnostics.constant_offsets import bone_frames, offset_free_errors, wrong_frames
from handtrack.diagnostics.flexion import BENT_JOINTS, flexion_deg
from handtrack.session.layout import SESSION_FILE, TRUTH_FILE
from handtrack.tracking.frame.result import Status

COLUMNS = ("mean", "free", "bad", "flex", "thumb", "low", "s")
"""mean joint error [mm]; the same beside a constant of each joint in its bone's frame, of the other half of the frames [mm]; share of
wrong frames; error of the fingers' and of the thumb's flexion [°]; share of frames of low confidence; CPU"""


def figures(session: Path, definition: str) -> tuple[float, ...]:
    """Return `COLUMNS` of one recording."""
    began = time.process_time()
    run = TrackingRun.open(
        Session.open(session), {"model.name": definition, "model.forearm": "false"}
    )
    start, pose = run.initial()
    track = run.result(run.track(run.session.frame_range, start, pose))
    truth = np.load(session / TRUTH_FILE)["keypoints21"][track.frame]
    assert track.keypoints21 is not None
    low = (track.status == Status.LOST) | (track.status == Status.DOUBTFUL)
    mean, free, flex, thumb = errors(track.keypoints21, truth)
    bad = float(wrong_frames(track.keypoints21, truth).mean())
    return mean, free, bad, flex, thumb, float(low.mean()), time.process_time() - began


def errors(found: Floats[F, D21, D3], truth: Floats[F, D21, D3]) -> tuple[float, ...]:
    """Return the mean joint error [mm], the same offset-free [mm], and the error of the fingers' and of the thumb's flexion [°]."""
    free = 1e3 * offset_free_errors(found, truth, bone_frames(truth))
    bend = np.abs(flexion_deg(found) - flexion_deg(truth)).mean(axis=0)
    is_thumb = np.array([n.startswith("thumb") for n in BENT_JOINTS])
    mean = 1e3 * float(np.linalg.norm(found - truth, axis=2).mean())
    return mean, float(free.mean()), float(bend[~is_thumb].mean()), float(bend[is_thumb].mean())


def print_table(columns: Sequence[str], figures: Callable[[Path, str], tuple[float, ...]]) -> None:
    """Print the figures of each recording and definition that the command line names, and their means."""
    names = sys.argv[2:]
    only = names[names.index("--") + 1 :] if "--" in names else []
    names = names[: names.index("--")] if "--" in names else names
    sessions = sorted(p.parent for p in Path(sys.argv[1]).glob(f"*/{SESSION_FILE}"))
    for definition in names:
        print(f"{Path(definition).stem:34}", *(f"{c:>7}" for c in columns))
        every = []
        for session in sessions:
            if only and session.name not in only:
                continue
            every.append(figures(session, definition))
            print(f"  {session.name:32}", *(f"{x:7.2f}" for x in every[-1]), flush=True)
        if every:
            print(f"  {'mean':32}", *(f"{x:7.2f}" for x in np.mean(every, axis=0)), flush=True)


if __name__ == "__main__":
    print_table(COLUMNS, figures)
