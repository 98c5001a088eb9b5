"""Exact pictures: a ball's outline by hand, depth, order, lens."""

from __future__ import annotations

import numpy as np
import pytest

from handtrack.diagnostics.residual_image import model_mask
from handtrack.geometry.camera import Camera
from handtrack.model.flesh import PosedEllipsoids
from handtrack.model.model_file import load_model
from handtrack.simulation.render import pixel_rays, render, render_mask, shade
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


def test_depth_and_normal_at_the_middle():
    front, depth, normal = render(camera(), balls(((0, 0, 1.0), 0.1)))
    assert front[40, 50] == 0
    assert depth[40, 50] == pytest.approx(0.9)
    np.testing.assert_allclose(normal[40, 50], [0, 0, -1], atol=1e-9)
    assert front[0, 0] == -1
    assert depth[0, 0] == 0.0


def test_the_nearer_ball_hides_the_farther_whatever_the_order():
    near, far = ((0, 0, 0.6), 0.05), ((0, 0, 1.0), 0.2)
    for order in ((near, far), (far, near)):
        front, depth, _ = render(camera(), balls(*order))
        assert order[front[40, 50]] is near
        assert depth[40, 50] == pytest.approx(0.55)


def test_what_lies_behind_the_camera_is_not_seen():
    assert not render_mask(camera(), balls(((0, 0, -1.0), 0.1))).any()
    assert not render_mask(camera(), balls(((0, 0, 0.05), 0.1))).any()


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


def test_rays_made_once_give_the_same(rng):
    flesh = balls(((0.02, 0.01, 0.8), 0.1))
    once = render(camera(), flesh, pixel_rays(camera()))
    for one, two in zip(once, render(camera(), flesh), strict=True):
        np.testing.assert_array_equal(one, two)


def test_shading_is_brightest_towards_the_light():
    front, _, normal = render(camera(), balls(((0, 0, 1.0), 0.15)))
    picture = shade(front, normal, np.array([[200.0, 200, 200]]), np.full((*front.shape, 3), 7.0))
    assert picture.dtype == np.uint8
    assert (picture[front < 0] == 7).all()
    assert picture[32, 42, 0] > picture[48, 58, 0]  # upper left against lower right
