"""Benchmark: joint error with arms of any length or a sleeve, with and without a modelled forearm.

The hand that is seen is another than the one that is tracked: each part is thicker or thinner by 6 %, and the forearm is
a tapered tube that ends bluntly. First pose and size come from keypoints with 5 mm of noise, as in a session.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np

from handtrack import ArticulatedModel, Camera, Keypoints, Observation, Silhouette, load_model
from handtrack.arrays import D3, D21, F, Floats
from handtrack.geometry.rotation import rotation_matrix, rotation_vector
from handtrack.model.articulated import keypoint_names
from handtrack.simulation.motion import motion
from handtrack.simulation.simulate import simulated_rig
from handtrack.tracking.frame.terms.forearm import forearm_in_view
from handtrack.tracking.search.initialize import fit_keypoints, fit_scale
from tests.experiments.tracked_frames import mean_mm, tracked

ARMS: dict[str, tuple[float, float]] = {
    "none": (0.0, 1.0),
    "20": (0.02, 1.0),
    "30": (0.03, 1.0),
    "60": (0.06, 1.0),
    "long": (0.28, 1.0),
    "sleeve": (0.28, 0.05),
}
"""where an arm ends (names in mm), and where a sleeve half as wide again begins [m from the wrist]"""
RIGS = ("pair", "three")
FRAMES, OF = 14, 40  # of an opening and closing hand
# along the arm: half-widths
_TUBE = 1e-3 * np.array([[0, 28, 19], [60, 30, 22], [120, 38, 32], [200, 43, 40], [300, 46, 43]])


def forearms(seeds: Sequence[int] = (11,), frames: int = FRAMES) -> dict[str, float | int | str]:
    """Return the mean joint error [mm] by rig, arm and model: without a forearm, with one, as `auto` chooses."""
    figures: dict[str, float | int | str] = {"seeds": len(seeds), "frames": frames}
    for rig in RIGS:
        for arm in ARMS:
            found = np.array([list(_errors(rig, arm, seed, frames)) for seed in seeds])
            for way, error in zip(("without", "with", "auto"), found.mean(axis=0), strict=True):
                figures[f"{rig}_{arm}_{way}_mm"] = float(error)
    return figures


def _errors(rig: str, arm: str, seed: int, frames: int) -> Iterator[float]:
    rng = np.random.default_rng(seed)
    seen, truth = recording(cameras(rig), *ARMS[arm], frames, rng)
    given = Keypoints(keypoint_names(), truth[0] + 0.005 * rng.normal(size=(21, 3)), 0.008)
    seen[0] = replace(seen[0], keypoints=(given,))
    scale = fit_scale(lambda size: load_model(scale=size), given)
    hand = load_model(scale=scale)
    found = forearm_in_view(hand, [(fit_keypoints(hand, given), seen[0])]) or 0.0
    for forearm in (False, True, found):
        yield _error(load_model(scale=scale, forearm=forearm), seen, given, truth)


def _error(
    model: ArticulatedModel, seen: Sequence[Observation], given: Keypoints, truth: Floats
) -> float:
    settings = {"tracker.escape": False, "tracker.recovery": False}
    results = tracked(model, settings, seen, fit_keypoints(model, given))
    return mean_mm(np.array([result.keypoints21 for result in results]), truth)


def cameras(rig: str) -> list[Camera]:
    """Return three cameras in an arc, or two that are 7 cm apart, 0.6 m before the hand's back."""
    if rig == "three":
        return list(simulated_rig(3, distance_m=0.6).cameras)
    one = simulated_rig(1, distance_m=0.6).cameras[0]
    beside = [one.translation - [x, 0.0, 0.0] for x in (-0.035, 0.035)]
    return [replace(one, name=f"cam{i}", translation=t) for i, t in enumerate(beside)]


def recording(
    rig: Sequence[Camera], ends: float, sleeve: float, frames: int, rng: np.random.Generator
) -> tuple[list[Observation], Floats[F, D21, D3]]:
    """Return masks of the first frames, and the true keypoints: a hand that opens and closes, wanders, and
    bends by 45° at the wrist while the arm does not turn."""
    model = load_model(forearm=True)
    flesh, arm = model.flesh["fine"], model.skeleton.bone("forearm")
    thick = np.exp(0.06 * rng.normal(size=len(model.skeleton.bone_names)))[flesh.bone, None]
    hand = replace(flesh, radii=flesh.radii * thick).subset(flesh.bone != arm)
    ball = rng.normal(size=(400, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    tubes = _tubes(0.0, ends, 1.0) + _tubes(sleeve, ends, 1.5)
    seen, truth = [], []
    for frame, joint in enumerate(_bent(model, motion(model, "open_fist_open", OF, rng))[:frames]):
        bones = model.bones(model.transform.solver_params(joint))
        posed = hand.posed(bones)
        parts = [
            c + (ball * r) @ turn.T
            for c, r, turn in zip(posed.centre, posed.radii, posed.rotation, strict=True)
        ]
        parts += [bones.to_world(arm, tube) for tube in tubes]
        views = tuple(_silhouette(camera, parts) for camera in rig)
        seen.append(Observation(frame, frame / 25.0, views))
        truth.append(model.keypoints21(bones))
    return seen, np.array(truth)


def _bent(model: ArticulatedModel, joint: Floats) -> Floats:
    """Return joint parameters (F, S) with the wrist bent to and fro, the arm pointing where it did."""
    bent, flex = joint.copy(), model.skeleton.parameter("wrist_flex")
    bent[:, flex] = np.deg2rad(45.0) * np.sin(np.linspace(0.0, 2 * np.pi, len(joint)))
    for params in bent:
        turn = rotation_matrix(params[3:6])
        params[3:6] = rotation_vector(turn @ rotation_matrix(np.array([-params[flex], 0.0, 0.0])))
    return bent


def _tubes(start: float, end: float, wide: float) -> list[Floats]:
    """Return convex pieces (N, 3) of a tube with blunt ends, in the forearm's frame."""
    along = _TUBE[:, 0]
    places = [start, *along[(along > start) & (along < end)], end] if end > start else []
    angle = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    rings = [
        np.stack(
            [
                wide * np.interp(y, along, _TUBE[:, 1]) * np.cos(angle),
                np.full_like(angle, y),
                wide * np.interp(y, along, _TUBE[:, 2]) * np.sin(angle) - 0.002,
            ],
            axis=1,
        )
        for y in places
    ]
    return [np.concatenate(pair) for pair in pairwise(rings)]


def _silhouette(camera: Camera, parts: Sequence[Floats]) -> Silhouette:
    """Return the mask of convex parts: each one's points (N, 3) fill their hull in the image."""
    width, height = camera.size
    mask = np.zeros((height, width), np.uint8)
    for points in parts:
        fixed = np.rint(16 * camera.project(points)).astype(np.int32)
        cv2.fillConvexPoly(mask, cv2.convexHull(fixed), 1, cv2.LINE_8, 4)
    valid = np.tile(np.array([0, width], np.int32), (height, 1))
    return Silhouette(camera, mask.astype(np.float32), valid)
