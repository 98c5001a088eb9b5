"""The merged surface: known distances, the plain form, links, and what must not merge."""

import numpy as np
import pytest

from docs.pictures.ellipsoid_distances import true_distance
from handtrack.model.flesh import Ellipsoids
from handtrack.model.kinematics import BonePoses
from handtrack.model.model_file import load_model
from handtrack.model.surfaces.metaballs import (
    FORMS,
    MetaballSurface,
)
from tests.derivatives import check_jacobian
from tests.model.metaballs_reference import merged


@pytest.fixture(scope="module")
def model():
    return load_model()


def one(radii, form="d3", copies=1, sharpness=1000.0):
    """Return a surface of ellipsoids that all lie in each other, linked, and the bones that carry them."""
    flesh = Ellipsoids(
        ("e",) * copies,
        np.zeros(copies, int),
        np.zeros((copies, 3)),
        np.tile(np.eye(3), (copies, 1, 1)),
        np.tile(np.asarray(radii, float), (copies, 1)),
    )
    bones = BonePoses(np.zeros(3), np.eye(3)[None], np.zeros((1, 3)))
    return MetaballSurface(flesh, np.ones((copies, copies), bool), sharpness, form), bones


def around(rng, model, bones, count=2000):
    """Return points inside, on and outside the hand."""
    joints = model.joint_positions(bones)
    spread = rng.uniform(0.001, 0.05, size=(count, 1))
    return joints[rng.integers(len(joints), size=count)] + spread * rng.normal(size=(count, 3))


def pose(rng, model):
    params = model.rest_params() + 0.2 * rng.normal(size=len(model.rest_params()))
    return model.bones(model.clipped(params))


@pytest.mark.parametrize("form", FORMS)
def test_all_forms_are_exact_for_a_ball(rng, form):
    surface, bones = one([0.02] * 3, form)
    points = rng.normal(scale=0.03, size=(200, 3))
    near = surface.near(bones, points)
    size = np.linalg.norm(points, axis=1)
    np.testing.assert_allclose(near.distance, size - 0.02, atol=1e-15)
    np.testing.assert_allclose(near.gradient, points / size[:, None], atol=1e-12)


@pytest.mark.parametrize("form", FORMS)
def test_kernel_equals_the_plain_form(rng, model, form):
    bones, surface = pose(rng, model), MetaballSurface.of(model, form=form)
    points = around(rng, model, bones)
    d, closest, share, n = merged(surface, bones, points)
    near = surface.near(bones, points)
    np.testing.assert_array_equal(near.ellipsoid, closest)
    np.testing.assert_allclose(near.distance, d, atol=1e-14)
    np.testing.assert_allclose(
        near.gradient, np.einsum("ne,nei->ni", share, n), rtol=1e-9, atol=1e-12
    )
    np.testing.assert_array_equal(surface.distance(bones, points), near.distance)


@pytest.mark.parametrize("form", FORMS)
def test_gradient_is_the_slope(rng, model, form):
    bones, surface = pose(rng, model), MetaballSurface.of(model, form=form)
    for point in around(rng, model, bones, 40):
        gradient = surface.near(bones, point[None]).gradient
        check_jacobian(
            lambda x: surface.distance(bones, x[None]), gradient, point, step=1e-8, rtol=1e-5
        )


def test_true_distance_against_a_dense_surface(rng):
    radii = np.array([0.038, 0.053, 0.015])
    sphere = rng.normal(size=(400_000, 3))
    dense = radii * sphere / np.linalg.norm(sphere, axis=1, keepdims=True)
    for point in rng.normal(scale=0.04, size=(20, 3)):
        brute = np.linalg.norm(dense - point, axis=1).min()
        exact = true_distance(radii, point[None])[0]
        assert abs(exact) == pytest.approx(brute, abs=5e-4)
        assert abs(exact) <= brute + 1e-9
    np.testing.assert_allclose(true_distance(radii, dense[:100]), 0.0, atol=1e-9)
    assert true_distance(radii, np.zeros((1, 3)))[0] == pytest.approx(-0.015, abs=1e-6)
