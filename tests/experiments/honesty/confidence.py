"""Refit what frames say of themselves: python -m tests.experiments.honesty.confidence RECORDINGS TRACKS HALF…

RECORDINGS: what `python -m tests.experiments.honesty.recordings` wrote. TRACKS: gets what was tracked of each, with all that a judgement
goes by; what is there already is not tracked again, though its paths were weighed by the ELSEWHERE of then. HALF: of which. Prints the
numbers for `handtrack/tracking/frame/confidence.py`, fitted to these halves (`tune` and `seen`), and what such say of recordings they were
not fitted to; with --json what those that are there now say of each half. `tune/two_videos`, README's session with the sample's truth beside it,
has a real detector's joints; it counts as much as all made ones where regions are fitted, and for nothing else.
"""

from __future__ import annotations

import json
import pickle
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit, logit

from handtrack import Session, Status, TrackingRun
from handtrack.arrays import Array, F, Floats, K, N
from handtrack.diagnostics.metrics import WRONG_M, without_offsets
from handtrack.model.articulated import keypoint_names
from handtrack.session.layout import SESSION_FILE, TRUTH_FILE
from handtrack.tracking.frame import confidence
from handtrack.tracking.frame.confidence import (
    Calibration,
    calibrated_covariance,
    failure_probabilities,
    open_sign,
    part_of,
)
from handtrack.tracking.frame.result import PARTS, FrameResult
from handtrack.tracking.whole import recording_estimate

_CHI2_90 = 6.251388631170325
_PART_MM, _FIST = 10.0, 0.5
_ALIKE = 4.0
"""frames that tell as much as one: each is one 25th of a second after another"""
_WIDE = 1.5
"""standard deviation of a sign's weight, before anything is seen"""
_FAR = 25.0
"""squared distance above which a joint is not off by noise"""
_VIDEOS, _FOLDS = "two_videos", 6
_OPTIONS = {"maxfev": 150, "xatol": 0.02, "fatol": 1e-3}


@dataclass(frozen=True, eq=False)
class Model:
    """What a judgement asks of a model."""

    overall: float
    joint_names: tuple[str, ...] = keypoint_names()

    @property
    def scale(self) -> Model:
        return self


@dataclass(frozen=True, eq=False)
class Judged:
    """What the judgement of a refined frame went by, and what it was."""

    model: Model
    curled: Floats
    """`curls`, less what two cameras' joints confirm"""
    covariance: Floats
    """(21, 3, 3) if the model were the hand [m²]"""
    misfit: float
    seen: str
    """MASKS, or JOINTS beside them"""
    refined: dict[str, float]
    """`moved_sign` and `free_sign`"""
    stated: Floats
    """(21, 3, 3) [m²]"""
    said: Floats
    """(7,) that the frame is wrong, and its parts, before other paths through the recording counted"""


def tracked(session: Path) -> dict[str, Any]:
    """Return a recording's track and truth, and what its frames' judgements went by."""
    frames: dict[int, Judged] = {}
    usual, judged_as_usual = confidence.calibrated_covariance, recording_estimate.frame_confidence
    asked: list[Any] = []

    def stated(model: Any, *given: Any) -> Floats:
        asked[:] = [Model(model.scale.overall), *given]
        return usual(model, *given)

    def judged(result: Any, terms: Any, *given: Any) -> FrameResult:
        found = judged_as_usual(result, terms, *given)
        rows = [terms.model.joint_names.index(name) for name in keypoint_names()]
        model, curled, covariance, misfit, seen = asked
        previous, refined = given[2:]
        frames[previous[-1].frame + 1 if previous else 0] = Judged(
            model, curled, covariance[rows], misfit, "JOINTS" if seen is confidence.JOINTS else "MASKS", refined, found.joint_covariance[rows],
            np.append(found.p_off_25mm, found.p_off_10mm),
        )  # fmt: skip
        return found

    with (
        patch.object(confidence, "calibrated_covariance", stated),
        patch.object(recording_estimate, "frame_confidence", judged),
    ):
        run = TrackingRun.open(Session.open(session))
        start, pose = run.initial()
        track = run.result(run.track(run.session.frame_range, start, pose))
    truth = np.load(session / TRUTH_FILE)["keypoints21"][track.frame]
    return {"track": track, "truth": truth, "frames": frames}


