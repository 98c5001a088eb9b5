"""Pictures of a textured model: covered where it is, in its colours, the room around it."""

import numpy as np

from handtrack.model.surfaces.part_mesh import ellipsoid_mesh
from handtrack.simulation.render import render_mask
from tests.experiments.scenes.textured_mesh import Pattern, cluttered_background, textured_picture
from tests.terms.silhouette_scene import BONES, bones_of, camera_of, ellipsoids_of


def test_the_model_covers_its_silhouette_and_the_room_the_rest(rng):
    bones, flesh = bones_of(rng), ellipsoids_of(rng, 10)
    camera = camera_of(rng, (200, 160), focal=330.0)
    room = cluttered_background(camera.size, rng)
    paint = Pattern.random(BONES, rng, 0.03)
    picture, share = textured_picture(camera, ellipsoid_mesh(flesh, 3), bones, paint, room)
    assert picture.shape == (160, 200, 3)
    assert picture.dtype == np.uint8
    mask = render_mask(camera, flesh.posed(bones)) > 0
    assert ((share > 0.5) != mask).sum() < 0.02 * mask.sum()
    assert ((share > 0) & (share < 1)).sum() > 50  # soft edges
    outside = share == 0
    off = np.abs(picture.astype(int) - room)[outside]
    assert np.percentile(off, 99) <= 12  # sampled finer and back: nearly the same
    assert np.abs(picture.astype(int) - room)[share == 1].mean() > 20
