"""Cameras, rotations, quadrics and triangulation."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from handtrack import Camera
from handtrack.geometry import quadric as q
from handtrack.geometry.lens import field_radius
from handtrack.geometry.rotation import (
    matrix_from_quaternion,
    quaternion_wxyz,
    rotation_matrix,
    rotation_vector,
    spread_rotations,
    turned_by,
)
from handtrack.geometry.triangulation import triangulated
from handtrack.simulation.simulate import simulated_rig
from tests.conftest import refused
from tests.derivatives import check_jacobian

MATRIX = np.array([[800.0, 0, 310], [0, 790, 245], [0, 0, 1]])
BARREL = np.array([-0.3, 0.1, 0.001, -0.002, -0.01])


def make(distortions=np.zeros(5), **changes):
    turn, place = rotation_matrix(np.array([0.1, -0.2, 0.3])), np.array([0.02, -0.01, 0.6])
    return replace(Camera("cam0", (640, 480), MATRIX, distortions, turn, place), **changes)


@pytest.mark.parametrize("count", [4, 5, 8, 12, 14])
def test_projects_as_opencv_with_every_number_of_coefficients_and_back(count, rng):
    """Fault C30."""
    lens, points = rng.normal(0, 0.02, (1, count)), rng.uniform(-0.15, 0.15, (6, 7, 3))
    turn, place = np.array([[0.1], [-0.2], [0.3]]), np.array([[20.0], [-10], [600]])
    expected, _ = cv2.projectPoints(1e3 * points.reshape(-1, 3), turn, place, MATRIX, lens)
    given = turn if count == 5 else cv2.Rodrigues(turn)[0]
    camera = Camera.from_opencv(
        MATRIX.tolist(), lens, given, place, name="cam0", size=(640, 480), unit_m=1e-3
    )
    seen, straight = camera.project(points), camera.without_distortion().project(points)
    assert_allclose(seen, expected.reshape(6, 7, 2), atol=1e-9)
    assert_allclose(camera.undistort_points(seen), straight, atol=1e-8)
    assert_allclose(camera.distort_points(straight), seen, atol=1e-8)


def test_far_off_points_do_not_fold_back_into_the_image():
    camera = make(np.array([-0.3, 0, 0, 0, 0]), rotation=np.eye(3), translation=np.zeros(3))
    limit = field_radius(camera.distortions)
    assert limit == pytest.approx(np.sqrt(1 / 0.9))
    seen = camera.project(np.array([[0.99 * limit, 0, 1], [1.01 * limit, 0, 1], [30.0, 0, 1]]))
    assert np.isfinite(seen[0]).all()
    assert np.isnan(seen[1:]).all()


def test_jacobian_agrees_with_differences(rng):
    camera = make(BARREL)
    straight = camera.without_distortion()
    for point in rng.uniform(-0.2, 0.2, (20, 3)):
        check_jacobian(straight.project, camera.project_jacobian(point), point)


def test_centre_projection_and_rays_belong_together(rng):
    camera = make(BARREL)
    assert_allclose(camera.to_camera(camera.centre), 0, atol=1e-12)
    points = rng.uniform(-0.1, 0.1, (9, 3))
    homogeneous = np.column_stack([points, np.ones(9)]) @ camera.projection.T
    straight = camera.without_distortion().project(points)
    assert_allclose(homogeneous[:, :2] / homogeneous[:, 2:], straight, atol=1e-9)
    towards = points - camera.centre
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    assert_allclose(camera.rays(camera.project(points)), towards, atol=1e-10)


BAD_CAMERAS = {
    "skew": ({"matrix": MATRIX + 0.5 * np.outer([1, 0, 0], [0, 1, 0])}, "a skew of 0.5"),
    "no focal length": ({"matrix": np.diag([0.0, 800, 1])}, "focal lengths 0, 800"),
    "focal length in another unit": ({"matrix": np.diag([800, 1e12, 1.0])}, "800, 1e.12"),
    "transposed": ({"matrix": MATRIX.T}, "the matrix must read"),
    "mirrored": ({"rotation": np.diag([-1.0, 1, 1])}, "determinant -1"),
    "singular": ({"rotation": np.diag([1.0, 1.0, 0.0])}, "determinant 0"),
    "NaN": ({"translation": np.array([0, np.nan, 1])}, "translation"),
    "infinite": ({"rotation": np.full((3, 3), np.inf)}, "rotation"),
    "coefficients": ({"distortions": np.zeros(6)}, "6 distortion coefficients"),
    "shape": ({"translation": np.zeros(4)}, r"translation .*\(4,\)"),
    "size": ({"size": (640, 0)}, r"size \(640, 0\)"),
}


@pytest.mark.parametrize("case", BAD_CAMERAS)
def test_impossible_cameras_are_refused(case):
    changes, message = BAD_CAMERAS[case]
    refused(message, make, **changes)


@pytest.mark.parametrize("off", [0.0, 1e-13, 1e-9, 1e-3])
@pytest.mark.parametrize("angle", [0.0, 1e-6, 1e-3, 2.0, np.pi - 1e-9])
def test_matrices_give_the_vectors_and_quaternions_of_scipy(rng, angle, off):
    axes = rng.normal(size=(300, 3))
    turns = rotation_matrix(angle * axes / np.linalg.norm(axes, axis=1, keepdims=True))
    turns = turns + off * rng.normal(size=turns.shape)
    known = Rotation.from_matrix(turns)
    assert_array_equal(rotation_vector(turns), known.as_rotvec())
    assert_array_equal(quaternion_wxyz(turns), known.as_quat(scalar_first=True))


def test_every_rotation_has_one_near(rng):
    grid = spread_rotations(600)
    assert grid @ np.swapaxes(grid, 1, 2) == pytest.approx(np.tile(np.eye(3), (600, 1, 1)))
    assert np.linalg.det(grid) == pytest.approx(np.ones(600))
    quaternions = rng.normal(size=(500, 4))
    turns = matrix_from_quaternion(quaternions)
    assert_array_equal(turns, Rotation.from_quat(quaternions, scalar_first=True).as_matrix())
    nearest = [turned_by(grid, r).min() for r in turns]
    # measured 14.0° and 23.8°; 600 random ones: 15.5° and about 45°
    assert np.rad2deg(np.mean(nearest)) < 14.6
    assert np.rad2deg(np.max(nearest)) < 27.0


def test_a_sphere_shows_as_the_circle_that_is_known():
    projection = np.column_stack([np.eye(3), [0, 0, 2.0]])
    centre, shape = q.ellipse(q.dual_conic(projection, np.zeros((1, 3)), np.eye(3)[None]))
    assert_allclose(centre[0], 0, atol=1e-15)
    assert_allclose(shape[0], np.eye(2) / 3, rtol=1e-14)  # tan² of asin(1/2)


def test_behind_and_around_the_camera_there_is_no_ellipse():
    projection = np.column_stack([np.eye(3), np.zeros(3)])
    centre = np.array([[0, 0, 2.0], [0, 0, -2.0], [0, 0, 0.5], [3.0, 0, 0.5], [0, 0, 0.0]])
    shape = np.broadcast_to(np.eye(3), (5, 3, 3))
    assert q.is_ellipse(projection, centre, shape).tolist() == [True, False, False, False, False]


def test_points_are_triangulated_by_weights_and_not_from_what_one_camera_alone_sees(rng):
    cameras = [camera.without_distortion() for camera in simulated_rig(5).cameras]
    points = rng.uniform(-0.06, 0.06, (20, 3))
    exact = np.array([camera.project(points) for camera in cameras])
    noisy, weights = exact + rng.normal(scale=0.5, size=exact.shape), np.ones(exact.shape[:2])
    weights[0] = 2.0
    twice = triangulated([cameras[0], *cameras], np.concatenate([noisy[:1], noisy]))
    assert_allclose(triangulated(cameras, noisy, weights=weights), twice, atol=1e-12)
    exact[1:, 0] = np.nan
    found = triangulated(cameras, exact)
    assert np.isnan(found[0]).all()
    assert_allclose(found[1:], points[1:], atol=1e-9)
