"""Surfaces: merged ellipsoids and superquadrics, their distances and meshes."""

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose, assert_array_equal

from handtrack import load_model
from handtrack.model.metaballs import (
    FORMS,
    SHARPNESS_PER_M,
    MetaballSurface,
    marching_cubes,
    relaxed_mesh,
    surface_mesh,
)
from handtrack.model.part_mesh import Superquadrics, ellipsoid_mesh, vertex_normals
from tests.model.metaballs_reference import merged
from tests.terms.silhouette_scene import ellipsoids_of, parts_at

HAND = load_model()


def around(rng, bones, count=2000):
    """Return points inside, on and outside the hand."""
    joints = HAND.joint_positions(bones)
    spread = rng.uniform(0.001, 0.05, size=(count, 1))
    return joints[rng.integers(len(joints), size=count)] + spread * rng.normal(size=(count, 3))


def pose(rng):
    params = HAND.rest_params() + 0.2 * rng.normal(size=26)
    return HAND.bones(HAND.clipped(params))


@pytest.mark.parametrize("form", FORMS)
def test_all_forms_are_exact_for_a_ball(rng, form):
    flesh, bones = parts_at([[0.02] * 3], np.zeros((1, 3)))
    surface = MetaballSurface(flesh, np.ones((1, 1), bool), SHARPNESS_PER_M, form)
    points = rng.normal(scale=0.03, size=(200, 3))
    distance, _, gradient = surface.near(bones, points)
    size = np.linalg.norm(points, axis=1)
    assert_allclose(distance, size - 0.02, atol=1e-15)
    assert_allclose(gradient, points / size[:, None], atol=1e-12)


@pytest.mark.parametrize("form", FORMS)
def test_kernel_equals_the_plain_form(rng, form):
    bones, surface = pose(rng), MetaballSurface.of(HAND, form=form)
    points = around(rng, bones)
    d, closest, share, n = merged(surface, bones, points)
    distance, nearest, gradient = surface.near(bones, points)
    assert_array_equal(nearest, closest)
    assert_allclose(distance, d, atol=1e-14)
    assert_allclose(gradient, np.einsum("ne,nei->ni", share, n), rtol=1e-9, atol=1e-12)
    assert_array_equal(surface.distance(bones, points), distance)


@pytest.fixture(scope="module")
def relaxed():
    """Return the hand's surface, its bones at rest, and the mesh there."""
    surface, bones = MetaballSurface.of(HAND), HAND.bones(HAND.rest_params())
    return surface, bones, surface_mesh(surface, bones)


def closed(vertices, faces):
    """Return a mesh that is closed, its faces turned one way."""
    found = trimesh.Trimesh(vertices, faces, process=False)
    assert found.is_watertight and found.is_winding_consistent
    return found


def test_the_mesh_lies_on_the_surface_closed_and_turned_outwards(relaxed):
    surface, bones, mesh = relaxed
    vertices, normals = mesh.carried(bones)
    off = np.abs(surface.distance(bones, vertices))
    assert np.quantile(off, 0.99) < 1e-5
    assert off.max() < 2e-4  # at a jump of d
    found = closed(vertices, mesh.faces)
    assert 1.5e-4 < found.volume < 6e-4  # a hand without its wrist displaces 0.2 to 0.5 litres
    assert ((found.face_normals * normals[mesh.faces[:, 0]]).sum(axis=1) > 0).mean() > 0.99


def test_a_relaxed_mesh_is_the_surface_of_the_relaxed_hand_and_follows_the_bones(relaxed, rng):
    surface, _, expected = relaxed
    mesh, moved = relaxed_mesh(HAND, SHARPNESS_PER_M, "d3"), HAND.rest_params()
    assert_allclose(mesh.local, expected.local)
    moved[:6] += rng.normal(scale=0.5, size=6)  # the whole hand: rigid
    bones = HAND.bones(moved)
    vertices, normals = mesh.carried(bones)
    assert np.abs(surface.distance(bones, vertices)).max() < 1e-3
    near = surface.near(bones, vertices)[2]
    cosine = (near * normals).sum(axis=1) / np.linalg.norm(near, axis=1)
    assert np.median(cosine) > 0.999


