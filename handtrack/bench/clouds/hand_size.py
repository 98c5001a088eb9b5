"""Benchmark: a person's hand size fitted to a recording of another hand, and the joint error with it.

Needs the shared test data (HANDTRACK_DATA). Both recordings show the same mesh: the size comes from the first alone.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from handtrack.arrays import D3, D21, F, Floats
from handtrack.bench.measuring import mean_mm, recording
from handtrack.model.articulated import FINGERS, ArticulatedModel, HandScale
from handtrack.session.run import TrackingRun
from handtrack.session.session import Session

SIZED, OTHERS = "webxr_open_close_3cam", ("webxr_fist_6cam",)
CLOUDS = ("webxr_exact_depth_768", "webxr_depth_640", "webxr_stereo_768")
FRAMES = 20
_SEGMENTS = dict.fromkeys(FINGERS[1:], ("proximal", "intermediate", "distal")) | {
    "thumb": ("metacarpal", "proximal", "distal")
}
_LENGTHWISE = 0.7  # cosine between an ellipsoid's axis and its bone


def hand_size() -> dict[str, Any]:
    """Return mean joint errors [mm] over all frames for four hands: a mean adult's, the fitted one, and two with
    lengths taken from the truth: by finger (all that a size can say), and bone by bone.
    """
    sessions = {name: recording(name) for name in (SIZED, *OTHERS)}
    keypoints = _known(sessions[SIZED])
    fitted = _run(sessions[SIZED]).fit_size(None, sessions[SIZED].frame_range, FRAMES).scale
    figures: dict[str, Any] = {
        "overall": fitted.overall,
        "parts": {name: round(factor, 3) for name, factor in fitted.parts.items()},
    }
    for name, session in sessions.items():
        run = _run(session).with_scale(HandScale())
        mean = run.model
        by_part = run.with_scale(true_scale(mean, keypoints))
        by_bone = replace(run, model=lengthened(mean, true_factors(mean, keypoints)))
        errors = {
            "uncalibrated": mean_error_mm(run),
            "fitted": mean_error_mm(run.with_scale(fitted)),
            "truth_by_finger": mean_error_mm(by_part),
            "truth_by_bone": mean_error_mm(by_bone),
        }
        figures |= {f"{name}_{hand}_mm": error for hand, error in errors.items()}
        figures[f"{name}_ratio_by_finger"] = errors["fitted"] / errors["truth_by_finger"]
        figures[f"{name}_ratio_by_bone"] = errors["fitted"] / errors["truth_by_bone"]
    return figures | {"reference": "bar: ratio 1.15 to the error with bone lengths from the truth"}


def hand_size_clouds() -> dict[str, Any]:
    """Return mean joint errors [mm] of cloud recordings: size by the first frame's keypoints, and fitted to clouds."""
    figures: dict[str, Any] = {}
    for name in CLOUDS:
        run = _run(recording(name), {"silhouettes.weight": 0.0})
        figures[f"{name}_by_keypoints_mm"] = mean_error_mm(run)
        sized = run.fit_size(None, run.session.frame_range, FRAMES)
        figures[f"{name}_fitted_mm"] = mean_error_mm(sized)
        figures[f"{name}_scale"] = sized.scale.overall
    return figures


def mean_error_mm(run: TrackingRun, frames: range | None = None) -> float:
    """Return the mean distance of the 21 keypoints to the truth over all frames (or some) [mm]."""
    kept = frames or run.session.frame_range
    track = run.result(run.track(kept, *run.initial()))
    assert track.keypoints21 is not None
    return mean_mm(track.keypoints21, _known(run.session)[kept.start : kept.stop])


def true_factors(model: ArticulatedModel, keypoints: Floats[F, D21, D3]) -> dict[str, float]:
    """Return by bone how much longer it is in the truth than in a model.

    The palm's bones, from the wrist to a knuckle or the thumb's base, share the factor of that distance.
    """
    ours = model.keypoints21(model.bones(model.rest_params()))

    def ratio(a: int, b: int) -> float:
        true = np.median(np.linalg.norm(keypoints[:, a] - keypoints[:, b], axis=1))
        return float(true / np.linalg.norm(ours[a] - ours[b]))

    factors = {}
    for k, finger in enumerate(FINGERS):
        base = 1 + 4 * k
        factors[f"{finger}_carpal"] = ratio(0, base)
        if finger != "thumb":
            factors[f"{finger}_metacarpal"] = ratio(0, base)
        for j, segment in enumerate(_SEGMENTS[finger]):
            factors[f"{finger}_{segment}"] = ratio(base + j, base + j + 1)
    return factors


def true_scale(model: ArticulatedModel, keypoints: Floats[F, D21, D3]) -> HandScale:
    """Return the size with the truth's lengths as far as a size can say them: the palm's mean factor from the wrist to
    the knuckles, and each finger's whole length.
    """
    ours = model.keypoints21(model.bones(model.rest_params()))[None]

    def length(points: Floats, finger: int) -> float:
        chain = points[:, 1 + 4 * finger : 5 + 4 * finger]
        return float(np.median(np.linalg.norm(np.diff(chain, axis=1), axis=2).sum(axis=1)))

    factors = true_factors(model, keypoints)
    palm = float(np.mean([factors[f"{finger}_carpal"] for finger in FINGERS[1:]]))
    whole = {f: length(keypoints, k) / length(ours, k) / palm for k, f in enumerate(FINGERS)}
    return HandScale(palm, whole)


def lengthened(model: ArticulatedModel, factors: dict[str, float]) -> ArticulatedModel:
    """Return the model with bones longer by factors; flesh is stretched along its bone, and no thicker."""
    bones = model.skeleton
    factor = np.array([factors.get(name, 1.0) for name in bones.bone_names])
    offset = bones.offset * np.where(bones.parent >= 0, factor[bones.parent], 1.0)[:, None]
    flesh = {}
    for name, set_ in model.flesh.items():
        stretch = factor[set_.bone]
        along = np.abs(set_.rotation[:, 1, :]) > _LENGTHWISE
        flesh[name] = replace(
            set_,
            centre=set_.centre
            * np.stack([np.ones_like(stretch), stretch, np.ones_like(stretch)], 1),
            radii=set_.radii * np.where(along, stretch[:, None], 1.0),
        )
    return replace(
        model,
        skeleton=replace(bones, offset=offset, length=bones.length * factor),
        flesh=flesh,
        joint_point=model.joint_point * factor[model.joint_bone][:, None],
    )


def _run(session: Session, values: dict[str, Any] | None = None) -> TrackingRun:
    return TrackingRun.open(session, {"model.fit_size": False, **(values or {})})


def _known(session: Session) -> Floats:
    assert session.truth is not None
    assert session.truth.keypoints21 is not None
    return session.truth.keypoints21
