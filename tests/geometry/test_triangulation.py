"""Points from several cameras, of which one may see something else."""

import numpy as np
import pytest

from handtrack.geometry.triangulation import robustly_triangulated, triangulated
from handtrack.simulation.simulate import simulated_rig


@pytest.fixture
def seen(rng):
    """Twenty points within a hand's breadth as five cameras see them, to half a pixel."""
    cameras = [camera.without_distortion() for camera in simulated_rig(5).cameras]
    points = rng.uniform(-0.06, 0.06, (20, 3))
    pixels = np.array([camera.project(points) for camera in cameras])
    return cameras, points, pixels + rng.normal(scale=0.5, size=pixels.shape)


def test_a_camera_that_sees_something_else_is_outvoted(seen):
    cameras, points, pixels = seen
    pixels[2] += (50.0, -20.0)
    plain, robust = (
        1e3 * np.linalg.norm(found - points, axis=1)
        for found in (triangulated(cameras, pixels), robustly_triangulated(cameras, pixels, 3.0))
    )
    assert plain.min() > 5.0
    assert robust.max() < 1.0


def test_without_errors_it_is_plain_triangulation(seen):
    cameras, points, _ = seen
    exact = np.array([camera.project(points) for camera in cameras])
    exact[1:, 0] = np.nan
    found = robustly_triangulated(cameras, exact, 3.0)
    assert np.isnan(found[0]).all(), "one camera alone says nothing of depth"
    np.testing.assert_allclose(found[1:], points[1:], atol=1e-9)


def test_weights_count_for_as_much_as_repeated_cameras(seen):
    cameras, _, pixels = seen
    weights = np.ones(pixels.shape[:2])
    weights[0] = 2.0
    twice = triangulated([cameras[0], *cameras], np.concatenate([pixels[:1], pixels]))
    np.testing.assert_allclose(triangulated(cameras, pixels, weights=weights), twice, atol=1e-12)