def test_a_sphere_has_its_area_and_volume():
    radius, middle = 20.65, 29.5  # of 60 nodes along each axis
    nodes = np.moveaxis(np.indices((60, 60, 60)), 0, -1)
    found = closed(*marching_cubes(np.linalg.norm(nodes - middle, axis=-1) - radius))
    assert found.volume == pytest.approx(4 / 3 * np.pi * radius**3, rel=2e-3)
    assert found.area == pytest.approx(4 * np.pi * radius**2, rel=1e-3)
    away = np.linalg.norm(found.vertices - middle, axis=1)
    assert np.abs(away - radius).max() < 0.06


def test_noise_gives_closed_and_consistently_turned_surfaces():
    field = np.random.default_rng(0).normal(size=(20, 20, 20))
    field[[0, -1]] = field[:, [0, -1]] = field[:, :, [0, -1]] = 1.0
    assert closed(*marching_cubes(field)).volume == pytest.approx((field < 0).sum(), rel=0.3)


def test_meshes_of_ellipsoids_are_closed_turned_outwards_and_their_faces_go_through_them(rng):
    flesh = ellipsoids_of(rng, 3)
    assert_allclose(flesh.thicker(0.01).radii, flesh.radii + 0.01)
    mesh = ellipsoid_mesh(flesh)
    assert closed(mesh.local, mesh.faces).volume > 0
    around = vertex_normals(mesh.local, mesh.faces)
    assert ((around * mesh.normal).sum(axis=1) > 0.9).all()
    part = np.repeat(np.arange(3), len(mesh.bone) // 3)
    own = np.einsum("vji,vj->vi", flesh.rotation[part], mesh.local - flesh.centre[part])
    own /= flesh.radii[part]
    height = np.linalg.norm(own, axis=1)
    assert_allclose(height, height[0])
    assert 1.004 < height[0] < 1.012
    assert np.linalg.norm(own[mesh.faces].mean(axis=1), axis=1).min() < 1.0


def superquadric(bend=(0.0, 0.0)):
    """Return one with both exponents 1 and no taper."""
    radii, even, none = np.array([[0.05, 0.04, 0.15]]), np.ones((1, 2)), np.zeros((1, 2))
    return Superquadrics(
        np.zeros(1, int), np.zeros((1, 3)), np.eye(3)[None], radii, even, none, np.array([bend])
    )  # fmt: skip


def test_a_bend_carries_whole_cross_sections_around_the_circles_centre():
    """What lies towards the centre comes nearer to it and is squeezed along the axis; what lies beyond it is stretched."""
    turn, towards, half = 0.8, 0.3, 0.15
    part = superquadric(bend=(turn, towards))
    radius = 2.0 * half / turn
    inwards = np.array([np.cos(towards), np.sin(towards), 0.0])
    aside = np.array([-inwards[1], inwards[0], 0.0])
    for across, beside, z in ((0.03, 0.0, 0.15), (-0.03, 0.02, 0.1), (0.02, -0.01, -0.12)):
        angle = z / radius
        given = across * inwards + beside * aside + [0.0, 0.0, z]
        inner, along = radius - (radius - across) * np.cos(angle), (radius - across) * np.sin(angle)
        expected = inner * inwards + beside * aside + [0.0, 0.0, along]
        assert_allclose(part.deformed(0, given[None])[0], expected, atol=1e-12)


def test_with_both_exponents_1_it_is_an_ellipsoid():
    part = superquadric()
    points = part.undeformed(0, 40, 30)
    assert_allclose(((points / part.radii[0]) ** 2).sum(axis=1), 1.0, atol=1e-12)
    mesh = part.mesh(64, 64)
    assert closed(mesh.local, mesh.faces).volume == pytest.approx(
        4 / 3 * np.pi * np.prod(part.radii[0]), rel=0.01
    )


def test_meshes_of_the_body_are_closed_and_turned_outwards():
    body = load_model("body34")
    parts = body.superquadrics
    mesh = parts.mesh(14, 10)
    places, normals, faces = (
        np.split(a, len(parts)) for a in (mesh.local, mesh.normal, mesh.faces)
    )
    for part in range(len(parts)):
        own = faces[part] - part * len(places[part])
        assert closed(places[part], own).volume > 0, part
        outwards = (normals[part] * (places[part] - parts.centre[part])).sum(axis=1)
        assert (outwards > 0).mean() > 0.95, part
