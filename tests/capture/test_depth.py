"""Depth images → clouds."""

import cv2
import numpy as np
import pytest

from handtrack.capture.clouds.depth import DepthSettings, depth_cloud, surface_pixels
from handtrack.geometry.camera import Camera
from handtrack.geometry.rotation import rotation_matrix


def camera(distortions=(0, 0, 0, 0, 0)) -> Camera:
    matrix = np.array([[300.0, 0, 79.5], [0, 310.0, 59.5], [0, 0, 1]])
    return Camera(
        "kinect",
        (160, 120),
        matrix,
        np.array(distortions),
        rotation_matrix(np.array([0.3, -0.2, 0.1])),
        np.array([0.1, 0.2, 0.3]),
    )


@pytest.mark.parametrize("distortions", [(0, 0, 0, 0, 0), (-0.3, 0.1, 0.002, -0.001, 0.0)])
def test_points_project_back_to_their_pixels(distortions):
    seen = camera(distortions)
    depth = np.full((120, 160), 0.5)
    depth[:, :40] = 0
    cloud = depth_cloud(seen, depth, settings=None)
    assert len(cloud) == 120 * 120
    assert np.allclose(seen.to_camera(cloud.points)[:, 2], 0.5)
    rows, columns = np.nonzero(depth)
    assert np.allclose(seen.project(cloud.points), np.column_stack([columns, rows]), atol=1e-4)


def test_what_is_no_measurement_is_left_out():
    depth = np.full((120, 160), 0.5)
    depth[0, 0], depth[0, 1], depth[0, 2], depth[0, 3] = 0, -1, np.nan, np.inf
    cloud = depth_cloud(camera(), depth, settings=None)
    assert len(cloud) == 120 * 160 - 4
    assert np.isfinite(cloud.points).all()
    assert len(depth_cloud(camera(), np.zeros((120, 160)))) == 0


def test_flying_pixels_go_and_surfaces_stay(rng):
    depth = np.full((120, 160), 0.9)
    depth[30:90, 40:120] = 0.5
    flying = np.zeros(depth.shape, bool)
    flying[30:90, 40] = rng.random(60) < 0.5
    flying[30:90, 119] = rng.random(60) < 0.5
    depth += rng.normal(0, 0.0008, depth.shape)
    depth[flying] = rng.uniform(0.6, 0.8, flying.sum())
    keep = surface_pixels(depth, 300.0)
    assert keep[flying].mean() < 0.15
    assert keep[~flying].mean() > 0.99


def test_grazing_surfaces_go():
    angle = np.radians(85)
    slope = np.tan(angle) / 300.0
    depth = 0.5 * np.exp(slope * np.arange(40))[None].repeat(50, axis=0)
    settings = DepthSettings(grazing_deg=80, jump_share=0.0)
    assert not surface_pixels(depth, 300.0, settings).any()
    flat = 0.5 * np.exp(np.tan(np.radians(60)) / 300.0 * np.arange(40))[None].repeat(50, axis=0)
    assert surface_pixels(flat, 300.0, settings)[1:-1, 1:-1].all()


def test_a_real_hand_before_a_body(data_dir):
    from handtrack.capture.clouds.cloud_filters import CloudFilters

    files = sorted((data_dir / "sr305_depth_hand" / "20210326-230536").glob("*.png"))
    if not files:
        pytest.skip("no sr305_depth_hand among the shared data")
    matrix = np.array([[476.007, 0, 313.683], [0, 476.007, 242.755], [0, 0, 1]])
    sr305 = Camera("sr305", (640, 480), matrix, np.zeros(5), np.eye(3), np.zeros(3))
    chain = CloudFilters(component="nearest", front_m=0.12)
    for path in files:
        depth = cv2.imread(str(path), cv2.IMREAD_UNCHANGED) * 0.000125
        hand, _ = chain.apply(depth_cloud(sr305, depth), centres=np.zeros((1, 3)))
        low, high = np.quantile(hand.points, [0.01, 0.99], axis=0)
        assert 2500 <= len(hand) <= 4000, path.name
        assert 0.15 < np.linalg.norm(high - low) < 0.5, path.name  # hand and some forearm