@dataclass(frozen=True, eq=False)
class Half:
    """All frames of a half; those that were lost say nothing but that."""

    recording: Array[F]
    """names"""
    frames: Sequence[Judged | None]
    off: Floats[F, N, N]
    """(F, 21, 3) [m], beside constant offsets"""
    added: Floats
    """(F, 21, 3, 3) what other ways through the recording add to what is stated [m²]"""
    elsewhere: Floats[F, K]
    """how far the odds of other paths are above one in a thousand, a logarithm, of a frame and its parts"""

    @classmethod
    def read(cls, *folders: Path) -> Half:
        """Return what was tracked of a half, or of several."""
        frames: list[Judged | None] = []
        names, off, added, odds = [], [], [], []
        for path in (path for folder in folders for path in sorted(folder.glob("*.pickle"))):
            one = pickle.loads(path.read_bytes())
            track = one["track"]
            rows = [track.joint_names.index(name) for name in keypoint_names()]
            off.append(without_offsets(track.keypoints21, one["truth"]))
            for n, frame in enumerate(track.frame.tolist()):
                names.append(path.stem)
                known = one["frames"].get(frame) if track.status[n] != Status.LOST else None
                frames.append(known)
                stated = track.joint_covariance[n, rows]
                added.append(0 * stated if known is None else stated - known.stated)
                said = logit(np.append(track.p_off_25mm[n], track.p_off_10mm[n]))
                odds.append(0 * said if known is None else said - logit(known.said))
        elsewhere = np.nan_to_num(odds) / confidence.ELSEWHERE
        return cls(np.array(names), frames, np.concatenate(off), np.array(added), elsewhere)

    def of(self, rows: Array[F]) -> Half:
        """Return some of its frames."""
        frames = [one for one, chosen in zip(self.frames, rows, strict=True) if chosen]
        return Half(self.recording[rows], frames, self.off[rows], self.added[rows], self.elsewhere[rows])  # fmt: skip

    @property
    def known(self) -> Array[F]:
        return np.array([one is not None for one in self.frames])

    @property
    def wrong(self) -> Array[F]:
        return np.linalg.norm(self.off, axis=2).max(axis=1) > WRONG_M

    @property
    def fist(self) -> Array[F]:
        return np.array([one is not None and one.curled[1:].mean() > _FIST for one in self.frames])

    def covariance(self) -> Floats:
        """Return what is stated of each joint by the figures as they are, ways aside; a metre where the hand is lost."""
        return np.array([
            np.tile(np.eye(3), (21, 1, 1)) if one is None
            else calibrated_covariance(one.model, one.curled, one.covariance, one.misfit, getattr(confidence, one.seen))  # pyright: ignore[reportArgumentType]
            for one in self.frames
        ])  # fmt: skip

    def distances(self) -> tuple[Floats, Floats]:
        """Return each error's squared distance by what is stated of it, and the logarithm of that's volume."""
        stated = self.covariance() + self.added
        scaled = np.linalg.solve(stated, self.off[..., None])[..., 0]
        return (self.off * scaled).sum(axis=2), np.linalg.slogdet(stated)[1]

    def said(self) -> tuple[Floats[F], Floats]:
        """Return how probably each frame is wrong, and each part (F, 6), by the figures as they are."""
        odds = [
            logit(np.append(*failure_probabilities(one.model, stated, one.refined)[:2]))  # pyright: ignore[reportArgumentType]
            for one, stated in zip(self.frames, self.covariance(), strict=True)
            if one is not None
        ]
        said = np.ones((len(self.frames), 1 + len(PARTS)))
        said[self.known] = expit(np.array(odds) + confidence.ELSEWHERE * self.elsewhere[self.known])  # fmt: skip
        return said[:, 0], said[:, 1:]

    @property
    def parts_wrong(self) -> Array:
        """(F, 6) whether a joint of each part is more than 10 mm off."""
        part = np.array([part_of(name) for name in keypoint_names()])
        off = 1e3 * np.linalg.norm(self.off, axis=2)
        return np.stack([off[:, part == one].max(axis=1) > _PART_MM for one in PARTS], axis=1)


def fit_regions(half: Half, name: str) -> None:
    """Put a calibration in its place by which regions explain errors best and hold nine of ten, of fists and of others, of each source alike."""
    seen = half.of(np.array([one is not None and one.seen == name for one in half.frames]))
    filmed, fist = seen.recording == _VIDEOS, seen.fist
    sources = [rows for rows in (filmed, ~filmed) if rows.any()]
    groups = [rows & which for rows in sources for which in (fist, ~fist) if (rows & which).any()]

    def cost(values: Floats) -> float:
        noise, flesh, closed, palm = np.abs(values).tolist()
        setattr(confidence, name, Calibration(noise, 0.0, flesh, closed, palm, 0.0))
        far, volume = seen.distances()
        unlikely = 0.5 * (np.minimum(far, _FAR) + volume)
        inside = np.array([(far[rows] < _CHI2_90).mean() for rows in groups])
        return float(np.mean([unlikely[rows].mean() for rows in sources]) + 50.0 * ((inside - 0.9) ** 2).sum())  # fmt: skip

    now = getattr(confidence, name)
    start = np.array([now.noise, now.flesh_mm, now.closed_mm, now.palm_mm])
    cost(minimize(cost, start, method="Nelder-Mead", options=_OPTIONS).x.round(2))


