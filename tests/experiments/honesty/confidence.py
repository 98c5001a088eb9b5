"""Refit what frames say of themselves: python -m tests.experiments.honesty.confidence RECORDINGS TRACKS

RECORDINGS: what `python -m tests.experiments.honesty.recordings` wrote. TRACKS: gets what was tracked of each, with all that a judgement goes by;
what is there already is not tracked again. Prints the numbers for `handtrack/tracking/frame/doubt/figures.py`, fitted to `tune`.
"""

from __future__ import annotations

import pickle
import sys
from pathlib import Path
from typing import Any

import numpy as np

from handtrack import Session, TrackingRun
from handtrack.model.model_file import load_model
from handtrack.model.size import SizeParameters
from handtrack.session.layout import SESSION_FILE, TRUTH_FILE
from handtrack.terms.silhouettes.outline_overlap import outline_overlap, parts_overlap
from handtrack.tracking.frame.assessment import _parts, assess, outline_fit
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.doubt.stated import curls
from handtrack.tracking.whole import refined
from handtrack.tracking.whole.refinement import Refinement

HALVES = ("tune", "apart")


def tracked(session: Path) -> dict[str, Any]:
    """Return a recording's track, its truth, and what its frames' judgements went by."""
    frames: dict[int, dict[str, Any]] = {}
    found: dict[str, Any] = {}
    usual = refined.judged

    def judged(terms, params, energy, energies, covariance, previous, moved_m=None):
        model, bones = terms.model, terms.model.bones(params)
        names, parts = _parts(model)
        fine = model.flesh["fine"]
        fit = outline_fit(terms, bones)
        joints = []
        for term in terms.keypoints:
            joint, off = term.misses(bones)
            joints.append((joint, off))
        result = usual(terms, params, energy, energies, covariance, previous, moved_m)
        status, reason = assess(terms, bones, energy, previous)
        overlap = parts_overlap(terms.prepared, fine, parts, bones) if terms.prepared else []
        one = {
            "covariance": covariance, "energies": dict(energies), "views": terms.views, "moved_m": moved_m,
            "curls": curls(model, model.joint_params(params)), "joints": joints, "joint_names": model.joint_names,
            "overall": model.scale.overall,
            "iou": outline_overlap(terms.prepared, fine, bones).iou if terms.prepared else np.ones(0),
            "piece": 0.0 if fit is None else fit.piece_mm2,
            "parts": [(n, o.model, o.both) for n, o in zip(names, overlap, strict=True)] if terms.prepared else [],
            "assessed": (int(status), None if reason is None else reason.kind), "judged": result, "params": params,
            "places": model.joint_positions(bones),
        }  # fmt: skip
        frames[previous[-1].frame + 1 if previous else 0] = one
        return result

    refined.judged = judged
    try:
        run = TrackingRun.open(Session.open(session))
        start, pose = run.initial()
        control = Control(on_shared=lambda text: found.update(shared=text))
        track = run.result(run.track_with(control, run.session.frame_range, start, pose))
    finally:
        refined.judged = usual
    truth = np.load(session / TRUTH_FILE)["keypoints21"][track.frame]
    if found.get("shared"):
        scale = Refinement.read(found["shared"]).scale
        if scale is not None:
            found["deviations"] = SizeParameters(load_model(scale=scale)).deviations(scale)
    return {"track": track, "truth": truth, "frames": frames, **found}


def main() -> None:
    recordings, tracks = map(Path, sys.argv[1:3])
    for half in sys.argv[3:] or HALVES:
        (tracks / half).mkdir(parents=True, exist_ok=True)
        for session in sorted(
            (p.parent for p in (recordings / half).glob(f"*/{SESSION_FILE}")), reverse=True
        ):
            to = tracks / half / f"{session.name}.pickle"
            if not to.exists():
                to.write_bytes(pickle.dumps(tracked(session)))
                print(to, flush=True)


if __name__ == "__main__":
    main()
