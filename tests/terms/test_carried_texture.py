"""The carried texture: beside NumPy, found again where it moved, whatever the exposure."""

from __future__ import annotations

import numpy as np
import pytest

from handtrack.errors import HandtrackError
from handtrack.terms.images.carried_texture import (
    CarriedTextureTerm,
    Texture,
    exposed_as,
    still_visible,
    texture_points,
)
from handtrack.terms.images.depth_picture import depth_picture
from handtrack.terms.images.smooth_image import smooth_image
from handtrack.terms.loss import GemanMcClure, Huber, Quadratic
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


@pytest.mark.parametrize("loss", [Quadratic(), Huber(1.5), GemanMcClure(3.0)])
def test_it_is_the_sum_that_numpy_makes(rng, loss):
    bones, _, mesh, views = scene(rng)
    term = CarriedTextureTerm(texture_seen(rng, bones, mesh, views), 12.0, loss, 0.3)
    moved = moved_along(bones, rng.normal(scale=0.002, size=6 * BONES))
    reference = texture_system(term, moved)
    assert_same_system(term.linearize(moved), reference)
    assert term.cost(moved) == pytest.approx(reference.cost)


def test_counted_from_the_most_it_differs_by_a_constant(rng):
    bones, _, mesh, views = scene(rng)
    seen = texture_seen(rng, bones, mesh, views)
    plain, counted = (CarriedTextureTerm(seen, 12.0, from_unexplained=on) for on in (False, True))
    moved = moved_along(bones, rng.normal(scale=0.002, size=6 * BONES))
    most = 0.5 * 9.0 * sum(len(texture.bone) for texture, _ in seen)
    for pose in (bones, moved):
        assert plain.cost(pose) - counted.cost(pose) == pytest.approx(most)
    assert_same_system(counted.linearize(moved), texture_system(counted, moved))
    with pytest.raises(
        HandtrackError, match="only the loss GemanMcClure has a most to count from, Huber"
    ):
        CarriedTextureTerm(seen, 12.0, Huber(1.0), from_unexplained=True)


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


def test_points_of_the_surface_project_to_their_pixels(patterned):
    bones, mesh, camera, draw = patterned
    texture, pixel = carried(mesh, bones, camera, draw(bones))
    places = camera.project(bones.to_world(texture.bone, texture.local))
    np.testing.assert_allclose(places, pixel, atol=1e-9)
    spacing = np.abs(pixel[:, None] - pixel[None]).max(axis=2)
    assert spacing[spacing > 0].min() == 2


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


def test_another_exposure_changes_little(patterned):
    """Darker by half and with an offset: medians and median deviations bring the colours together."""
    bones, mesh, camera, draw = patterned
    picture = draw(bones)
    texture, pixel = carried(mesh, bones, camera, picture)
    dark = np.clip(25.0 + 0.6 * picture, 0, 255).astype(np.uint8)
    now = smooth_image(dark, 1.0, pixel)
    fitted = exposed_as(texture, bones, now)
    off = np.abs(fitted.color - now.look_up(pixel)[0])
    assert np.median(off) < 2.5
    assert np.abs(texture.color - now.look_up(pixel)[0]).mean() > 5 * off.mean()


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


def test_a_sigma_of_nothing_is_refused():
    with pytest.raises(HandtrackError, match="intensity: sigma 0 grey levels"):
        CarriedTextureTerm([], sigma=0.0)
