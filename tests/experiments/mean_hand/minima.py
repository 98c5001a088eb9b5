"""Where a definition's cost has its minimum next to the true pose: python -m tests.experiments.mean_hand.minima OUT DEFINITION…

Quick, beside `judge`: no search and no first pose; size and poses start from the true joints, then every frame is solved by its masks.
A wrong shape shows as the error at the minimum, and as the minimum's cost.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from handtrack import Session, TrackingRun
from handtrack.model.articulated import FINGERS, HandScale
from handtrack.model.model_file import load_model
from handtrack.session.layout import TRUTH_FILE
from handtrack.solver.levenberg_marquardt import solve
from handtrack.solver.solver_settings import SolverSettings
from handtrack.tracking.whole.evidence import Evidence
from tests.experiments.mean_hand.judge import errors, print_table

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
    return float(np.mean(cost)), *errors(np.array(found), true)


if __name__ == "__main__":
    print_table(COLUMNS, at_minima)
