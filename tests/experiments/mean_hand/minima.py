"""Where a definition's cost has its minimum next to the true pose: python -m tests.experiments.mean_hand.minima OUT DEFINITION…

Quick, beside `judge`: no search and no first pose; size and poses start from the true joints, then every frame is solved by its masks.
A wrong shape shows as the error at the minimum, and as the minimum's cost.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from handtrack import Session, TrackingRun
from handtrack.arrays import Floats
from handtrack.bench.honesty.honesty import _bone_frames
from handtrack.diagnostics.flexion import BENT_JOINTS, flexion_deg
from handtrack.model.articulated import FINGERS, HandScale
from handtrack.model.model_file import load_model
from handtrack.session.layout import SESSION_FILE, TRUTH_FILE
from handtrack.solver.levenberg_marquardt import solve
from handtrack.solver.solver_settings import SolverSettings
from handtrack.tracking.whole.evidence import Evidence

COLUMNS = ("cost", "mean", "free", "flex", "thumb")
_EVERY = 3


def at_minima(session: Path, definition: str) -> tuple[float, ...]:
    """Return `COLUMNS` of one recording, means over its frames."""
    truth = np.load(session / TRUTH_FILE)["keypoints21"]
    frames = np.arange(0, len(truth), _EVERY)
    true = truth[frames]
    run = TrackingRun.open(
        Session.open(session),
        {"model.name": definition, "model.fit_size": "false", "model.forearm": "false"},
    )
    model = run.model
    _, pose = run.initial()
    poses = [pose.copy() for _ in frames]

    def off(x, model, points):
        posture = 0.02 * np.degrees(x[6:] - model.rest_params()[6:])
        return np.r_[((model.keypoints21(model.bones(x)) - points) * 1e3).ravel(), posture]

    size = np.zeros(1 + len(FINGERS))
    for _ in range(3):
        scale = HandScale(
            float(np.exp(size[0])),
            {f: float(np.exp(v)) for f, v in zip(FINGERS, size[1:], strict=True)},
        )
        model = load_model(definition, "right", scale)
        before = poses[0]
        for i, points in enumerate(true):
            poses[i] = before = least_squares(off, before, args=(model, points), max_nfev=15).x

        def sized(v):
            one = load_model(
                definition,
                "right",
                HandScale(
                    float(np.exp(v[0])),
                    {f: float(np.exp(x)) for f, x in zip(FINGERS, v[1:], strict=True)},
                ),
            )
            away = [
                ((one.keypoints21(one.bones(x)) - p) * 1e3).ravel()
                for x, p in zip(poses, true, strict=True)
            ]
            return np.concatenate([*away, 30 * v[1:]])

        size = least_squares(sized, size, max_nfev=4).x
    scale = HandScale(
        float(np.exp(size[0])),
        {f: float(np.exp(v)) for f, v in zip(FINGERS, size[1:], strict=True)},
    )
    run = run.with_scale(scale)
    model = run.model
    poses = [model.clipped(x) for x in poses]
    given = {int(f): x for f, x in zip(frames, poses, strict=True)}
    evidence = Evidence(model, run.settings, run.observation, given, 0.04)
    cost, found = [], []
    for f, x in given.items():
        best = solve(evidence.of(f).problem, x, SolverSettings(iterations=30))
        cost.append(best.cost)
        found.append(model.keypoints21(model.bones(best.params)))
    away = np.array(found) - true
    axes = _bone_frames(true)
    local = np.einsum("fjab,fja->fjb", axes, away)
    half = np.arange(len(away)) < len(away) / 2
    free = np.concatenate(
        [local[a] - np.median(local[b], axis=0) for a, b in ((half, ~half), (~half, half))]
    )
    bend = np.abs(flexion_deg(np.array(found)) - flexion_deg(true)).mean(axis=0)
    thumb = np.array([n.startswith("thumb") for n in BENT_JOINTS])

    def mean(v: Floats) -> float:
        return 1e3 * float(np.linalg.norm(v, axis=-1).mean())

    return (
        float(np.mean(cost)),
        mean(away),
        mean(free),
        float(bend[~thumb].mean()),
        float(bend[thumb].mean()),
    )


def main() -> None:
    names = sys.argv[2:]
    only = names[names.index("--") + 1 :] if "--" in names else []
    names = names[: names.index("--")] if "--" in names else names
    sessions = sorted(p.parent for p in Path(sys.argv[1]).glob(f"*/{SESSION_FILE}"))
    for definition in names:
        print(f"{Path(definition).stem:34}", *(f"{c:>7}" for c in COLUMNS))
        every = []
        for session in sessions:
            if only and session.name not in only:
                continue
            every.append(at_minima(session, definition))
            print(f"  {session.name:32}", *(f"{x:7.2f}" for x in every[-1]), flush=True)
        if every:
            print(f"  {'mean':32}", *(f"{x:7.2f}" for x in np.mean(every, axis=0)), flush=True)


if __name__ == "__main__":
    main()
