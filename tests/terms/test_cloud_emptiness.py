"""E2: the distance map, its derivatives, which surface points may be asked for, and its pull."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from handtrack.model.model_file import load_model
from handtrack.model.surfaces.metaballs import MetaballSurface
from handtrack.model.surfaces.surface_mesh import sample_surface, surface_mesh
from handtrack.terms.clouds.cloud_emptiness import CloudEmptinessTerm, seen_from
from handtrack.terms.clouds.distance_map import distance_map
from handtrack.terms.loss import geman_mcclure, huber, quadratic, uniform_outliers
from handtrack.terms.rows import Rows, motion_row
from tests.derivatives import check_jacobian, check_observation_term
from tests.terms.plain_rows import system_of

LOSSES = [quadratic(), geman_mcclure(2.0), huber(1.5), uniform_outliers(0.2, 20.0)]
BOX = np.array([-0.1, -0.1, -0.1]), np.array([0.1, 0.12, 0.15])


@pytest.fixture(scope="module")
def model():
    return load_model()


@pytest.fixture(scope="module")
def scene(model):
    rng = np.random.default_rng(3)
    surface, bones = MetaballSurface.of(model), model.bones(model.rest_params())
    points, _ = sample_surface(surface, bones, 4000, rng)
    return points, bones, surface_mesh(surface, bones, 0.006)


@pytest.mark.parametrize("count", [1, 60, 40_000])
def test_distances_near_the_surface_are_exact_to_a_tenth_of_a_millimetre(model, count):
    """Sparse to dense clouds on a hand: at the cloud's nodes, on the surface and up to 6 mm away; further, on average."""
    surface, bones = MetaballSurface.of(model), model.bones(model.rest_params())
    rng = np.random.default_rng(1)
    cloud = sample_surface(surface, bones, count, rng)[0] + rng.normal(0.0, 3e-4, (count, 3))
    mesh = surface_mesh(surface, bones, 0.006).vertices
    field = distance_map(cloud, mesh.min(axis=0) - 0.04, mesh.max(axis=0) + 0.04)
    nodes = np.moveaxis(np.indices(field.values.shape), 0, -1) * field.spacing + field.low
    near = rng.uniform(-0.004, 0.004, (20, *mesh.shape)) + mesh
    places = np.concatenate([nodes.reshape(-1, 3), mesh, near.reshape(-1, 3), cloud])
    exact = cKDTree(cloud).query(places)[0]
    off = np.abs(field.at(places)[0] - exact)
    assert off[exact < 0.006].max() < 1e-4
    assert off.mean() < 0.0005
    np.testing.assert_allclose(field.values.ravel(), field.at(nodes.reshape(-1, 3))[0], atol=1e-7)
    found, true = (
        float((d[: len(mesh)] ** 2).sum())
        for d in (field.at(mesh)[0], cKDTree(cloud).query(mesh)[0])
    )
    assert found == pytest.approx(true, rel=0.02)


def test_the_slope_of_the_distance_is_its_derivative_inside_and_beyond_the_grid(rng):
    cloud = rng.uniform(*BOX, size=(40, 3))
    field = distance_map(cloud, *BOX, spacing_m=0.01)
    for point in rng.uniform(-0.3, 0.3, size=(60, 3)):
        check_jacobian(
            lambda x: field.at(x[None])[0],
            field.at(point[None])[1],
            point,
            step=1e-8,
            rtol=1e-5,
            atol=1e-5,
        )


@pytest.mark.parametrize("loss", LOSSES)
def test_kernel_equals_rows(rng, model, scene, loss):
    points, bones, mesh = scene
    moved = model.bones(model.rest_params() + 0.05 * rng.normal(size=len(model.rest_params())))
    term = replace(CloudEmptinessTerm.at_start(points, mesh, loss=loss, weight=0.3), slack_m=0.001)
    x = moved.to_world(term.bone, term.local)
    distance, n = term.distances.at(x)
    residual = np.maximum(distance - 0.001, 0.0) / 0.004
    twist = np.where(residual[:, None] > 0, motion_row(x, n / 0.004, moved.reference), 0.0)
    squared = residual**2
    cost = 0.15 * float(loss.value(squared).sum())
    rows = Rows(residual, np.arange(len(x)), term.bone, twist, cost, 0.3 * loss.weight(squared))
    plain, system = system_of(rows, len(bones.position)), term.linearize(moved)
    assert system.cost == pytest.approx(plain.cost, rel=1e-12) == term.cost(moved)
    np.testing.assert_allclose(
        system.gradient, plain.gradient, atol=1e-9 * np.abs(plain.gradient).max()
    )
    np.testing.assert_allclose(system.hessian, plain.hessian, atol=1e-9 * plain.hessian.max())


@pytest.mark.parametrize("loss", LOSSES)
def test_derivatives_by_every_bone(rng, model, scene, loss):
    points, _, mesh = scene
    moved = model.bones(model.rest_params() + 0.05 * rng.normal(size=len(model.rest_params())))
    start = CloudEmptinessTerm.at_start(points, mesh, loss=loss)
    term = CloudEmptinessTerm(start.distances, start.bone, start.local, loss=loss)
    check_observation_term(term, moved, model.skeleton.bone_names, step=1e-8, rtol=1e-4)


def test_it_pulls_a_finger_out_of_empty_space(model):
    """Cloud of a bent index, model with a straighter one: E2's gradient bends it."""
    surface = MetaballSurface.of(model)
    bent = model.bones(model.params_from({"index_mcp_flex": 1.2}))
    straight, twist_jacobian, _ = model.linearize(model.params_from({"index_mcp_flex": 0.6}))
    points, _ = sample_surface(surface, bent, 4000, np.random.default_rng(0))
    term = CloudEmptinessTerm.at_start(points, surface_mesh(surface, straight, 0.006))
    moves = twist_jacobian.reshape(-1, twist_jacobian.shape[2])
    gradient = term.linearize(straight).pull_back(moves).gradient
    slope = gradient[model.parameter_names.index("index_mcp_flex")]
    assert slope < 0
    assert slope == gradient[6:].min()


def test_only_what_a_view_can_have_measured_is_asked_for(model):
    """A flat open hand from the front: no point of its back, none behind, and both cameras of a pair must see."""
    surface, bones = MetaballSurface.of(model), model.bones(model.params_from({}))
    mesh = surface_mesh(surface, bones, 0.005)
    front, side = np.array([[0.0, 0.1, 0.5]]), np.array([[0.5, 0.1, 0.1]])
    seen = seen_from(mesh.vertices, mesh.normals, [front])
    assert (mesh.normals[seen] @ [0, 0, 1] > 0).all()
    assert seen[mesh.normals[:, 2] > 0.8].mean() > 0.9
    both = seen_from(mesh.vertices, mesh.normals, [np.concatenate([front, side])])
    either = seen_from(mesh.vertices, mesh.normals, [front, side])
    by_side = seen_from(mesh.vertices, mesh.normals, [side])
    np.testing.assert_array_equal(both, seen & by_side)
    np.testing.assert_array_equal(either, seen | by_side)
    assert seen_from(mesh.vertices, mesh.normals, []).all()
    # the thumb's side towards x is hidden from the other side by the palm: little of it may be asked for
    thumb = np.isin(mesh.bone, [model.skeleton.bone(f"thumb_{b}") for b in ("proximal", "distal")])
    facing = mesh.normals @ [1, 0, 0] > 0.5
    assert by_side[thumb & facing].mean() < 0.5 < by_side[~thumb & facing].mean()
