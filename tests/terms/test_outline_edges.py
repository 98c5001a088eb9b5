"""Edges on the outline: beside NumPy, in clutter, faint and strong."""

from dataclasses import replace

import numpy as np
import pytest

from handtrack.model.kinematics import BonePoses
from handtrack.terms.images.depth_picture import depth_picture
from handtrack.terms.images.edge_search import edges_near
from handtrack.terms.images.model_outline import outline_points
from handtrack.terms.images.outline_edges import OutlineEdgesTerm
from handtrack.terms.images.smooth_image import smooth_image
from tests.terms.appearance_reference import edges_system
from tests.terms.image_scene import STEP_M, edges_seen, scene
from tests.terms.silhouette_scene import assert_same_system, moved_along


def drawn(mesh, bones, camera, inside=190, outside=50):
    """Return a picture (H, W, 3) of the plain model before a plain background."""
    face, _ = depth_picture(mesh, bones, camera).in_image()
    grey = np.where(face >= 0, inside, outside).astype(np.uint8)
    return np.repeat(grey[..., None], 3, axis=2)


def edges_of(mesh, bones, camera, pixels, search_px=8.0):
    outline = outline_points(mesh, bones, depth_picture(mesh, bones, camera), STEP_M)
    return edges_near(outline, smooth_image(pixels, 1.0, outline.pixel, search_px + 2), search_px)


def shifted(bones, camera, px, focal=330.0, distance=0.5):
    """Return all bones moved across a camera's image, to the right by about `px` pixels."""
    step = camera.rotation.T @ np.array([px * distance / focal, 0.0, 0.0])
    return BonePoses(bones.reference + step, bones.rotation, bones.position + step)


@pytest.mark.parametrize("from_unexplained", [True, False])
def test_it_is_the_sum_that_numpy_makes(rng, from_unexplained):
    bones, _, mesh, views = scene(rng)
    seen = edges_seen(bones, mesh, views)
    term = OutlineEdgesTerm(seen, 2.0, 8.0, 0.2, 0.7, from_unexplained)
    moved = moved_along(bones, rng.normal(scale=0.002, size=6 * len(bones.position)))
    reference = edges_system(term, moved)
    assert_same_system(term.linearize(moved), reference)
    assert term.cost(moved) == pytest.approx(reference.cost)


def test_edges_are_where_the_picture_changes(rng):
    bones, _, mesh, views = scene(rng, cameras=1, parts=1)
    camera = views[0][0]
    seen = edges_of(mesh, bones, camera, drawn(mesh, bones, camera))
    best = seen.place[:, 0][seen.strength[:, 0] > 0]
    assert seen.found > 0.9
    assert abs(np.median(best)) < 0.3
    assert np.percentile(np.abs(best), 80) < 1.0


def test_a_step_moves_the_outline_to_the_edge(rng):
    """Three pixels beside it, one Gauss-Newton step of all bones together leads back."""
    bones, _, mesh, views = scene(rng, cameras=1, parts=1)
    camera = views[0][0]
    pixels = drawn(mesh, bones, camera)
    beside = shifted(bones, camera, 3.0)
    seen = edges_of(mesh, beside, camera, pixels)
    term = OutlineEdgesTerm([seen], sigma_px=3.0)
    system = term.linearize(beside)
    right = camera.rotation[0] * 0.5 / 330.0  # a pixel to the right
    together = np.tile(np.concatenate([right, np.zeros(3)]), len(bones.position))
    step = -(system.gradient @ together) / (together @ system.hessian @ together)
    assert step == pytest.approx(-3.0, abs=0.6)
    assert term.cost(shifted(beside, camera, step)) < 0.7 * term.cost(beside)


def test_clutter_far_from_the_outline_does_not_pull(rng):
    """Beside the outline's own edge another one: narrow, the far one has hardly any say."""
    bones, _, mesh, views = scene(rng, cameras=1, parts=1)
    camera = views[0][0]
    seen = edges_of(mesh, bones, camera, drawn(mesh, bones, camera))
    place, strength = np.zeros_like(seen.place), np.zeros_like(seen.strength)
    strength[:, :2], place[:, 1] = (0.5, 0.9), 6.0
    both = replace(seen, place=place, strength=strength)
    strength = strength.copy()
    strength[:, 1] = 0.0
    alone = replace(seen, place=place, strength=strength)
    narrow = [OutlineEdgesTerm([s], sigma_px=1.0).linearize(bones) for s in (both, alone)]
    wide = [OutlineEdgesTerm([s], sigma_px=8.0).linearize(bones) for s in (both, alone)]
    pull = [np.abs(s[0].gradient - s[1].gradient).max() / 6.0 for s in (narrow, wide)]
    assert pull[0] < 1e-4 * pull[1]
