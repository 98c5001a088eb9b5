"""Simulated first frames of hands that are not the model's, any turn, several kinds of evidence."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation
from scipy.stats import norm

from handtrack import ArticulatedModel, Camera, HandScale, Observation, Silhouette, load_model
from handtrack.arrays import D3, D21, Floats
from handtrack.capture.clouds.point_cloud import depth_cloud
from handtrack.model.articulated import FINGERS
from handtrack.model.ellipsoids import Ellipsoids, model_mask
from handtrack.model.pose_library import alphabet, named_pose
from handtrack.simulation.render import pixel_rays, render
from handtrack.simulation.scenes.simulated_views import everything
from handtrack.simulation.simulate import simulated_rig

KINDS = ("sil3", "depth", "sil2", "stereo", "sil6", "sil1")
"""silhouettes of so many cameras; a depth camera; a stereo pair's cloud and both silhouettes"""
GESTURES = ("open", "rest", "point", "fist", "curl", "flat", "pinch", "letter")
SIZE, BASE_M = (480, 360), 0.08
_OVERALL, _PART, _GIRTH, _BONE_GIRTH = 0.06, 0.03, 0.05, 0.06  # spreads of people's hands
_BENT = np.deg2rad(7.0)
_DEPTH = {"depth": (0.7, 0.002, 0.05), "stereo": (2.0, 0.003, 0.15)}
"""noise: over how many pixels it hangs together, its size [m]; share of the hand without measurements"""


@dataclass(frozen=True, eq=False)
class StartFrame:
    """What was seen of a hand, and the truth."""

    kind: str
    gesture: str
    has_arm: bool
    seen: Observation
    joints: Floats[D21, D3]
    """world [m]"""


def start_frame(seed: int, number: int) -> StartFrame:
    """Return one of a series of frames: kinds and gestures take turns, two in five have a forearm."""
    rng = np.random.default_rng(seed + number)
    kind = KINDS[number % len(KINDS)]
    gesture = GESTURES[number // len(KINDS) % len(GESTURES)]
    if gesture == "letter":
        gesture = alphabet()[rng.integers(26)]
    has_arm = bool(rng.random() < 0.4)
    hand = another_hand(rng, has_arm)
    params = _posed(hand, gesture, rng)
    joints = hand.keypoints21(hand.bones(params))
    return StartFrame(kind, gesture, has_arm, _observed(kind, hand, params, rng), joints)


def another_hand(rng: np.random.Generator, has_arm: bool = False) -> ArticulatedModel:
    """Return a hand of another size, with fingers of other lengths and bones of other girths."""
    parts = dict(zip(FINGERS, np.exp(_PART * rng.normal(size=5)).tolist(), strict=True))
    scale = HandScale(float(np.exp(_OVERALL * rng.normal())), parts)
    hand = load_model(forearm=has_arm, scale=scale)
    count = hand.skeleton.bone_count
    girth = np.exp(_GIRTH * rng.normal() + _BONE_GIRTH * rng.normal(size=count))
    flesh = {
        k: replace(e, radii=e.radii * girth[e.bone][:, None]) for k, e in hand.ellipsoids.items()
    }
    return replace(hand, ellipsoids=flesh)


def _posed(hand: ArticulatedModel, gesture: str, rng: np.random.Generator) -> Floats:
    """Return params (P,) of a gesture that is not quite the library's, turned anyhow, near the world's origin."""
    joint = named_pose(hand, gesture)
    joint[6:] += _BENT * rng.normal(size=len(joint) - 6)
    joint[6:] = np.clip(joint[6:], *hand.limits.bounds(joint)[6:].T)
    joint[3:6] = Rotation.from_quat(rng.normal(size=4), scalar_first=True).as_rotvec()
    params = hand.clipped(hand.clipped(hand.transform.solver_params(joint)))
    middle = hand.keypoints21(hand.bones(params)).mean(axis=0)
    params[:3] += rng.uniform(-0.04, 0.04, 3) - middle
    return params


def _observed(
    kind: str, hand: ArticulatedModel, params: Floats, rng: np.random.Generator
) -> Observation:
    bones = hand.bones(params)
    fine = hand.ellipsoids["fine"].posed(bones)
    if kind.startswith("sil"):
        cameras = simulated_rig(int(kind[3:]), SIZE).cameras
        return Observation(0, 0.0, tuple(_mask(camera, fine, rng) for camera in cameras))
    camera = simulated_rig(1, SIZE).cameras[0]
    depth = render(camera, hand.ellipsoids["metaballs"].posed(bones), pixel_rays(camera))[1]
    breadth, sigma, missing = _DEPTH[kind]
    noise, blobs = (_smooth(depth.shape, b, rng) for b in (breadth, 8.0))
    there = (depth > 0) & (blobs > norm.ppf(missing))
    cloud = depth_cloud(camera, np.where(there, depth + sigma * noise, 0.0))
    if kind == "depth":
        return Observation(0, 0.0, cloud=cloud, cloud_views=(camera.centre[None],))
    centre = camera.centre + BASE_M * camera.rotation[0]
    other = replace(camera, name="cam1", translation=-camera.rotation @ centre)
    masks = tuple(_mask(c, fine, rng) for c in (camera, other))
    return Observation(0, 0.0, masks, cloud=cloud, cloud_views=(camera.centre[None], centre[None]))


def _mask(camera: Camera, flesh: Ellipsoids, rng: np.random.Generator) -> Silhouette:
    """Return a mask whose outline is ragged by a third of a pixel or so."""
    soft = gaussian_filter(model_mask(camera, flesh).astype(np.float32), 1.0)
    mask = soft > 0.5 + 0.15 * _smooth(soft.shape, 4.0, rng)
    return Silhouette(camera, mask.astype(np.float32), everything(camera))


def _smooth(shape: tuple[int, ...], breadth: float, rng: np.random.Generator) -> Floats:
    """Return noise (H, W) of unit variance that hangs together over some pixels."""
    field = gaussian_filter(rng.normal(size=shape), breadth)
    return field / field.std()