def held_out(half: Half) -> Floats[F]:
    """Return how probably each frame is wrong by figures that were fitted to other recordings, five sixths of them."""
    chance, names = np.ones(len(half.frames)), np.unique(half.recording)
    for first in range(_FOLDS):
        rows = np.isin(half.recording, names[first::_FOLDS])
        fit(half.of(~rows))
        chance[rows] = half.of(rows).said()[0]
    return chance


def fit(half: Half) -> None:
    """Put figures in their place that explain a half best."""
    fit_regions(half, "MASKS")
    fit_regions(half, "JOINTS")
    half = half.of(half.recording != _VIDEOS)
    known, wrong = half.known, half.wrong
    judged = [one for one in half.frames if one is not None]
    every = [
        {**one.refined, "open": open_sign(stated)}
        for one, stated in zip(judged, half.covariance()[known], strict=True)
    ]
    signs = np.array([[1.0, *map(row.__getitem__, confidence.SIGNS)] for row in every])

    def of_signs(values: Floats) -> float:
        off = expit(signs @ values[:-1] + values[-1] * half.elsewhere[known, 0])
        chance = np.clip(np.where(wrong[known], off, 1.0 - off), 1e-4, 1.0)
        return float(-np.log(chance).sum() / _ALIKE + 0.5 * (values[1:] ** 2).sum() / _WIDE**2)

    bounds = [(-9.0, 0.0), *[(0.0, None)] * (len(confidence.SIGNS) + 1)]
    start = np.array([-4.0, *[1.0] * len(confidence.SIGNS), 0.3])
    always, *weights, elsewhere = minimize(of_signs, start, bounds=bounds).x.round(2)
    confidence.ALWAYS, confidence.ELSEWHERE = float(always), float(elsewhere)
    confidence.SIGNS = dict(zip(confidence.SIGNS, map(float, weights), strict=True))
    for sign in confidence.UNKNOWN:
        confidence.UNKNOWN[sign] = round(float(np.mean([one.refined[sign] for one in judged])), 2)

    true = half.parts_wrong[known]
    confidence.PART = (0.0, 1.0)
    weight, confidence.ELSEWHERE = confidence.ELSEWHERE, 0.0
    spread, confidence.ELSEWHERE = logit(half.said()[1][known]), weight

    def of_parts(values: Floats) -> float:
        odds = values[0] + values[1] * spread + weight * half.elsewhere[known, 1:]
        unlikely = np.logaddexp(0.0, np.where(true, -odds, odds))
        return float(unlikely.sum() / _ALIKE + 0.5 * values[1] ** 2 / _WIDE**2)

    confidence.PART = tuple(minimize(of_parts, np.array([-4.0, 2.4])).x.round(2).tolist())


def shares(half: Half, chance: Floats[F]) -> dict[str, float]:
    """Return which shares of a half's frames are wrong and, so probably wrong, of low confidence, and of its joints are in their 90 % region."""
    wrong, known = half.wrong, half.known
    low = chance * confidence.MISSED > 1.0
    inside = half.distances()[0] < _CHI2_90
    return {
        "wrong": float(wrong.mean()),
        "low_confidence": float(low.mean()),
        "recall": float(low[wrong].mean()),
        "precision": float(wrong[low].mean()),
        "log_loss": float(
            -np.log(np.clip(np.where(wrong, chance, 1.0 - chance), 1e-4, 1.0)).mean()
        ),
        "coverage90": float(inside[known].mean()),
        "coverage90_fists": float(inside[half.fist].mean()),
    }


def main() -> None:
    """Track what is not there yet, fit, and print."""
    recordings, tracks, *chosen = [word for word in sys.argv[1:] if word != "--json"]
    recordings, tracks = Path(recordings), Path(tracks)
    for half in chosen:
        (tracks / half).mkdir(parents=True, exist_ok=True)
        for session in sorted(p.parent for p in (recordings / half).glob(f"*/{SESSION_FILE}")):
            to = tracks / half / f"{session.name}.pickle"
            if not to.exists():
                to.write_bytes(pickle.dumps(tracked(session)))
                print(to, file=sys.stderr, flush=True)
    if "--json" in sys.argv:
        halves = {half: Half.read(tracks / half) for half in chosen}
        print(json.dumps({f"{half}_{name}": share for half, read in halves.items() for name, share in shares(read, read.said()[0]).items()}))  # fmt: skip
        return
    every = Half.read(*(tracks / half for half in chosen))
    others = held_out(every)
    fit(every)
    print("by other recordings, but for regions:", shares(every, others))
    for name in ("MASKS", "JOINTS", "ALWAYS", "SIGNS", "ELSEWHERE", "UNKNOWN", "PART"):
        print(f"{name} = {getattr(confidence, name)}")


if __name__ == "__main__":
    main()
