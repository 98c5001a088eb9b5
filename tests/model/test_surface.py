"""The mesh lies on the solver's surface, and its vertices move with their bones."""

import numpy as np
import pytest

from handtrack.geometry.rotation import rotation_matrix
from handtrack.model.kinematics import BonePoses
from handtrack.model.model_file import load_model
from handtrack.model.surfaces.metaballs import MetaballSurface
from handtrack.model.surfaces.surface_mesh import carried_mesh, surface_mesh


@pytest.fixture(scope="module")
def model():
    return load_model()


@pytest.fixture(scope="module")
def bones(model):
    return model.bones(model.rest_params())


@pytest.fixture(scope="module")
def mesh(model, bones):
    return surface_mesh(MetaballSurface.of(model), bones)


def area(mesh):
    corner = mesh.vertices[mesh.faces]
    across = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    return 0.5 * float(np.linalg.norm(across, axis=1).sum())


def test_vertices_lie_on_the_surface(model, bones, mesh):
    d = np.abs(MetaballSurface.of(model).distance(bones, mesh.vertices))
    assert np.quantile(d, 0.99) < 1e-5
    assert d.max() < 2e-4  # at a jump of d


def test_the_mesh_is_closed_and_turned_outwards(mesh):
    edges = np.sort(mesh.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    _, counts = np.unique(edges, axis=0, return_counts=True)
    assert (counts == 2).all()
    corner = mesh.vertices[mesh.faces]
    across = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    volume = float((corner[:, 0] * across).sum()) / 6.0
    assert 1.5e-4 < volume < 6e-4  # a hand without its wrist displaces 0.2 to 0.5 litres
    assert ((across * mesh.normals[mesh.faces[:, 0]]).sum(axis=1) > 0).mean() > 0.99


def test_the_mesh_moves_with_the_hand(model, bones, mesh):
    turn, shift = rotation_matrix(np.array([0.3, -0.5, 0.8])), np.array([0.1, 0.2, 0.7])
    moved = BonePoses(
        turn @ bones.reference + shift, turn @ bones.rotation, bones.position @ turn.T + shift
    )
    np.testing.assert_allclose(mesh.carried(moved), mesh.vertices @ turn.T + shift, atol=1e-12)
    again = surface_mesh(MetaballSurface.of(model), moved)
    assert area(again) == pytest.approx(area(mesh), rel=0.01)


def test_a_carried_mesh_is_the_surface_where_it_was_made_and_follows_the_bones(model, rng):
    surface, relaxed = MetaballSurface.of(model), model.rest_params()
    here = carried_mesh(model, model.bones(relaxed))
    np.testing.assert_allclose(here.vertices, surface_mesh(surface, model.bones(relaxed)).vertices)
    moved = relaxed.copy()
    moved[:6] += rng.normal(scale=0.5, size=6)  # the whole hand: rigid
    bones = model.bones(moved)
    there = carried_mesh(model, bones)
    assert np.abs(surface.distance(bones, there.vertices)).max() < 1e-3
    near = surface.near(bones, there.vertices).gradient
    cosine = (near * there.normals).sum(axis=1) / np.linalg.norm(near, axis=1)
    assert np.median(cosine) > 0.999
