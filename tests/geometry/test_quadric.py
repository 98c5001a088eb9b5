"""Quadrics, their conics in a camera, and derivatives against finite differences."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from handtrack.errors import HandtrackError
from handtrack.geometry import quadric as q


@pytest.fixture
def scene(rng):
    """Ellipsoids 0.4–0.6 m before a camera in general position: projection, centre, rotation, radii."""
    count = 12
    turn = Rotation.random(rng=rng).as_matrix()
    matrix = np.array([[5.0, 0, 0.2], [0, 6.0, -0.1], [0, 0, 1]])
    projection = matrix @ np.column_stack([turn, [0.02, -0.01, 0.5]])
    centre = rng.normal(scale=0.03, size=(count, 3))
    rotation = Rotation.random(count, rng=rng).as_matrix()
    return projection, centre, rotation, rng.uniform(0.005, 0.03, (count, 3))


def test_a_sphere_shows_as_the_circle_that_is_known():
    projection = np.column_stack([np.eye(3), [0, 0, 2.0]])
    dual = q.dual_conic(projection, np.zeros((1, 3)), np.eye(3)[None]).value
    centre, shape = q.ellipse(dual)
    np.testing.assert_allclose(centre[0], 0, atol=1e-15)
    np.testing.assert_allclose(shape[0], np.eye(2) / 3, rtol=1e-14)  # tan² of asin(1/2)


def test_surface_centre_and_outside_have_the_values_0_minus_1_and_more(scene, rng):
    _, centre, rotation, radii = scene
    quadric = q.ellipsoid_quadric(centre, rotation, radii)
    direction = rng.normal(size=centre.shape)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    for scale, expected in ((0.0, -1.0), (1.0, 0.0), (2.0, 3.0)):
        point = centre + scale * np.einsum("eij,ej->ei", rotation, radii * direction)
        point = np.concatenate([point, np.ones((len(point), 1))], axis=1)
        value = np.einsum("ei,eij,ej->e", point, quadric, point)
        np.testing.assert_allclose(value, expected, atol=1e-11)


def test_the_dual_is_the_inverse(scene):
    _, centre, rotation, radii = scene
    product = q.ellipsoid_quadric(centre, rotation, radii) @ q.ellipsoid_dual(
        centre, rotation, radii
    )
    np.testing.assert_allclose(product, np.broadcast_to(np.eye(4), product.shape), atol=1e-10)


def test_an_ellipsoid_comes_back_from_its_quadric(scene):
    _, centre, rotation, radii = scene
    for e in range(len(centre)):
        quadric = q.ellipsoid_quadric(centre[e], rotation[e], radii[e])
        back = q.quadric_ellipsoid(-3.0 * quadric)
        np.testing.assert_allclose(back[0], centre[e], atol=1e-12)
        np.testing.assert_allclose(back[2], np.sort(radii[e]), rtol=1e-10)
        assert np.linalg.det(back[1]) == pytest.approx(1.0)
        again = q.ellipsoid_quadric(*back)
        np.testing.assert_allclose(again, quadric, rtol=0, atol=1e-8 * np.abs(quadric).max())


def test_other_quadrics_are_refused():
    with pytest.raises(HandtrackError, match="no ellipsoid"):
        q.quadric_ellipsoid(np.diag([1.0, 1.0, -1.0, -1.0]))
    with pytest.raises(HandtrackError, match="no real point"):
        q.quadric_ellipsoid(np.eye(4))


def test_the_conic_is_the_shadow_of_the_dual_quadric(scene):
    projection, centre, rotation, radii = scene
    ours = q.dual_conic(projection, centre, q.shape_matrix(rotation, radii)).value
    papers = projection @ q.ellipsoid_dual(centre, rotation, radii) @ projection.T
    np.testing.assert_allclose(ours, papers, atol=1e-14)


def test_signs_and_scales(scene):
    projection, centre, rotation, radii = scene
    dual = q.dual_conic(projection, centre, q.shape_matrix(rotation, radii))
    assert q.is_ellipse(projection, centre, q.shape_matrix(rotation, radii)).all()
    middle = np.concatenate([q.ellipse(dual.value)[0], np.ones((len(centre), 1))], axis=1)
    plain = np.einsum("ei,eij,ej->e", middle, q.conic(dual).value, middle)
    normal = np.einsum("ei,eij,ej->e", middle, q.normalised_conic(dual).value, middle)
    np.testing.assert_allclose(plain, 1 / dual.value[:, 2, 2], rtol=1e-9)
    np.testing.assert_allclose(normal, -1.0, rtol=1e-9)
    vector = q.conic_vector(q.normalised_conic(dual).value)
    assert np.einsum("ek,ek->e", vector, q.monomials(*middle[:, :2].T)) == pytest.approx(-1.0)


@pytest.mark.parametrize("stage", ["dual", "conic", "normalised_conic"])
def test_twist_derivatives_match_finite_differences(scene, stage):
    projection, centre, rotation, radii = scene
    reference = np.array([0.03, -0.02, 0.05])

    def at(step):
        turn = Rotation.from_rotvec(step[3:]).as_matrix()
        moved = reference + step[:3] + (centre - reference) @ turn.T
        dual = q.dual_conic(projection, moved, q.shape_matrix(turn @ rotation, radii), reference)
        return dual if stage == "dual" else getattr(q, stage)(dual)

    exact = at(np.zeros(6)).by_twist
    for k in range(6):
        step = 1e-6 * np.eye(6)[k]
        numeric = (at(step).value - at(-step).value) / 2e-6
        np.testing.assert_allclose(exact[:, k], numeric, rtol=0, atol=2e-7 * np.abs(exact).max())


def test_behind_and_around_the_camera_there_is_no_ellipse():
    projection = np.column_stack([np.eye(3), np.zeros(3)])
    centre = np.array([[0, 0, 2.0], [0, 0, -2.0], [0, 0, 0.5], [3.0, 0, 0.5], [0, 0, 0.0]])
    shape = np.broadcast_to(np.eye(3), (5, 3, 3))
    assert q.is_ellipse(projection, centre, shape).tolist() == [True, False, False, False, False]
