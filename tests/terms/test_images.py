"""Images: texture carried along, edges on the outline, the outline itself, and what is in front."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from handtrack.diagnostics.residuals import image_residuals
from handtrack.geometry.quadric import dual_conic, ellipse, shape_matrix
from handtrack.model.part_mesh import ellipsoid_mesh
from handtrack.simulation.render import render
from handtrack.terms.images import (
    CarriedTextureTerm,
    OutlineEdgesTerm,
    Texture,
    contradicts,
    depth_picture,
    outline_points,
    smooth_image,
    still_visible,
    texture_points,
)
from handtrack.terms.loss import geman_mcclure, huber, quadratic
from tests.cameras import pinhole
from tests.derivatives import KINKED, check_observation_term
from tests.experiments.scenes.textured_mesh import in_image
from tests.terms.appearance_reference import edges_system, texture_system
from tests.terms.image_scene import STEP_M, edges_seen, scene, texture_seen
from tests.terms.silhouette_scene import (
    BONES,
    assert_same_system,
    bones_of,
    camera_of,
    ellipsoids_of,
    moved_along,
    parts_at,
)


def test_the_sums_are_those_that_numpy_makes_and_the_derivatives_of_the_cost(rng):
    bones, _, mesh, views = scene(rng)
    texture, edges = texture_seen(rng, bones, mesh, views), edges_seen(bones, mesh, views)
    moved = moved_along(bones, rng.normal(scale=0.002, size=6 * BONES))
    losses = quadratic(), huber(1.5), geman_mcclure(3.0)
    terms = [(CarriedTextureTerm(texture, 12.0, loss, 0.3), texture_system) for loss in losses]
    terms += [(OutlineEdgesTerm(edges, 2.0, 0.7, way), edges_system) for way in (True, False)]
    for term, system in terms:
        assert_same_system(term.linearize(moved), system(term, moved))
        check_observation_term(term, moved, **(KINKED if system is texture_system else {}))


def test_a_window_of_an_image_is_as_the_whole(rng):
    pixels, places = (
        rng.integers(0, 255, (12, 9, 3)).astype(np.uint8),
        np.array([[2.0, 3], [7, 10]]),
    )
    part = smooth_image(pixels, 1.5, places).look_up(places)
    whole = smooth_image(pixels, 1.5, np.array([[0.0, 0.0], [8.0, 11.0]])).look_up(places)
    assert_allclose(part, whole, atol=1e-3)
    plain = smooth_image(pixels, 0.0, places).look_up(places)
    assert_allclose(plain, pixels[[3, 10], [2, 7]], atol=1e-9)


def test_hidden_points_do_not_count(rng):
    bones, _, mesh, ((camera, _),) = scene(rng, cameras=1)
    bone, local, _ = texture_points(mesh, bones, depth_picture(mesh, bones, camera), 2)
    texture = Texture(camera, bone, local, np.zeros(local.shape))
    everything = still_visible(texture, bones, depth_picture(mesh, bones, camera), STEP_M)
    assert len(everything.bone) > 0.97 * len(texture.bone)
    turned = moved_along(bones, np.tile([0, 0, 0, 0, 2.0, 0], BONES))
    picture = depth_picture(mesh, turned, camera)
    left = still_visible(texture, turned, picture, STEP_M)
    assert 0 < len(left.bone) < 0.8 * len(texture.bone)
    points = turned.to_world(left.bone, left.local)
    front = picture.at(camera.project(points))[1]
    assert (camera.to_camera(points)[:, 2] < front + STEP_M).all()


@pytest.fixture
def edges(rng):
    """Return bones, and the edges in a picture of a plain part before a plain background."""
    bones, _, mesh, ((camera, _),) = scene(rng, cameras=1, parts=1)
    face, _ = in_image(depth_picture(mesh, bones, camera))
    grey = np.where(face >= 0, 190, 50).astype(np.uint8)
    (seen,) = edges_seen(bones, mesh, [(camera, np.repeat(grey[..., None], 3, axis=2))], 8.0)
    return bones, seen


def test_edges_are_where_the_picture_changes(edges):
    _, (outline, place, strength) = edges
    best = place[:, 0][strength[:, 0] > 0]
    length = outline.length_px
    assert length[(strength > 0).any(axis=1)].sum() > 0.9 * length.sum()
    assert abs(np.median(best)) < 0.3
    assert np.percentile(np.abs(best), 80) < 1.0


def test_pieces_without_an_edge_tell_nothing_of_how_far_edges_are(edges):
    bones, seen = edges
    outline, _, strength = seen
    strength[5] = 0.0
    ((_, _, pixels, sigmas),) = image_residuals(OutlineEdgesTerm([seen], sigma_px=2.0), bones)
    there = strength.max(axis=1) > 0.0
    assert 0 < len(pixels) == there.sum() < len(there)
    assert_allclose(pixels, outline.pixel[there], atol=1e-6)
    assert np.percentile(np.abs(sigmas), 80) < 0.5


OUTLINE_STEP_M = 0.005
CAMERA = pinhole("cam", (320, 240), 600)


def balls(*places):
    """Return bones, one ball of 20 mm radius on each, at places (3,) [m]."""
    flesh, bones = parts_at(np.full((len(places), 3), 0.02), places)
    return bones, flesh


def outline(bones, flesh, around=32):
    mesh = ellipsoid_mesh(flesh, around, 3 * around // 4)
    return outline_points(mesh, bones, depth_picture(mesh, bones, CAMERA), OUTLINE_STEP_M)


def test_a_balls_outline_is_its_ellipse():
    bones, flesh = balls((0.03, -0.01, 0.5))
    found = outline(bones, flesh)
    shape = shape_matrix(flesh.posed(bones).rotation, flesh.radii)
    middle, spread = ellipse(dual_conic(CAMERA.projection, bones.position, shape))
    off = found.pixel - middle[0]
    level = np.einsum("ni,ij,nj->n", off, np.linalg.inv(spread[0]), off)
    assert_allclose(level, 1.0, atol=0.02)  # ± 0.25 px of 24
    across = off @ np.linalg.inv(spread[0])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    assert ((across * found.normal).sum(axis=1) > 0.99).all()
    around = 2 * np.pi * np.sqrt(np.linalg.eigvalsh(spread[0]).mean())
    assert found.length_px.sum() == pytest.approx(around, rel=0.02)
    assert_allclose(CAMERA.project(bones.to_world(found.bone, found.local)), found.pixel)


def test_what_is_hidden_has_no_outline_and_what_hides_has():
    bones, flesh = balls((0.0, 0.0, 0.4), (0.02, 0.0, 0.5))
    found = outline(bones, flesh)
    front, back = found.subset(found.bone == 0), found.subset(found.bone == 1)
    # whole, also before the other
    assert front.length_px.sum() == pytest.approx(2 * np.pi * 30.04, rel=0.02)
    inside = np.linalg.norm(back.pixel - CAMERA.project(bones.position[0]), axis=1) < 29.0
    assert len(back.bone) > 20
    assert not inside.any()


def test_parts_that_are_one_limb_show_no_edge_between_them():
    bones, flesh = balls((0.0, 0.0, 0.5), (0.02, 0.0, 0.5))
    found = outline(bones, flesh)
    middle = np.abs(found.pixel[:, 0] - CAMERA.project(np.array([0.01, 0.0, 0.5]))[0])
    assert (middle > 1.0).all() or np.abs(found.pixel[middle < 1.0, 1] - 119.5).min() > 18.0
    assert 0.6 < found.length_px.sum() / (4 * np.pi * 24) < 0.8  # two thirds of two circles


def test_the_outline_of_a_coarse_mesh_is_where_its_normals_turn_away():
    """Between a corner that looks to the camera and one that looks away: on their edge, nearer to whichever is nearer to turning."""
    bones, flesh = balls((0.03, -0.01, 0.5))
    found = outline(bones, flesh, around=8)
    place = bones.to_world(found.bone, found.local)
    out = place - bones.position[0]
    across = (out / np.linalg.norm(out, axis=1)[:, None] * (CAMERA.centre - place)).sum(axis=1)
    assert np.abs(across).max() / 0.5 < 0.06


def test_the_depth_is_that_of_exact_rays(rng):
    bones, flesh = bones_of(rng), ellipsoids_of(rng, 10)
    camera = camera_of(rng, (200, 160), focal=330.0)
    picture = depth_picture(ellipsoid_mesh(flesh, 32, 24), bones, camera)
    face, depth = in_image(picture)
    front, exact, _ = render(camera, flesh.posed(bones))
    both = (face >= 0) & (front >= 0)
    assert both.sum() > 1000
    assert ((face >= 0) != (front >= 0)).sum() < 0.01 * both.sum()  # along the outline
    assert np.percentile(np.abs(depth - exact)[both], 95) < 2e-4
    assert (face[both] // 1472 == front[both]).mean() > 0.97  # faces an ellipsoid
    at, outside = np.argwhere(both)[:, ::-1].astype(float), [[-5.0, 3.0], [3.0, 1e9], [np.nan, 2.0]]
    assert_array_equal(picture.at(at)[1], depth[both])
    assert (picture.at(np.array(outside))[0] == -1).all()


def test_only_other_colours_on_known_places_contradict(rng):
    """Of points 4 mm apart on two bones that lie in each other, red and blue. Of other bones, and of places further off, nothing is known."""
    grid = np.stack(np.meshgrid(*2 * [np.arange(10) * 0.004], [0.0]), axis=-1).reshape(-1, 3)
    bone = np.repeat([0, 1], len(grid))
    color = np.where(bone[:, None] == 0, [30.0, 30.0, 200.0], [200.0, 30.0, 30.0])
    known = Texture(camera_of(rng), bone, np.concatenate([grid, grid]), color)
    color = known.color + rng.normal(scale=5.0, size=known.color.shape)
    slipped = np.arange(len(color)) % 7 == 0
    color[slipped] = 120.0
    moved = known.local + rng.uniform(-0.001, 0.001, known.local.shape)
    texture = replace(known, local=moved, color=color)
    assert_array_equal(contradicts(texture, known, 0.004, 60.0), slipped)
    assert not contradicts(texture, known, 0.004, 500.0).any()
    elsewhere = replace(known, bone=known.bone + 2, color=255.0 - known.color)
    assert not contradicts(elsewhere, known, 0.004, 60.0).any()
    behind = replace(known, local=known.local + [0, 0, 0.02], color=255.0 - known.color)
    assert not contradicts(behind, known, 0.004, 60.0).any()
    assert contradicts(behind, known, 0.03, 60.0).all()
    assert not contradicts(known, known.subset(np.zeros(len(slipped), bool)), 0.004, 60.0).any()
