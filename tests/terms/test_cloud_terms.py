"""Clouds: distances to the surface (E1), empty space (E2) and lines of sight, against plain forms, by differences, and by hand."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial import cKDTree

from handtrack import Camera, load_model
from handtrack.geometry.camera import camera_matrix
from handtrack.model.metaballs import FORMS, MetaballSurface, sample_surface, surface_mesh
from handtrack.terms.clouds import (
    CloudDistanceTerm,
    CloudEmptinessTerm,
    CloudRaysTerm,
    distance_map,
    prepare_cloud,
    visible_from,
)
from handtrack.terms.loss import geman_mcclure, huber, quadratic, uniform_outliers
from handtrack.terms.term import motion_row
from tests.derivatives import check_jacobian, check_observation_term
from tests.model.metaballs_reference import cloud_rows
from tests.terms.cloud_rays_reference import ray_costs
from tests.terms.plain_rows import system_of
from tests.terms.silhouette_scene import assert_same_system

HAND = load_model()
SURFACE, RESTING = MetaballSurface.of(HAND), HAND.bones(HAND.rest_params())
MESH = surface_mesh(SURFACE, RESTING, 0.006)
VERTICES, _ = MESH.carried(RESTING)
LOSSES = [quadratic(), geman_mcclure(2.0), huber(1.5), uniform_outliers(0.2, 20.0)]


def hand_cloud(rng, count):
    """Return points near a hand's surface, and bones some millimetres and degrees away."""
    truth = HAND.clipped(HAND.rest_params() + 0.2 * rng.normal(size=26))
    points, _ = sample_surface(SURFACE, HAND.bones(truth), count, rng)
    away = truth + rng.normal(scale=0.08, size=26) * np.r_[np.full(3, 0.1), np.ones(23)]
    return points + 0.002 * rng.normal(size=points.shape), HAND.bones(HAND.clipped(away))


@pytest.mark.parametrize(("loss", "form"), [*zip(LOSSES, (*FORMS, "d3"), strict=True)])
def test_distances_are_summed_as_in_the_plain_form_and_have_its_slope(rng, form, loss):
    points, bones = hand_cloud(rng, 1501)
    points = np.concatenate([points, rng.uniform(-0.3, 0.3, size=(200, 3))])
    surface = MetaballSurface.of(HAND, form=form, sharpness=700.0)
    term = CloudDistanceTerm(prepare_cloud(points), surface, 0.003, loss, weight=0.4)
    plain = system_of(len(bones.position), *cloud_rows(surface, bones, points, 0.003, loss, 0.4))
    assert_same_system(term.linearize(bones), plain)
    assert term.cost(bones) == pytest.approx(plain.cost, rel=1e-9)
    few = replace(term, cloud=prepare_cloud(points[::5]))
    check_observation_term(few, bones, HAND.skeleton.bone_names, step=1e-8, rtol=1e-4)


def test_an_empty_cloud_asks_for_nothing():
    for points in (np.zeros((0, 3)), np.full((4, 3), np.nan)):
        term = CloudDistanceTerm(prepare_cloud(points), SURFACE)
        system = term.linearize(RESTING)
        assert system.cost == term.cost(RESTING) == term.cloud.count == 0
        assert not system.gradient.any() and not system.hessian.any()


@pytest.mark.parametrize("loss", LOSSES)
def test_a_losses_weight_is_the_slope_of_its_value(loss):
    squared = np.array([0.01, 0.5, 1.7, 9.0, 50.0])
    slope = (loss.value(squared + 1e-6) - loss.value(squared - 1e-6)) / 2e-6
    assert_allclose(loss.weight(squared), slope, rtol=1e-6, atol=1e-9)
    assert loss.value(np.zeros(1))[0] == pytest.approx(0.0, abs=1e-15)


def distances_to(points):
    """Return the distance map of points, 4 cm around a hand at rest."""
    return distance_map(points, VERTICES.min(axis=0) - 0.04, VERTICES.max(axis=0) + 0.04)


@pytest.fixture(scope="module")
def emptiness():
    points, _ = sample_surface(SURFACE, RESTING, 4000, np.random.default_rng(3))
    return CloudEmptinessTerm(distances_to(points), MESH.bone, MESH.local)


