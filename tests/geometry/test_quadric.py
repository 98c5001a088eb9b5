"""The ellipses that ellipsoids show in a camera."""

import numpy as np
from scipy.spatial.transform import Rotation

from handtrack.geometry import quadric as q


def test_a_sphere_shows_as_the_circle_that_is_known():
    projection = np.column_stack([np.eye(3), [0, 0, 2.0]])
    centre, shape = q.ellipse(q.dual_conic(projection, np.zeros((1, 3)), np.eye(3)[None]))
    np.testing.assert_allclose(centre[0], 0, atol=1e-15)
    np.testing.assert_allclose(shape[0], np.eye(2) / 3, rtol=1e-14)  # tan² of asin(1/2)


def test_sight_lines_that_touch_an_ellipsoid_are_on_its_ellipse(rng):
    """A ray x + t d touches where the quadratic t ↦ value on the ellipsoid has a double root: no dual conic needed."""
    count = 12
    turn = Rotation.random(rng=rng).as_matrix()
    matrix = np.array([[5.0, 0, 0.2], [0, 6.0, -0.1], [0, 0, 1]])
    projection = matrix @ np.column_stack([turn, [0.02, -0.01, 0.5]])
    centre = rng.normal(scale=0.03, size=(count, 3))
    axes = Rotation.random(count, rng=rng).as_matrix()
    radii = rng.uniform(0.005, 0.03, (count, 3))
    shape = q.shape_matrix(axes, radii)
    assert q.is_ellipse(projection, centre, shape).all()
    middle, spread = q.ellipse(q.dual_conic(projection, centre, shape))
    eye = -turn.T @ [0.02, -0.01, 0.5]
    angle = np.linspace(0, 2 * np.pi, 8)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    for e in range(count):
        inner = np.linalg.inv(shape[e])
        outline = middle[e] + (np.linalg.cholesky(spread[e]) @ circle).T
        for pixel, inside in [*((x, False) for x in outline), (middle[e], True)]:
            ray = turn.T @ np.linalg.solve(matrix, [*pixel, 1.0])
            a, b = ray @ inner @ ray, ray @ inner @ (eye - centre[e])
            c = (eye - centre[e]) @ inner @ (eye - centre[e]) - 1.0
            discriminant = (b * b - a * c) / (b * b)
            assert discriminant > 1e-6 if inside else abs(discriminant) < 1e-9


def test_behind_and_around_the_camera_there_is_no_ellipse():
    projection = np.column_stack([np.eye(3), np.zeros(3)])
    centre = np.array([[0, 0, 2.0], [0, 0, -2.0], [0, 0, 0.5], [3.0, 0, 0.5], [0, 0, 0.0]])
    shape = np.broadcast_to(np.eye(3), (5, 3, 3))
    assert q.is_ellipse(projection, centre, shape).tolist() == [True, False, False, False, False]
