"""Simulated depth sensors over a known motion: good, noisy, or as poor as in the 2004 paper's first experiment."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter

from handtrack import ArticulatedModel, Camera, Observation
from handtrack.arrays import Array, F, Floats, S
from handtrack.capture.clouds.point_cloud import depth_cloud
from handtrack.simulation.render import pixel_rays, render
from handtrack.simulation.simulate import simulated_rig


@dataclass(frozen=True)
class Sensor:
    """How a sensor errs. Shares are of the hand's pixels; errors hang together in space and over some frames."""

    size: tuple[int, int] = (640, 480)
    distance_m: float = 0.5
    noise_m: float = 0.001
    """standard deviation of depth"""
    noise_px: float = 0.0
    """over how many pixels noise stays the same; a matching window's are not independent"""
    missing: float = 0.0
    """share without a measurement, in blobs"""
    wrong: float = 0.0
    """share with a depth that is wrong by some centimetres, in blobs: what a mismatch gives"""
    wrong_m: tuple[float, float] = (0.02, 0.08)
    """least and largest such error, either way"""
    blob_m: float = 0.02
    """breadth of blobs at the hand"""
    lasting: float = 3.0
    """frames over which a blob stays"""


FINE = Sensor()
NOISY = Sensor(noise_m=0.003, missing=0.3, wrong=0.05)
DIGICLOPS = Sensor((320, 240), 0.6, noise_m=0.004, noise_px=2.0, missing=0.4, wrong=0.2)
"""320 × 240, zones of the hand without points, points whose depth is centimetres wrong (2004 paper, section 5.2)"""


def depth_views(
    model: ArticulatedModel, joint_params: Floats[F, S], sensor: Sensor, rng: np.random.Generator
) -> Iterator[Observation]:
    """Yield what one sensor sees of a motion: the ellipsoids that the merged surface is made of."""
    camera = simulated_rig(1, sensor.size, sensor.distance_m).cameras[0]
    rays = pixel_rays(camera)
    shape = (len(joint_params), sensor.size[1], sensor.size[0])
    holes, errors, size = (_blobs(shape, camera, sensor, rng) for _ in range(3))
    least, most = sensor.wrong_m
    for frame, joint in enumerate(joint_params):
        bones = model.bones(model.transform.solver_params(joint))
        depth = render(camera, model.ellipsoids["metaballs"].posed(bones), rays)[1]
        hand = depth > 0
        off = np.where(size[frame] < 0.5, -1.0, 1.0) * (
            least + (most - least) * np.abs(2.0 * size[frame] - 1.0)
        )
        depth = depth + np.where(errors[frame] < sensor.wrong, off, 0.0)
        depth = depth + sensor.noise_m * _noise(depth.shape, sensor.noise_px, rng)
        depth = np.where(hand & (holes[frame] >= sensor.missing), depth, 0.0)
        cloud = depth_cloud(camera, depth)
        yield Observation(frame, frame / 25.0, cloud=cloud, cloud_views=(camera.centre[None],))


def _noise(shape: tuple[int, ...], breadth: float, rng: np.random.Generator) -> Floats:
    """Return noise (H, W) of unit variance."""
    field = rng.normal(size=shape)
    if breadth > 0:
        field = gaussian_filter(field, breadth, mode="wrap")
        field /= field.std()
    return field


def _blobs(
    shape: tuple[int, int, int], camera: Camera, sensor: Sensor, rng: np.random.Generator
) -> Array:
    """Return (F, H, W) in 0…1, evenly distributed, smooth in space and time."""
    breadth = 0.5 * sensor.blob_m * float(camera.matrix[0, 0]) / sensor.distance_m
    coarse = max(int(breadth / 2), 1)  # made on a coarser grid, and spread
    small = (shape[0], -(-shape[1] // coarse), -(-shape[2] // coarse))
    field = gaussian_filter(
        rng.normal(size=small).astype(np.float32),
        (0.5 * sensor.lasting, breadth / coarse, breadth / coarse),
        mode="wrap",
    )
    rank = np.empty(field.size, np.float32)
    rank[np.argsort(field, axis=None)] = (np.arange(field.size) + 0.5) / field.size
    wide = rank.reshape(small).repeat(coarse, axis=1).repeat(coarse, axis=2)
    return wide[:, : shape[1], : shape[2]]
