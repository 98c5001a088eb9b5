"""Cameras: projection against OpenCV, the lens back and forth, the Jacobian, refused matrices."""

import cv2
import numpy as np
import pytest

from handtrack.arrays import Floats
from handtrack.errors import HandtrackError
from handtrack.geometry.camera import Camera
from handtrack.geometry.lens import field_radius
from handtrack.geometry.rotation import rotation_matrix

MATRIX = np.array([[800.0, 0, 310], [0, 790, 245], [0, 0, 1]])
BARREL = np.array([-0.3, 0.1, 0.001, -0.002, -0.01])


def make(distortions: Floats | None = None, **changes: object) -> Camera:
    values: dict[str, object] = {
        "name": "cam0",
        "size": (640, 480),
        "matrix": MATRIX,
        "distortions": np.zeros(5) if distortions is None else distortions,
        "rotation": rotation_matrix(np.array([0.1, -0.2, 0.3])),
        "translation": np.array([0.02, -0.01, 0.6]),
    }
    return Camera(**{**values, **changes})  # type: ignore[arg-type]


@pytest.mark.parametrize("count", [4, 5, 8, 12, 14])
def test_projects_as_opencv_with_every_number_of_coefficients(count, rng):
    """Fault C30."""
    camera = make(rng.normal(0, 0.02, count))
    points = rng.uniform(-0.15, 0.15, (40, 3))
    expected, _ = cv2.projectPoints(
        points, camera.rotation, camera.translation, camera.matrix, camera.distortions
    )
    np.testing.assert_allclose(camera.project(points), expected[:, 0], atol=1e-9)


@pytest.mark.parametrize("count", [4, 5, 8, 12, 14])
def test_undistorting_undoes_the_lens(count, rng):
    camera = make(rng.normal(0, 0.02, count))
    points = rng.uniform(-0.15, 0.15, (6, 7, 3))
    straight = camera.without_distortion().project(points)
    np.testing.assert_allclose(camera.undistort_points(camera.project(points)), straight, atol=1e-8)
    np.testing.assert_allclose(camera.distort_points(straight), camera.project(points), atol=1e-8)


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
    points = rng.uniform(-0.2, 0.2, (4, 5, 3))
    jacobian = camera.project_jacobian(points)
    assert jacobian.shape == (4, 5, 2, 3)
    for axis in range(3):
        step = 1e-6 * np.eye(3)[axis]
        change = (straight.project(points + step) - straight.project(points - step)) / 2e-6
        np.testing.assert_allclose(jacobian[..., axis], change, rtol=1e-6, atol=1e-3)


def test_centre_projection_and_rays_belong_together(rng):
    camera = make(BARREL)
    np.testing.assert_allclose(camera.to_camera(camera.centre), 0, atol=1e-12)
    points = rng.uniform(-0.1, 0.1, (9, 3))
    homogeneous = np.column_stack([points, np.ones(9)]) @ camera.projection.T
    straight = camera.without_distortion().project(points)
    np.testing.assert_allclose(homogeneous[:, :2] / homogeneous[:, 2:], straight, atol=1e-9)
    towards = points - camera.centre
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    np.testing.assert_allclose(camera.rays(camera.project(points)), towards, atol=1e-10)


SKEWED = MATRIX + np.array([[0, 0.5, 0], [0, 0, 0], [0, 0, 0]])
SINGULAR = np.diag([1.0, 1.0, 0.0])
BAD_CAMERAS = {
    "skew": ({"matrix": SKEWED}, "camera 'cam0': the matrix has a skew of 0.5; expected 0"),
    "no focal length": ({"matrix": np.diag([0.0, 800, 1])}, "focal lengths 0, 800; expected pos"),
    "focal length in another unit": (
        {"matrix": np.diag([800, 1e12, 1.0])},
        "focal lengths 800, 1e.12",
    ),
    "transposed": ({"matrix": MATRIX.T}, "the matrix must read .* Is it transposed"),
    "mirrored": ({"rotation": np.diag([-1.0, 1, 1])}, "mirrored .determinant -1, expected 1"),
    "singular": ({"rotation": SINGULAR}, "no rotation: .*determinant 0.*singular or scaled"),
    "scaled": ({"rotation": 2 * np.eye(3)}, "no rotation: .*determinant 8"),
    "NaN": ({"translation": np.array([0, np.nan, 1])}, "translation has values that are not fin"),
    "infinite": ({"rotation": np.full((3, 3), np.inf)}, "rotation has values that are not finite"),
    "coefficients": ({"distortions": np.zeros(6)}, "6 distortion coefficients; .* 4, 5, 8, 12 or"),
    "shape": ({"translation": np.zeros(4)}, r"translation has the shape \(4,\), expected \(3,\)"),
    "size": ({"size": (640, 0)}, r"size \(640, 0\); expected width and height in pixels"),
}


@pytest.mark.parametrize("case", BAD_CAMERAS)
def test_impossible_cameras_are_refused(case):
    changes, message = BAD_CAMERAS[case]
    with pytest.raises(HandtrackError, match=message):
        make(**changes)
