"""The merged surface: known distances, the plain form, links, and what must not merge."""

from __future__ import annotations

import numpy as np
import pytest

from docs.pictures.ellipsoid_distances import true_distance
from handtrack.errors import HandtrackError
from handtrack.model.articulated import HandScale
from handtrack.model.flesh import Ellipsoids
from handtrack.model.kinematics import BonePoses
from handtrack.model.model_file import load_model
from handtrack.model.surfaces.metaballs import (
    FORMS,
    MetaballSurface,
    linked_ellipsoids,
)
from tests.derivatives import check_jacobian
from tests.model.metaballs_reference import distances, merged


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


@pytest.mark.parametrize("form", ["d2", "d3"])
def test_outside_along_the_axes_the_distance_is_true(form):
    surface, bones = one([0.01, 0.02, 0.03], form)
    for axis, radius in enumerate((0.01, 0.02, 0.03)):
        point = np.zeros((1, 3))
        point[0, axis] = -0.05
        assert surface.distance(bones, point)[0] == pytest.approx(0.05 - radius)


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


def test_d3_is_continuous_and_its_gradient_jumps_by_the_ratio_of_radii():
    surface, bones = one([0.01, 0.02, 0.03])
    for axis, radius in enumerate((0.01, 0.02, 0.03)):
        point = np.zeros((2, 3))
        point[:, axis] = radius + np.array([-1e-9, 1e-9])
        near = surface.near(bones, point)
        np.testing.assert_allclose(near.distance, 0.0, atol=2e-9)
        inside, outside = near.gradient[:, axis]
        assert outside / inside == pytest.approx(radius / 0.01, rel=1e-6)


@pytest.mark.parametrize("form", FORMS)
def test_the_centre_is_deep_inside_and_has_a_finite_gradient(form):
    surface, bones = one([0.01, 0.02, 0.03], form)
    near = surface.near(bones, np.array([[0.0, 0, 0], [1e-13, 0, 0], [0, 1e-11, -1e-11]]))
    np.testing.assert_allclose(near.distance, -0.01, atol=1e-9)
    assert np.isfinite(near.gradient).all()
    assert (np.linalg.norm(near.gradient, axis=1) <= 1.0 + 1e-9).all()


def test_coincident_ellipsoids_move_the_surface_by_log_n_over_beta(rng):
    points = rng.normal(scale=0.03, size=(50, 3))
    alone, bones = one([0.01, 0.02, 0.03])
    many, _ = one([0.01, 0.02, 0.03], copies=4, sharpness=500.0)
    expected = alone.distance(bones, points) - np.log(4) / 500.0
    np.testing.assert_allclose(many.distance(bones, points), expected, atol=1e-15)


def test_the_palm_is_linked_with_first_bones_and_fingers_only_with_themselves(model):
    flesh = model.flesh["metaballs"]
    names = [model.skeleton.bone_names[b] for b in flesh.bone]
    linked = linked_ellipsoids(model.skeleton, flesh)
    assert (linked == linked.T).all() and linked.diagonal().all()
    pairs = {(names[i], names[j]) for i, j in np.argwhere(linked) if i < j}
    fingers = ("index", "middle", "ring", "little")
    palm = names[0]
    expected = {(palm, f"{f}_proximal") for f in fingers} | {(palm, "thumb_metacarpal")}
    expected |= {("thumb_metacarpal", "thumb_proximal"), ("thumb_proximal", "thumb_distal")}
    expected |= {(f"{f}_proximal", f"{f}_intermediate") for f in fingers}
    expected |= {(f"{f}_intermediate", f"{f}_distal") for f in fingers}
    assert pairs == expected


def finger_gap(model):
    """Return bones with index and middle finger a hair apart, and points in the gap between their middles."""
    names = ("index_intermediate_5", "middle_intermediate_8")
    pair = [model.flesh["metaballs"].name.index(name) for name in names]
    for spread in np.deg2rad(np.arange(0.0, 12.0, 0.05)):
        bones = model.bones(model.params_from({"index_mcp_abd": -spread}))
        flesh = model.flesh["metaballs"].posed(bones)
        line = np.linspace(flesh.centre[pair[0]], flesh.centre[pair[1]], 401)[1:-1]
        d, _ = distances(flesh, line, "d3")
        if d.min(axis=1).max() < 2e-4:
            return bones, line[d.min(axis=1) > 0]
    raise AssertionError("the fingers do not come near each other")


def test_fingers_that_nearly_touch_do_not_merge(model):
    surface = MetaballSurface.of(model)
    bones, gap = finger_gap(model)
    assert len(gap)
    assert (surface.distance(bones, gap) > -1e-5).all()
    everything = np.ones_like(surface.linked)
    fused = MetaballSurface(surface.ellipsoids, everything, surface.sharpness)
    assert (fused.distance(bones, gap) < -3e-4).all()  # what linking all ellipsoids would do


def test_the_surface_grows_with_the_hand(rng, model):
    large = load_model(scale=HandScale(1.3))
    bones, points = pose(rng, model), rng.normal(scale=0.08, size=(200, 3))
    grown = BonePoses(bones.reference * 1.3, bones.rotation, bones.position * 1.3)
    np.testing.assert_allclose(
        MetaballSurface.of(large).distance(grown, 1.3 * points),
        1.3 * MetaballSurface.of(model).distance(bones, points),
        atol=1e-12,
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


def test_points_that_are_not_numbers_stay_so(rng, model):
    points = rng.normal(scale=0.1, size=(5, 3))
    points[2, 1] = np.nan
    distance = MetaballSurface.of(model).distance(pose(rng, model), points)
    assert np.isnan(distance[2]) and np.isfinite(np.delete(distance, 2)).all()


def test_what_cannot_be_is_refused_in_words(model):
    with pytest.raises(HandtrackError) as caught:
        MetaballSurface.of(model, form="d4")
    assert str(caught.value) == "no distance to an ellipsoid 'd4'; known: d1, d2, d3"
    with pytest.raises(HandtrackError) as caught:
        MetaballSurface.of(model, sharpness=0.0)
    assert str(caught.value) == (
        "metaballs: sharpness 0 per metre; expected a positive number such as 1000."
    )
    with pytest.raises(HandtrackError, match="no set of ellipsoids 'fat' in the model hand26"):
        MetaballSurface.of(model, flesh="fat")
