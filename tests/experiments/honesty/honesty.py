"""Benchmark: recordings of other people's hands: do stated regions hold, is what is wrong called doubtful?

HANDTRACK_HONESTY names a folder of sessions with truth, as `python -m tests.experiments.honesty.recordings` writes them from
others' meshes; without it a few are simulated with handtrack's own hand in other proportions.
"""

from __future__ import annotations

import os
import tempfile
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from handtrack.arrays import D3, D21, Array, F, Floats, J
from handtrack.diagnostics.constant_offsets import WRONG_M, without_offsets
from handtrack.errors import HandtrackError
from handtrack.model.articulated import keypoint_names
from handtrack.session.layout import SESSION_FILE, TRUTH_FILE
from handtrack.session.run import TrackingRun
from handtrack.session.session import Session
from handtrack.simulation.simulate import Simulation, simulate
from handtrack.tracking.frame.result import Status, TrackResult

_CHI2_90 = 6.251388631170325  # 90 % of a 3D normal distribution lies within this squared distance
_EDGES = np.array([0.0, 0.1, 0.2, 0.4, 0.6, 0.8, 1.0])


@dataclass(frozen=True, eq=False)
class Compared:
    """What a track says of itself, beside what is true of it."""

    off_mm: Floats[F, J]
    """of the 21 keypoints beside their constant offsets (`without_offsets`)"""
    inside: Array[F, J]
    """whether each so lies in its stated 90 % ellipsoid"""
    fist: Array[F]
    """the fingers are closed"""
    said: Array[F]
    """doubtful or lost"""
    probability: Floats[F]
    """stated, that the frame is wrong; 1 of a lost frame"""

    @property
    def bad(self) -> Array[F]:
        """Whether the frame is wrong, as `constant_offsets` defines it."""
        return self.off_mm.max(axis=1) > 1e3 * WRONG_M


def compared(track: TrackResult, truth: Floats[F, D21, D3]) -> Compared:
    """Return a hand's track beside the true keypoints of its frames [m]."""
    assert track.keypoints21 is not None
    free = without_offsets(track.keypoints21, truth)
    rows = [track.joint_names.index(name) for name in keypoint_names()]
    stated = np.linalg.solve(track.joint_covariance[:, rows], free[..., None])[..., 0]
    bends = [n.endswith("_flex") and not n.startswith("thumb") for n in track.parameter_names]
    lost = track.status == Status.LOST
    said = lost | (track.status == Status.DOUBTFUL)
    known = track.p_off_25mm if track.p_off_25mm is not None else np.full(len(track), np.nan)
    return Compared(
        1e3 * np.linalg.norm(free, axis=2), (free * stated).sum(axis=2) < _CHI2_90,
        track.parameters[:, bends].sum(axis=1) / 16.0 > 0.6, said, np.where(lost, 1.0, known),
    )  # fmt: skip


def figures_of(recordings: dict[str, Compared]) -> dict[str, float]:
    """Return coverage, recall and precision of recordings together, and how often what is stated comes true."""
    every = list(recordings.values())
    bad, said = (np.concatenate([getattr(t, n) for t in every]) for n in ("bad", "said"))
    inside = np.concatenate([t.inside for t in every])
    fist = np.concatenate([t.fist for t in every])
    probability = np.concatenate([t.probability for t in every])
    found = {
        "recordings": float(len(every)),
        "frames": float(len(bad)),
        "mean_mm": float(np.mean([t.off_mm.mean() for t in every])),
        "bad_share": float(bad.mean()),
        # NaN where nothing is bad, or said
        "recall": float((bad & said).sum() / bad.sum()) if bad.any() else np.nan,
        "precision": float((bad & said).sum() / said.sum()) if said.any() else np.nan,
        "said": float(said.sum()),
        "coverage90_tracked": float(inside[~said].mean()),
        "coverage90_fists": float(inside[fist & ~said].mean()) if (fist & ~said).any() else np.nan,
    }
    for low, high in pairwise(_EDGES):
        own = (probability >= low) & (probability <= high if high == 1 else probability < high)
        if own.any():
            found[f"P {low:.1f}-{high:.1f}: frames"] = float(own.sum())
            found[f"P {low:.1f}-{high:.1f}: bad"] = float(bad[own].mean())
    return found


def honesty() -> dict[str, float]:
    """Return the figures of a folder's recordings, or of simulated ones."""
    given = os.environ.get("HANDTRACK_HONESTY")
    if given is not None:
        return figures_of(_of_folder(Path(given)))
    with tempfile.TemporaryDirectory() as folder:
        for seed, (cameras, scale) in enumerate(((2, 0.9), (3, 1.1))):
            what = Simulation(
                cameras, 24, motion="open_fist_open", scale=scale, images=False, seed=seed
            )
            simulate(Path(folder) / f"{cameras}cam", what)
        return figures_of(_of_folder(Path(folder)))


def _of_folder(folder: Path) -> dict[str, Compared]:
    sessions = sorted(p.parent for p in folder.glob(f"*/{SESSION_FILE}") if (p.parent / TRUTH_FILE).is_file())  # fmt: skip
    if not sessions:
        raise HandtrackError(
            f"{folder}: no session with {TRUTH_FILE} in it; expected folders of sessions, as "
            "`python -m tests.experiments.honesty.recordings` writes them."
        )
    found = {}
    for path in sessions:
        session = Session.open(path)
        run = TrackingRun.open(session)
        start, pose = run.initial()
        track = run.result(run.track(session.frame_range, start, pose))
        truth = np.load(path / TRUTH_FILE)["keypoints21"]
        found[path.name] = compared(track, truth[track.frame])
    return found
