"""Benchmark: hands drawn from what is known of people: is their shape found from a few frames, and does what is reported of it hold?

Two or three cameras see six postures half a second apart: masks whose outline is off by as much as the settings say, and in the second kind
a detector's joints too, each off by 5 px and by a constant in its bone. The mean hand is fitted to each frame from its true pose;
frames that are sure so tell the shape.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import cv2
import numpy as np

from handtrack import (
    ArticulatedModel,
    Camera,
    HandScale,
    ImageKeypoints,
    Observation,
    Silhouette,
    Status,
    Tracker,
    TrackerSettings,
    TrackerState,
    load_model,
)
from handtrack.arrays import Floats, P
from handtrack.model.articulated import keypoint_names
from handtrack.model.size import SizeParameters, hand_length_mm
from handtrack.simulation.motion import motion
from handtrack.simulation.scenes.simulated_views import mask_views
from handtrack.simulation.simulate import simulated_rig
from handtrack.tracking.size.person import Subject, shape_covariance
from handtrack.tracking.whole.chosen_frames import fit_person

HANDS, FRAMES = 20, 6
_SECONDS, _SIGMA_PX = 0.5, 5.0
SETTINGS = TrackerSettings()


def simulated_hands(hands: Sequence[int] = range(HANDS)) -> dict[str, Any]:
    """Return for each kind the share of hands in their joint 90 % region, and of numbers in theirs; root mean squares of errors in reported
    and in people's standard deviations (1: nothing was told), and of the whole length's error [mm].
    """
    figures: dict[str, Any] = {"hands": len(hands), "frames": FRAMES}
    for kind in ("masks", "masks_and_joints"):
        found = [_fitted(seed, kind == "masks_and_joints") for seed in hands]
        figures |= {f"{kind}_{name}": value for name, value in _figures(found).items()}
    return figures | {"reference": "bar: 0.80 to 0.97 in the 90 % regions"}


def _fitted(seed: int, joints: bool) -> tuple[Floats, Floats, float, float]:
    """Return errors of the shape's numbers and their covariance, in deviations; the length's error and standard deviation [mm]."""
    rng = np.random.default_rng([seed, 17])
    mean = load_model()
    size = SizeParameters(mean, keypoint_names() if joints else ())
    deviations = rng.normal(size=len(size.names))
    hand = load_model(scale=size.scale(deviations))
    cameras = simulated_rig(2 + seed % 2, (320, 240)).cameras
    joint = motion(hand, "gestures", 6 * FRAMES, rng)[::6]
    true = [hand.clipped(hand.transform.solver_params(row)) for row in joint]
    seen = [_seen(hand, pose, cameras, n, joints, rng) for n, pose in enumerate(true)]
    tracker = Tracker(mean, SETTINGS)
    results = [
        tracker.step_without_search(TrackerState.beginning_at(pose), one)[1]
        for pose, one in zip(true, seen, strict=True)
    ]
    sure = [n for n, result in enumerate(results) if result.status == Status.TRACKED]
    sure = sure if len(sure) > 1 else list(range(FRAMES))
    poses = [mean.transform.solver_params(results[n].parameters) for n in sure]
    subject = Subject(lambda scale: load_model(scale=scale), offsets=joints)
    scale = fit_person(subject, mean, SETTINGS, [seen[n] for n in sure], poses)
    assert scale is not None  # cameras around tell a shape
    told = np.array([name != "forearm" for name in size.names])  # nobody sees one
    off = (size.deviations(scale) - deviations)[told]
    covariance = shape_covariance(size, scale)[np.ix_(told, told)]
    length = _length_mm(scale) - _length_mm(hand.scale)
    return off, covariance, length, scale.std["length_mm"]


def _seen(
    hand: ArticulatedModel,
    pose: Floats[P],
    cameras: Sequence[Camera],
    frame: int,
    joints: bool,
    rng: np.random.Generator,
) -> Observation:
    exact = mask_views(hand, pose, cameras, frame)
    masks = tuple(_frayed(one, hand.bones(pose).position.mean(axis=0), rng) for one in exact.silhouettes)  # fmt: skip
    points = []
    if joints:
        rows = [hand.joint_names.index(name) for name in keypoint_names()]
        places = hand.bones(pose).to_world(hand.joint_bone, hand.observed_point)[rows]
        for camera in cameras:
            pixels = camera.project(places) + rng.normal(scale=_SIGMA_PX, size=(len(rows), 2))
            points.append(ImageKeypoints(camera, keypoint_names(), pixels, _SIGMA_PX))
    return Observation(frame, _SECONDS * frame, masks, keypoints=tuple(points))


def _frayed(seen: Silhouette, place: Floats, rng: np.random.Generator) -> Silhouette:
    """Return a mask whose outline is off by the settings' sigma, alike along as much of it as they say."""
    usual, depth = SETTINGS.silhouettes, float(seen.camera.to_camera(place)[2])
    px = 1e-3 * seen.camera.pixels_per_m(depth)
    inside = (seen.mask > 0.5).astype(np.uint8)
    signed = cv2.distanceTransform(inside, cv2.DIST_L2, 5) - cv2.distanceTransform(1 - inside, cv2.DIST_L2, 5)  # fmt: skip
    # the correlation exp(−d²/4s²) of noise smoothed by s has the integral 2 s √π
    noise = cv2.GaussianBlur(
        rng.normal(size=inside.shape), (0, 0), usual.outline_correlation_mm * px / (2 * np.pi**0.5)
    )
    noise *= usual.outline_sigma_mm * px / noise.std()
    return replace(seen, mask=(signed + noise > 0).astype(np.float32))


def _length_mm(scale: HandScale) -> float:
    return hand_length_mm(load_model(scale=scale))


def _figures(found: Sequence[tuple[Floats, Floats, float, float]]) -> dict[str, float]:
    from scipy.special import chdtri

    off = np.array([one[0] for one in found])
    std = np.array([np.sqrt(np.diag(one[1])) for one in found])
    far = np.array([error @ np.linalg.solve(known, error) for error, known, _, _ in found])
    length, said = np.array([one[2:] for one in found]).T
    return {
        "in_joint_90": float((far < chdtri(off.shape[1], 0.1)).mean()),
        "numbers_in_90": float((np.abs(off) < 1.645 * std).mean()),
        "error_in_reported_std": float(np.sqrt(((off / std) ** 2).mean())),
        "error_in_population_std": float(np.sqrt((off**2).mean())),
        "length_mm": float(np.sqrt((length**2).mean())),
        "length_reported_mm": float(np.sqrt((said**2).mean())),
    }
