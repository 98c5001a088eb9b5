"""The carried texture: beside NumPy, found again where it moved, whatever the exposure."""

import numpy as np
import pytest

from handtrack.terms.images.carried_texture import (
    CarriedTextureTerm,
    Texture,
    still_visible,
    texture_points,
)
from handtrack.terms.images.depth_picture import depth_picture
from handtrack.terms.images.smooth_image import smooth_image
from handtrack.terms.loss import geman_mcclure, huber, quadratic
from tests.experiments.scenes.textured_mesh import Pattern, textured_picture
from tests.terms.appearance_reference import bilinear, texture_system
from tests.terms.image_scene import STEP_M, scene, texture_seen
from tests.terms.silhouette_scene import BONES, assert_same_system, moved_along
from tests.terms.test_outline_edges import shifted


def carried(mesh, bones, camera, pixels, smooth_px=1.0):
    """Return the texture as a camera sees it at `bones`."""
    bone, local, pixel = texture_points(mesh, bones, depth_picture(mesh, bones, camera), 2)
    color = smooth_image(pixels, smooth_px, pixel).look_up(pixel)[0]
    return Texture(camera, bone, local, color), pixel


@pytest.fixture
def patterned(rng):
    """Return bones, mesh, camera, and a function that draws the patterned model at other poses."""
    bones, _, mesh, views = scene(rng, cameras=1)
    camera, room = views[0]
    paint = Pattern.random(BONES, rng, 0.03)
    return bones, mesh, camera, lambda at: textured_picture(camera, mesh, at, paint, room)[0]


@pytest.mark.parametrize("loss", [quadratic(), huber(1.5), geman_mcclure(3.0)])
def test_it_is_the_sum_that_numpy_makes(rng, loss):
    bones, _, mesh, views = scene(rng)
    term = CarriedTextureTerm(texture_seen(rng, bones, mesh, views), 12.0, loss, 0.3)
    moved = moved_along(bones, rng.normal(scale=0.002, size=6 * BONES))
    reference = texture_system(term, moved)
    assert_same_system(term.linearize(moved), reference)
    assert term.cost(moved) == pytest.approx(reference.cost)


def test_images_are_looked_up_between_and_beyond_their_pixels(rng):
    pixels = rng.integers(0, 255, (12, 9, 3)).astype(np.uint8)
    corners = np.array([[2.0, 3.0], [7.0, 10.0]])
    image = smooth_image(pixels, 0.0, corners)
    assert image.corner == (2, 3)
    at = rng.uniform(-3, 14, (300, 2))
    values, slopes = image.look_up(at)
    for ours, theirs in zip(
        (values, slopes), bilinear(image.values, at - image.corner), strict=True
    ):
        np.testing.assert_allclose(ours, theirs, atol=1e-9)
    np.testing.assert_array_equal(image.values, pixels[3:11, 2:8])
    whole = smooth_image(pixels, 1.5, np.array([[0.0, 0.0], [8.0, 11.0]]))
    part = smooth_image(pixels, 1.5, corners)
    # a window changes nothing
    np.testing.assert_allclose(part.values, whole.values[3:11, 2:8], atol=1e-3)


def test_a_step_finds_the_texture_where_it_went(patterned):
    bones, mesh, camera, draw = patterned
    texture, pixel = carried(mesh, bones, camera, draw(bones), 2.0)
    now = smooth_image(draw(shifted(bones, camera, 1.5)), 2.0, pixel, 10.0)
    right = np.concatenate([camera.rotation[0] * 0.5 / 330.0, np.zeros(3)])
    together = np.tile(right, BONES)
    pose, moved = bones, 0.0
    term = CarriedTextureTerm([(texture, now)], 10.0)
    for _ in range(6):
        system = term.linearize(pose)
        step = -(system.gradient @ together) / (together @ system.hessian @ together)
        pose, moved = shifted(pose, camera, step), moved + step
    assert moved == pytest.approx(1.5, abs=0.15)
    assert term.cost(pose) < 0.2 * term.cost(bones)


def test_hidden_points_do_not_count(rng, patterned):
    bones, mesh, camera, draw = patterned
    texture, _ = carried(mesh, bones, camera, draw(bones))
    everything = still_visible(texture, bones, depth_picture(mesh, bones, camera), STEP_M)
    assert len(everything.bone) > 0.97 * len(texture.bone)
    turned = moved_along(bones, np.tile([0, 0, 0, 0, 2.0, 0], BONES))
    picture = depth_picture(mesh, turned, camera)
    left = still_visible(texture, turned, picture, STEP_M)
    assert 0 < len(left.bone) < 0.8 * len(texture.bone)
    points = turned.to_world(left.bone, left.local)
    front = picture.at(camera.project(points))[1]
    assert (camera.to_camera(points)[:, 2] < front + STEP_M).all()
