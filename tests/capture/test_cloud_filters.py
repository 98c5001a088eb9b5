"""Filters of point clouds: each by hand-made points, and their chain."""

from dataclasses import replace

import numpy as np
import pytest

from handtrack.capture.clouds import cloud_filters as filters
from handtrack.capture.clouds.cloud_filters import CloudFilters
from handtrack.capture.clouds.point_cloud import PointCloud
from handtrack.capture.clouds.skin_ellipse import fit_skin_ellipse
from handtrack.errors import HandtrackError

EYE = np.zeros((1, 3))


def patch(rng: np.random.Generator, centre, count=2000, side=0.1):
    """A square of points facing the camera."""
    flat = rng.uniform(-side / 2, side / 2, (count, 2))
    return np.column_stack([flat, rng.normal(0, 1e-4, count)]) + np.array(centre)


def test_finite_and_range():
    points = np.array([[0, 0, 0.05], [0, 0, 0.5], [0, 0, 2.0], [np.nan, 0, 1]])
    assert filters.finite(points).tolist() == [True, True, True, False]
    keep = filters.within_range(points[:3], EYE, 0.1, 1.5)
    assert keep.tolist() == [False, True, False]
    second = np.array([[0, 0, 0], [0, 0, 3.0]])
    assert filters.within_range(points[:3], second, 0.1, 1.5).tolist() == [False, True, True]


def test_crop_to_the_previous_hand(rng):
    points = rng.uniform(-1, 1, (250_000, 3))
    calls = []

    def distance(part):
        calls.append(len(part))
        return np.linalg.norm(part, axis=1)

    keep = filters.near_hand(points, distance, 0.1)
    assert np.array_equal(keep, np.linalg.norm(points, axis=1) <= 0.1)
    assert max(calls) <= 100_000  # bounded memory, whatever the distance costs
    assert filters.near_hand(points[:0], distance, 0.1).shape == (0,)


def test_thinning_keeps_a_fixed_number_per_cell_and_is_the_same_each_time(rng):
    points = rng.uniform(0, 0.1, (20_000, 3))
    cell = filters.cell_numbers(points, 0.02)
    for count in (1, 3):
        keep = filters.thinned(points, 0.02, count)
        assert np.array_equal(keep, filters.thinned(points, 0.02, count))
        _, left = np.unique(cell[keep], return_counts=True)
        assert len(left) == len(np.unique(cell))
        assert (left == count).all()


def test_outliers_stand_off(rng):
    points = np.vstack([patch(rng, (0, 0, 0.5)), [[0, 0, 0.55], [0.2, 0, 0.5]]])
    keep = filters.inliers(points, 8, 2.5)
    assert not keep[-2:].any()
    assert keep[:-2].mean() > 0.97
    assert filters.inliers(points[:5], 8, 2.5).all()


def test_the_nearest_and_the_largest_part(rng):
    hand, body = patch(rng, (0, 0, 0.5), 1500), patch(rng, (0.1, 0, 0.9), 20_000, 0.5)
    stray = np.array([[0, 0, 0.2], [0.3, 0, 0.3]])
    points = np.vstack([hand, body, stray])
    near = filters.nearest_part(points, EYE)
    assert near[:1500].all()
    assert not near[1500:].any()
    large = filters.largest_part(points)
    assert large[1500:21_500].all()
    assert not large[:1500].any()


def test_an_object_before_a_hand_that_is_known_is_not_taken_for_it(rng):
    """Both stay, what is behind does not: the object tells what it hides."""
    parts = ((0, 0, 0.42), 800), ((0, 0, 0.5), 1500), ((0.1, 0, 0.9), 5000)
    points = np.vstack([patch(rng, middle, count) for middle, count in parts])

    def away(asked):
        return np.abs(asked[:, 2] - 0.5)

    for front in (None, 0.1):
        near = filters.nearest_part(points, EYE, front, hand_distance=away)
        assert near[:2300].all()
        assert not near[2300:].any()


def test_a_hand_is_cut_from_the_body_it_hangs_on(rng):
    arm = np.column_stack([rng.uniform(-0.03, 0.03, (20_000, 2)), np.linspace(0.5, 0.9, 20_000)])
    points = np.vstack([patch(rng, (0, 0, 0.5), 2000), arm, patch(rng, (0, 0, 0.9), 50_000, 0.5)])
    assert filters.nearest_part(points, EYE).all()
    keep = filters.nearest_part(points, EYE, front_m=0.12)
    assert keep[:2000].all()
    assert points[keep, 2].max() == pytest.approx(0.62, abs=0.01)


def test_skin_ellipse_from_samples_with_size_as_threshold(rng):
    tone = np.clip(rng.normal((190, 140, 115), 6, (500, 3)), 0, 255)
    shade = np.linspace(0.4, 1.0, 500)[:, None]  # brightness drops out
    background = rng.normal((60, 90, 200), 5, (60, 3))
    ellipse = fit_skin_ellipse(np.vstack([tone * shade, background]).astype(np.uint8), size=3.0)
    skin = (tone * 0.7).astype(np.uint8)
    assert filters.skin_coloured(skin, 500, ellipse).mean() > 0.95
    assert not filters.skin_coloured(background.astype(np.uint8), 60, ellipse).any()
    tight = filters.skin_coloured(skin, 500, replace(ellipse, size=0.5)).mean()
    assert tight < 0.4
    assert not filters.skin_coloured(np.zeros((2, 3), np.uint8), 2, ellipse).any()
    assert filters.skin_coloured(None, 4, ellipse).all()
    with pytest.raises(
        HandtrackError, match="at least 20 sampled pixels that are not black; found 3"
    ):
        fit_skin_ellipse(tone[:3].astype(np.uint8))


def test_the_chain_reports_every_step(rng):
    cloud = PointCloud(np.vstack([patch(rng, (0, 0, 0.5), 30_000), patch(rng, (0, 0, 3.0))]))
    chain = CloudFilters(component="nearest", max_points=500)
    left, reports = chain.apply(cloud, lambda p: np.abs(p[:, 2] - 0.5), EYE)
    assert [r.name for r in reports] == ["range", "crop", "component", "voxel", "outliers", "most"]
    assert reports[0].before == 32_000
    assert reports[0].after == 30_000
    assert str(reports[0]) == "0.1 to 1.5 m from a camera: 32000 → 30000 points"
    assert [r.before for r in reports[1:]] == [r.after for r in reports[:-1]]
    assert len(left) == reports[-1].after == 500
    again, _ = chain.apply(cloud, lambda p: np.abs(p[:, 2] - 0.5), EYE)
    assert np.array_equal(left.points, again.points)
