"""Superquadrics: their equation, their meshes, and what taper and bend do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from handtrack.errors import HandtrackError
from handtrack.model.articulated import HandScale
from handtrack.model.model_file import load_model
from handtrack.model.surfaces.model_mesh import model_mesh
from handtrack.model.surfaces.superquadrics import Superquadrics, grid_faces, read_superquadrics


def one(exponents=(1.0, 1.0), taper=(0.0, 0.0), bend=(0.0, 0.0)):
    return Superquadrics(
        ("part",),
        np.zeros(1, int),
        np.zeros((1, 3)),
        np.eye(3)[None],
        np.array([[0.05, 0.04, 0.15]]),
        np.array([exponents]),
        np.array([taper]),
        np.array([bend]),
    )


@pytest.mark.parametrize("exponents", [(1.0, 1.0), (0.3, 0.8), (1.7, 0.5), (0.6, 1.9)])
def test_points_before_deformation_satisfy_the_equation(exponents):
    part = one(exponents)
    points = part.undeformed(0, 24, 15)
    assert len(points) == 2 + 14 * 24
    np.testing.assert_allclose(part.level(0, points), 1.0, atol=1e-9)
    assert (part.level(0, 0.9 * points) < 1).all()
    assert (part.level(0, 1.1 * points) > 1).all()


def test_with_both_exponents_1_it_is_an_ellipsoid():
    part = one()
    points = part.undeformed(0, 40, 30)
    np.testing.assert_allclose(((points / part.radii[0]) ** 2).sum(axis=1), 1.0, atol=1e-12)
    mesh = part.mesh(64, 64)
    volume = trimesh.Trimesh(mesh.local, mesh.faces, process=False).volume
    assert volume == pytest.approx(4 / 3 * np.pi * np.prod(part.radii[0]), rel=0.01)


def test_small_exponents_make_a_box_and_2_a_double_cone():
    box, cone = one((0.1, 0.1)).mesh(64, 48), one((2.0, 1.0)).mesh(64, 48)
    volume = trimesh.Trimesh(box.local, box.faces, process=False).volume
    assert volume == pytest.approx(8 * 0.05 * 0.04 * 0.15, rel=0.06)
    volume = trimesh.Trimesh(cone.local, cone.faces, process=False).volume
    assert volume == pytest.approx(2 / 3 * np.pi * 0.05 * 0.04 * 0.15, rel=0.01)


def test_meshes_of_the_body_are_closed_and_turned_outwards():
    body = load_model("body34")
    parts = body.superquadrics
    assert parts is not None
    assert parts.shape.shape == (len(parts), 9)
    mesh = parts.mesh(14, 10)
    count, faces = len(mesh.bone) // len(parts), len(mesh.faces) // len(parts)
    for part in range(len(parts)):
        own = mesh.faces[part * faces : (part + 1) * faces] - part * count
        assert own.min() == 0
        assert own.max() == count - 1
        vertices = mesh.local[part * count : (part + 1) * count]
        solid = trimesh.Trimesh(vertices, own, process=False)
        assert solid.is_watertight, parts.name[part]
        assert solid.is_winding_consistent, parts.name[part]
        assert solid.volume > 0, parts.name[part]
        middle = parts.centre[part]
        outwards = (mesh.normal[part * count : (part + 1) * count] * (vertices - middle)).sum(1)
        assert (outwards > 0).mean() > 0.95, parts.name[part]


def test_taper_widens_one_end():
    part = one(taper=(0.5, -0.2))
    points = np.array([[0.02, 0.03, 0.15], [0.02, 0.03, 0.0], [0.02, 0.03, -0.15]])
    expected = [[0.03, 0.024, 0.15], [0.02, 0.03, 0.0], [0.01, 0.036, -0.15]]
    np.testing.assert_allclose(part.deformed(0, points), expected, atol=1e-12)


def test_a_bend_lays_the_axis_on_a_circle():
    """A quarter turn over a length of 0.3: radius 0.6/π; bent towards y."""
    part = one(bend=(0.5 * np.pi, 0.5 * np.pi))
    axis = np.zeros((21, 3))
    axis[:, 2] = np.linspace(-0.15, 0.15, 21)
    bent = part.deformed(0, axis)
    radius = 0.6 / np.pi
    np.testing.assert_allclose(np.hypot(bent[:, 1] - radius, bent[:, 2]), radius, atol=1e-12)
    steps = np.linalg.norm(np.diff(bent, axis=0), axis=1)
    np.testing.assert_allclose(steps, steps[0], rtol=1e-9)
    ends = bent[-1] - [0, radius, 0], bent[0] - [0, radius, 0]
    np.testing.assert_allclose(ends[0] @ ends[1], 0.0, atol=1e-12)


def test_a_vanishing_bend_is_none(rng):
    points = rng.uniform(-0.04, 0.04, (20, 3))
    np.testing.assert_allclose(one().deformed(0, points), points, atol=1e-15)
    small = one(bend=(1e-7, 0.3)).deformed(0, points)
    np.testing.assert_allclose(small, points, atol=1e-8)


def test_parts_go_with_their_bones_and_grow_with_them():
    body, tall = load_model("body34"), load_model("body34", scale=HandScale(1.0, {"thighs": 1.2}))
    mesh, larger = model_mesh(body), model_mesh(tall)
    thigh = mesh.bone == body.skeleton.bone("left_thigh")
    np.testing.assert_allclose(larger.local[thigh], 1.2 * mesh.local[thigh])
    shin = mesh.bone == body.skeleton.bone("left_shin")
    np.testing.assert_allclose(larger.local[shin], mesh.local[shin])
    bent = body.params_from({"left_elbow_flex": 1.5, "root_tx": 0.2})
    vertices, normals = mesh.carried(body.bones(bent))
    still, _ = mesh.carried(body.bones(np.zeros(34)))
    head = mesh.bone == body.skeleton.bone("head")
    np.testing.assert_allclose(vertices[head], still[head] + [0.2, 0, 0])
    arm = mesh.bone == body.skeleton.bone("left_forearm")
    assert vertices[arm][:, 2].max() > still[arm][:, 2].max() + 0.1
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-9)


def test_the_body_is_covered_as_by_its_ellipsoids():
    """Both fleshes stand for the same person: about the same height, width and volume."""
    body = load_model("body34")
    bones = body.bones(body.rest_params())
    vertices, _ = model_mesh(body).carried(bones)
    flesh = body.flesh["fine"].posed(bones)
    half = np.sqrt(((flesh.rotation * flesh.radii[:, None, :]) ** 2).sum(axis=2))
    np.testing.assert_allclose(vertices.max(axis=0), (flesh.centre + half).max(axis=0), atol=0.03)
    np.testing.assert_allclose(vertices.min(axis=0), (flesh.centre - half).min(axis=0), atol=0.03)


def test_hands_have_none_and_mistakes_are_named():
    assert load_model().superquadrics is None
    row = {"bone": "a", "centre": [0, 0, 0], "radii": [10, 50, 10]}
    assert len(read_superquadrics([row], ("a",), {"a": 1.0}, "me")) == 1
    for key, value, message in (
        ("radii", [10, 0, 10], "expected radii above 0"),
        ("exponents", [1, 3], "expected exponents above 0, up to 2"),
        ("taper", [1.5, 0], "expected tapers between -1 and 1"),
        ("bend_deg", [700, 0], "expected a bend whose circle is wider than the part"),
    ):
        with pytest.raises(HandtrackError, match=f"me, superquadric 'a_0': {message}"):
            read_superquadrics([row | {key: value}], ("a",), {"a": 1.0}, "me")
    with pytest.raises(HandtrackError, match="a mesh of 2 points around"):
        grid_faces(2, 5)


def test_the_axes_are_the_bones():
    """`radii` and `taper` are written along the bone's axes, as an ellipsoid's are."""
    row = {"bone": "a", "centre": [0, 60, 0], "radii": [10, 50, 20], "taper": [0.5, -0.5]}
    parts = read_superquadrics([row], ("a",), {"a": 2.0}, "me")
    points = parts.mesh(32, 32).local
    np.testing.assert_allclose(points[:, 1].min(), 0.02, atol=1e-9)
    np.testing.assert_allclose(points[:, 1].max(), 0.22, atol=1e-9)
    plain = read_superquadrics([row | {"taper": [0, 0]}], ("a",), {"a": 2.0}, "me").mesh(32, 32)
    np.testing.assert_allclose(np.abs(plain.local).max(axis=0), [0.02, 0.22, 0.04], atol=1e-9)
    upper = points[:, 1] > 0.14
    assert np.abs(points[upper, 0]).max() > np.abs(plain.local[upper, 0]).max()
    assert np.abs(points[upper, 2]).max() < np.abs(plain.local[upper, 2]).max()
    bent = replace(parts, bend=np.deg2rad([[60.0, 0.0]]), taper=np.zeros((1, 2)))
    assert bent.mesh(8, 8).local[-1, 2] > 0.01  # towards the bone's z


def test_a_bend_carries_whole_cross_sections_around_the_circles_centre():
    """What lies towards the centre comes nearer to it and is squeezed along the axis; what lies beyond it is stretched."""
    turn, towards, half = 0.8, 0.3, 0.15
    part = one(bend=(turn, towards))
    radius = 2.0 * half / turn
    inwards = np.array([np.cos(towards), np.sin(towards), 0.0])
    aside = np.array([-inwards[1], inwards[0], 0.0])
    for across, beside, z in ((0.03, 0.0, 0.15), (-0.03, 0.02, 0.1), (0.02, -0.01, -0.12)):
        angle = z / radius
        given = across * inwards + beside * aside + [0.0, 0.0, z]
        inner, along = radius - (radius - across) * np.cos(angle), (radius - across) * np.sin(angle)
        expected = inner * inwards + beside * aside + [0.0, 0.0, along]
        np.testing.assert_allclose(part.deformed(0, given[None])[0], expected, atol=1e-12)
