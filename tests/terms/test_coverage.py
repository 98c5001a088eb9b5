"""The coverage ramp by moments equals the dense form; its band, its two shapes, and its bias."""

from dataclasses import replace

import numpy as np
import pytest

from handtrack.geometry.camera import Camera
from handtrack.model.flesh import Ellipsoids
from handtrack.model.kinematics import BonePoses
from handtrack.observation.observation import Silhouette
from handtrack.terms.silhouettes.coverage import CoverageTerm
from tests.terms.conic_field_reference import dense_field
from tests.terms.silhouette_scene import (
    assert_same_system,
    bones_of,
    ellipsoids_of,
    moved_along,
    silhouettes_of,
)


@pytest.mark.parametrize("antisymmetric", [True, False])
@pytest.mark.parametrize(("seed", "band_px"), [(0, 0.5), (1, 2.0), (2, 6.0)])
def test_moments_equal_the_dense_jacobian(seed, band_px, antisymmetric):
    rng = np.random.default_rng(seed)
    bones, flesh, seen = bones_of(rng), ellipsoids_of(rng), silhouettes_of(rng)
    start = moved_along(bones, 0.01 * rng.normal(size=30))
    term = CoverageTerm(seen, flesh, band_px, start, antisymmetric, weight=0.3)
    dense = dense_field(seen, flesh, bones, term.shape.levels, clamp=True).system(0.3)
    assert_same_system(term.linearize(bones), dense)
    assert term.cost(bones) == pytest.approx(dense.cost, rel=1e-12)


@pytest.mark.parametrize("step", [1, 3])
@pytest.mark.parametrize("antisymmetric", [True, False])
def test_what_nobody_knows_counts_for_nothing(rng, antisymmetric, step):
    """As if those pixels were not observed, which the dense form leaves out one by one."""
    bones, flesh, seen = bones_of(rng), ellipsoids_of(rng), silhouettes_of(rng, unknown=True)
    steps = (step,) * len(seen)
    term = CoverageTerm(seen, flesh, 4.0, bones, antisymmetric, weight=0.3, row_steps=steps)
    rows = [replace(s, valid=s.valid * (np.arange(72) % step == step // 2)[:, None]) for s in seen]
    dense = dense_field(rows, flesh, bones, term.shape.levels, clamp=True).system(0.3 * step)
    assert_same_system(term.linearize(bones), dense)
    assert term.cost(bones) == pytest.approx(dense.cost, rel=1e-12)
    as_background = [replace(s, mask=np.maximum(s.mask, 0)) for s in seen]
    other = CoverageTerm(
        as_background, flesh, 4.0, bones, antisymmetric, weight=0.3, row_steps=steps
    )
    assert other.cost(bones) > 1.01 * term.cost(bones)


@pytest.mark.parametrize("antisymmetric", [True, False])
def test_tiny_huge_and_cut_ellipses_equal_the_dense_jacobian(rng, antisymmetric):
    bones, seen = bones_of(rng), silhouettes_of(rng, 4, distance=0.8)
    flesh = ellipsoids_of(rng, 12, radii=(0.0005, 0.004)), ellipsoids_of(rng, 6, radii=(0.15, 0.4))
    for part in flesh:
        term = CoverageTerm(seen, part, 2.0, bones, antisymmetric)
        dense = dense_field(seen, part, bones, term.shape.levels, clamp=True).system()
        assert_same_system(term.linearize(bones), dense)


@pytest.mark.parametrize(("antisymmetric", "expected"), [(True, 0.0), (False, 6.0**2 / 60.0)])
def test_a_finger_seen_from_one_side_is_placed_without_bias_by_the_antisymmetric_form(
    antisymmetric, expected
):
    """The wide form is −½ − α/4 at the outline: one edge alone comes to lie w²/2R off."""
    band, radius, far = 6.0, 30.0, 20.0
    camera = Camera(
        "c", (121, 41), np.array([[1000.0, 0, 0.3], [0, 1000.0, 20], [0, 0, 1]]), np.zeros(5), np.eye(3), np.zeros(3)
    )  # fmt: skip
    u = np.arange(121.0)
    mask = np.tile(np.clip(radius - (u - 0.3) + 0.5, 0, 1), (41, 1)).astype(np.float32)
    silhouette = Silhouette(camera, mask, np.tile(np.array([0, 121], np.int32), (41, 1)))
    radii = np.array([[radius, 10 * radius, radius]]) * far / 1000.0
    flesh = Ellipsoids(("finger",), np.zeros(1, int), np.zeros((1, 3)), np.eye(3)[None], radii)

    def at(shift_px):
        place = np.array([[shift_px * far / 1000.0, 0, far]])
        return BonePoses(place[0], np.eye(3)[None], place)

    term = CoverageTerm([silhouette], flesh, band, at(0.0), antisymmetric)
    shifts = np.linspace(-2, 2, 81)
    best = shifts[np.argmin([term.cost(at(s)) for s in shifts])]
    assert abs(best) == pytest.approx(expected, abs=0.1)
