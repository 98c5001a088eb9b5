"""Meshes of ellipsoids on bones: closed, outwards, of the right size."""

import numpy as np
import pytest

from handtrack.model.surfaces.part_mesh import ellipsoid_mesh, vertex_normals
from tests.terms.silhouette_scene import ellipsoids_of


@pytest.fixture
def flesh(rng):
    return ellipsoids_of(rng, 3)


def test_it_is_closed_and_turned_outwards(flesh):
    mesh = ellipsoid_mesh(flesh)
    assert mesh.faces.shape == (3 * 320, 3)
    edges = np.concatenate([mesh.faces[:, pair] for pair in ([0, 1], [1, 2], [2, 0])])
    there, back = {tuple(e) for e in edges}, {tuple(e[::-1]) for e in edges}
    assert there == back  # each edge is run through once either way
    assert len(there) == len(edges)
    around = vertex_normals(mesh.local, mesh.faces)
    assert ((around * mesh.normal).sum(axis=1) > 0.9).all()
    assert (mesh.bone[mesh.faces] == mesh.bone[mesh.faces[:, :1]]).all()


def test_corners_lie_just_outside_so_that_the_outline_is_right(flesh):
    mesh = ellipsoid_mesh(flesh)
    part = np.repeat(np.arange(3), len(mesh.bone) // 3)
    own = np.einsum("vji,vj->vi", flesh.rotation[part], mesh.local - flesh.centre[part])
    height = np.linalg.norm(own / flesh.radii[part], axis=1)
    np.testing.assert_allclose(height, height[0])
    assert 1.004 < height[0] < 1.012
    middle = own.reshape(3, -1, 3)[0][mesh.faces[:320]].mean(axis=1)  # of the first part's faces
    inside = np.linalg.norm(middle / flesh.radii[0], axis=1)
    assert inside.min() < 1.0 < height[0]  # the surface goes through the faces
