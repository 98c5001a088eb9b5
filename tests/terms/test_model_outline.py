"""Outlines: on the ellipse that a camera sees, and only where an edge can show."""

import numpy as np
import pytest

from handtrack.geometry.camera import Camera
from handtrack.geometry.quadric import dual_conic, ellipse, shape_matrix
from handtrack.model.flesh import Ellipsoids
from handtrack.model.kinematics import BonePoses
from handtrack.model.surfaces.part_mesh import ellipsoid_mesh
from handtrack.terms.images.depth_picture import depth_picture
from handtrack.terms.images.model_outline import outline_points

STEP_M = 0.005


@pytest.fixture
def camera():
    matrix = np.array([[600.0, 0, 159.5], [0, 600, 119.5], [0, 0, 1]])
    return Camera("cam", (320, 240), matrix, np.zeros(5), np.eye(3), np.zeros(3))


def balls(*places):
    """Return bones, one ball of 20 mm radius on each, at places (3,) [m]."""
    count = len(places)
    position = np.array(places, dtype=float)
    bones = BonePoses(position[0].copy(), np.tile(np.eye(3), (count, 1, 1)), position)
    flesh = Ellipsoids(
        tuple("abc"[:count]), np.arange(count), np.zeros((count, 3)), bones.rotation, np.full((count, 3), 0.02)
    )  # fmt: skip
    return bones, flesh


def outline(camera, bones, flesh):
    mesh = ellipsoid_mesh(flesh, 3)
    return outline_points(mesh, bones, depth_picture(mesh, bones, camera), STEP_M)


def test_a_balls_outline_is_its_ellipse(camera):
    bones, flesh = balls((0.03, -0.01, 0.5))
    found = outline(camera, bones, flesh)
    shape = shape_matrix(flesh.posed(bones).rotation, flesh.radii)
    middle, spread = ellipse(dual_conic(camera.projection, bones.position, shape))
    off = found.pixel - middle[0]
    level = np.einsum("ni,ij,nj->n", off, np.linalg.inv(spread[0]), off)
    np.testing.assert_allclose(level, 1.0, atol=0.02)  # ± 0.25 px of 24
    across = off @ np.linalg.inv(spread[0])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    assert ((across * found.normal).sum(axis=1) > 0.99).all()
    around = 2 * np.pi * np.sqrt(np.linalg.eigvalsh(spread[0]).mean())
    assert found.length_px.sum() == pytest.approx(around, rel=0.02)
    np.testing.assert_allclose(camera.project(bones.to_world(found.bone, found.local)), found.pixel)


def test_what_is_hidden_has_no_outline_and_what_hides_has(camera):
    bones, flesh = balls((0.0, 0.0, 0.4), (0.02, 0.0, 0.5))
    found = outline(camera, bones, flesh)
    front, back = found.subset(found.bone == 0), found.subset(found.bone == 1)
    # whole, also before the other
    assert front.length_px.sum() == pytest.approx(2 * np.pi * 30.04, rel=0.02)
    inside = np.linalg.norm(back.pixel - camera.project(bones.position[0]), axis=1) < 29.0
    assert len(back.bone) > 20
    assert not inside.any()


def test_parts_that_are_one_limb_show_no_edge_between_them(camera):
    bones, flesh = balls((0.0, 0.0, 0.5), (0.02, 0.0, 0.5))
    found = outline(camera, bones, flesh)
    middle = np.abs(found.pixel[:, 0] - camera.project(np.array([0.01, 0.0, 0.5]))[0])
    assert (middle > 1.0).all() or np.abs(found.pixel[middle < 1.0, 1] - 119.5).min() > 18.0
    assert 0.6 < found.length_px.sum() / (4 * np.pi * 24) < 0.8  # two thirds of two circles


def test_the_outline_of_a_coarse_mesh_is_where_its_normals_turn_away(camera):
    """Between a corner that looks to the camera and one that looks away: on their edge, nearer to whichever is nearer to turning."""
    bones, flesh = balls((0.03, -0.01, 0.5))
    mesh = ellipsoid_mesh(flesh, 1)
    found = outline_points(mesh, bones, depth_picture(mesh, bones, camera), STEP_M)
    place = bones.to_world(found.bone, found.local)
    out = place - bones.position[0]
    across = (out / np.linalg.norm(out, axis=1)[:, None] * (camera.centre - place)).sum(axis=1)
    assert np.abs(across).max() / 0.5 < 0.06
