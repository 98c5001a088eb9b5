"""Superquadrics: their equation, their meshes, and what taper and bend do."""

import numpy as np
import pytest
import trimesh

from handtrack.model.model_file import load_model
from handtrack.model.surfaces.superquadrics import Superquadrics


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


def test_with_both_exponents_1_it_is_an_ellipsoid():
    part = one()
    points = part.undeformed(0, 40, 30)
    np.testing.assert_allclose(((points / part.radii[0]) ** 2).sum(axis=1), 1.0, atol=1e-12)
    mesh = part.mesh(64, 64)
    volume = trimesh.Trimesh(mesh.local, mesh.faces, process=False).volume
    assert volume == pytest.approx(4 / 3 * np.pi * np.prod(part.radii[0]), rel=0.01)


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
