"""What detectors and depth sensors would write of a simulated recording: 2D joints, and point clouds."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from handtrack.arrays import D2, D3, F, Floats, J, K, S
from handtrack.capture.clouds.cloud_files import write_cloud
from handtrack.capture.clouds.point_cloud import PointCloud
from handtrack.capture.images.openpose import LAYOUTS, Layout
from handtrack.capture.joints.given_joints import write_joints
from handtrack.capture.joints.joint_names import NAMED
from handtrack.geometry.camera import CameraRig
from handtrack.model.articulated import ArticulatedModel

_MOST = 20_000
"""points of a frame's cloud: what a depth camera has on a person"""


def layout_of_model(model: ArticulatedModel) -> str:
    """Return the session's keypoint_layout for all of a model's joints."""
    return NAMED if model.kind == "body" else f"hand_{model.side}"


def points_of(layout: Layout, names: Iterable[str], pixels: Floats[J, D2]) -> Floats[K, D3]:
    """Return points in a layout's order, confidence 1; those that are unknown or beyond the layout are missing."""
    points = np.zeros((layout.count, 3))
    for name, pixel in zip(names, pixels, strict=True):
        if name in layout.points and np.isfinite(pixel).all():
            points[layout.points[name]] = (*pixel, 1.0)
    return points


def write_noisy_joints(
    folder: Path,
    model: ArticulatedModel,
    rig: CameraRig,
    joint: Floats[F, S],
    sigma_px: float,
    rng: np.random.Generator,
) -> str:
    """Write every camera's 2D joints of a motion to `joints/CAMERA`, off by noise; return their layout."""
    layout = layout_of_model(model)
    places = [
        model.joint_positions(model.bones(model.transform.solver_params(params)))
        for params in joint
    ]
    for camera in rig:
        frames = {}
        for frame, points in enumerate(places):
            pixels = camera.project(points)
            noisy = pixels + rng.normal(scale=sigma_px, size=pixels.shape)
            frames[frame] = points_of(LAYOUTS[layout], model.joint_names, noisy)
        write_joints(frames, layout, folder / "joints" / camera.name)
    return layout


def write_clouds(folder: Path, clouds: Mapping[int, list[PointCloud]]) -> None:
    """Write the clouds of each frame, of all cameras together, thinned evenly, to `clouds`."""
    for frame, parts in clouds.items():
        points = np.concatenate([part.points for part in parts])
        kept = points[:: max(len(points) // _MOST, 1)]
        path = folder / "clouds" / f"{frame:06d}.ply"
        path.parent.mkdir(exist_ok=True)
        write_cloud(path, PointCloud(kept))