@pytest.mark.parametrize("count", [1, 60, 40_000])
def test_distances_near_the_surface_are_exact_to_a_tenth_of_a_millimetre(count):
    """Sparse to dense clouds on a hand: at the cloud's nodes, on the surface and up to 6 mm away; further, on average."""
    rng = np.random.default_rng(1)
    cloud = sample_surface(SURFACE, RESTING, count, rng)[0] + rng.normal(0.0, 3e-4, (count, 3))
    field = distances_to(cloud)
    values = field.at_nodes()
    nodes = np.moveaxis(np.indices(values.shape), 0, -1).reshape(-1, 3) * field.spacing + field.low
    near = rng.uniform(-0.004, 0.004, (20, *VERTICES.shape)) + VERTICES
    places = np.concatenate([nodes, VERTICES, near.reshape(-1, 3), cloud])
    exact, found = cKDTree(cloud).query(places)[0], field.at(places)[0]
    off = np.abs(found - exact)
    assert off[exact < 0.006].max() < 1e-4
    assert off.mean() < 0.0005
    assert_allclose(values.ravel(), found[: len(nodes)], atol=1e-7)


def test_the_slope_of_the_distance_is_its_derivative_inside_and_beyond_the_grid(rng):
    low, high = np.full(3, -0.1), np.array([0.1, 0.12, 0.15])
    field = distance_map(rng.uniform(low, high, size=(40, 3)), low, high, spacing_m=0.01)
    for point in rng.uniform(-0.3, 0.3, size=(60, 3)):
        slope = field.at(point[None])[1]
        check_jacobian(
            lambda x: field.at(x[None])[0], slope, point, step=1e-8, rtol=1e-5, atol=1e-5
        )


@pytest.mark.parametrize("loss", LOSSES)
def test_emptiness_is_summed_as_its_rows_and_has_its_slope(rng, emptiness, loss):
    moved = HAND.bones(HAND.rest_params() + 0.05 * rng.normal(size=26))
    term = replace(emptiness, loss=loss, weight=0.3, slack_m=0.001)
    x = moved.to_world(term.bone, term.local)
    distance, n = term.distances.at(x)
    residual = np.maximum(distance - 0.001, 0.0) / 0.004
    twist = np.where(residual[:, None] > 0, motion_row(x, n / 0.004, moved.reference), 0.0)
    squared = residual**2
    cost = 0.15 * float(loss.value(squared).sum())
    weight = 0.3 * loss.weight(squared)
    plain = system_of(
        len(moved.position), cost, residual, term.bone[:, None], twist[:, None], weight
    )
    assert_same_system(term.linearize(moved), plain)
    assert term.cost(moved) == pytest.approx(plain.cost, rel=1e-12)
    few = replace(term, bone=term.bone[::5], local=term.local[::5])
    check_observation_term(few, moved, HAND.skeleton.bone_names, step=1e-8, rtol=1e-4)


def test_only_what_a_view_can_have_measured_is_asked_for():
    """A flat open hand from the front: no point of its back, none behind, none beyond an image, and both cameras of a pair must see."""
    bones = HAND.bones(HAND.params_from({}))
    mesh = surface_mesh(SURFACE, bones, 0.005)
    vertices, normals = mesh.carried(bones)
    front, side = np.array([[[0.0, 0.1, 0.5]], [[0.5, 0.1, 0.1]]])

    def seen_from(*views):
        return visible_from(vertices, normals, views)

    seen, by_side = seen_from(front), seen_from(side)
    assert (normals[seen, 2] > 0).all()
    assert seen[normals[:, 2] > 0.8].mean() > 0.9
    assert_array_equal(seen_from(np.concatenate([front, side])), seen & by_side)
    assert_array_equal(seen_from(front, side), seen | by_side)
    assert seen_from().all()
    matrix = camera_matrix(500, 500, -0.5, 200)
    halved = Camera.from_opencv(
        matrix, None, [np.pi, 0, 0], [0, 0.1, 0.5], name="half", size=(400, 400)
    )
    assert_array_equal(seen_from((halved,)), seen & (vertices[:, 0] > 0))
    # the thumb's side towards x is hidden from the other side by the palm: little of it may be asked for
    thumb = np.isin(mesh.bone, [HAND.skeleton.bone(f"thumb_{b}") for b in ("proximal", "distal")])
    facing = normals[:, 0] > 0.5
    assert by_side[thumb & facing].mean() < 0.5 < by_side[~thumb & facing].mean()


def test_rays_cost_what_the_plain_form_says_and_have_its_slope(rng):
    """Points on the hand, each off along its ray; a third of them beside it as well."""
    centre = np.array([0.02, 0.05, 0.6])
    points = sample_surface(SURFACE, RESTING, 300, rng)[0]
    points = centre + (points - centre) * rng.uniform(0.93, 1.07, size=(300, 1))
    points[::3] += rng.normal(scale=0.008, size=points[::3].shape)
    term = CloudRaysTerm(points, centre, SURFACE, along_m=0.02, weight=0.7)
    assert term.cost(RESTING) == pytest.approx(0.7 * ray_costs(term, RESTING).sum(), rel=1e-10)
    moved = HAND.bones(HAND.rest_params() + 0.03)
    check_observation_term(term, moved, HAND.skeleton.bone_names, step=1e-8, rtol=1e-4)
