"""Exact pictures: a ball's outline by hand, depth, order, lens."""

import numpy as np
import pytest

from handtrack.diagnostics.residual_image import model_mask
from handtrack.geometry.camera import Camera
from handtrack.model.flesh import PosedEllipsoids
from handtrack.model.model_file import load_model
from handtrack.simulation.render import render_mask
from handtrack.simulation.simulate import simulated_rig

FOCAL, SIZE = 200.0, (101, 81)


def camera(lens=(0.0,) * 5):
    matrix = np.array([[FOCAL, 0, 50], [0, FOCAL, 40], [0, 0, 1.0]])
    return Camera("cam0", SIZE, matrix, np.array(lens), np.eye(3), np.zeros(3))


def balls(*centres_radii):
    count = len(centres_radii)
    centre = np.array([c for c, _ in centres_radii], dtype=float)
    radii = np.array([[r] * 3 for _, r in centres_radii], dtype=float)
    return PosedEllipsoids(np.zeros(count, int), centre, np.tile(np.eye(3), (count, 1, 1)), radii)


def test_a_ball_on_the_axis_is_a_disc_of_its_tangent_cone():
    """Radius r at distance d is seen under tan = r/√(d² − r²)."""
    mask = render_mask(camera(), balls(((0, 0, 1.0), 0.1)))
    assert mask.dtype == np.uint8
    v, u = np.mgrid[: SIZE[1], : SIZE[0]]
    reach = FOCAL * 0.1 / np.sqrt(1.0 - 0.01)
    disc = (u - 50) ** 2 + (v - 40) ** 2 < reach**2
    np.testing.assert_array_equal(mask > 0, disc)


@pytest.mark.parametrize("count", [1, 6])
def test_the_hands_mask_is_that_of_its_conics(rng, count):
    """Rays cut with ellipsoids, and ellipses filled: two ways to the same silhouette."""
    model = load_model()
    params = model.clipped(
        model.rest_params() + rng.normal(scale=0.2, size=26) * ([0.02] * 3 + [1] * 23)
    )
    params[1] -= 0.09
    flesh = model.flesh["fine"].posed(model.bones(params))
    for view in simulated_rig(count, (320, 240)).cameras:
        cut = render_mask(view, flesh) > 0
        assert cut.sum() > 2000
        assert (cut != model_mask(view, flesh)).sum() <= 1  # a pixel exactly on an outline


def test_a_lens_bends_the_picture_as_it_bends_points():
    lens = camera((-1.5, 0.5, 0.001, -0.002, 0.0))
    centre = np.array([0.17, 0.12, 1.0])
    mask = render_mask(lens, balls((centre, 0.02)))
    v, u = np.nonzero(mask)
    np.testing.assert_allclose([u.mean(), v.mean()], lens.project(centre), atol=0.3)
    plain = camera().project(centre)
    assert np.hypot(*(lens.project(centre) - plain)) > 2.0
