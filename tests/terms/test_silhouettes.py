"""Silhouettes: the conic field and the coverage ramp by moments against dense forms, and overlap."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from handtrack import Silhouette
from handtrack.terms.silhouettes import ConicFieldTerm, CoverageTerm, clip_spans, outline_overlap
from tests.cameras import pinhole
from tests.terms.conic_field_reference import dense_field
from tests.terms.silhouette_scene import (
    assert_same_system,
    bones_of,
    ellipsoids_of,
    moved_along,
    parts_at,
    silhouettes_of,
)


@pytest.mark.parametrize("kind", [True, False])
@pytest.mark.parametrize(
    ("radii", "distance", "band_px"),
    [((0.006, 0.025), 0.5, 0.5), ((0.006, 0.025), 0.5, 6.0), ((0.0005, 0.004), 0.8, 2.0), ((0.15, 0.4), 0.8, 2.0)],
    ids=["steep", "wide", "tiny", "huge and cut"],
)  # fmt: skip
def test_moments_equal_the_dense_jacobian(rng, radii, distance, band_px, kind):
    bones, seen = bones_of(rng), silhouettes_of(rng, 4, distance=distance)
    flesh, start = ellipsoids_of(rng, 12, radii), moved_along(bones, 0.01 * rng.normal(size=30))
    field = ConicFieldTerm(seen, flesh, weight=1.7, normalised=kind)
    dense = dense_field(seen, flesh, bones, depth_scaled=not kind).system(1.7)
    assert_same_system(field.linearize(bones), dense)
    term = CoverageTerm(seen, flesh, band_px, start, antisymmetric=kind, weight=0.3)
    dense = dense_field(seen, flesh, bones, [f.levels for f in term.fields], clamp=True).system(0.3)
    assert_same_system(term.linearize(bones), dense)
    assert term.cost(bones) == pytest.approx(dense.cost, rel=1e-12)


def test_ellipsoids_behind_around_and_beside_the_camera_are_skipped(rng):
    bones, flesh, seen = bones_of(rng), ellipsoids_of(rng), silhouettes_of(rng, full=True)
    centre = seen[0].camera.centre
    back = -seen[0].camera.rotation[2]
    places = np.stack(
        [centre, centre + 0.3 * back, centre - 0.01 * back, centre + 5 * seen[0].camera.rotation[0]]
    )
    bones = replace(bones, position=np.concatenate([places, bones.position[:1]]))
    flesh = replace(flesh, centre=np.zeros_like(flesh.centre))
    system = ConicFieldTerm(seen, flesh).linearize(bones)
    assert_same_system(system, dense_field(seen, flesh, bones).system())


@pytest.mark.parametrize("line", [(1, 0, -10), (0, -1, 20), (0.3, -1.1, 7), (-2, 0.7, 31), (0, 0, -1), (0, 0, 1)])  # fmt: skip
def test_spans_are_cut_where_the_line_says(rng, line):
    valid = silhouettes_of(rng, 1)[0].valid
    u, v = np.arange(96), np.arange(72)[:, None]
    seen = (u >= valid[:, :1]) & (u < valid[:, 1:]) & (line[0] * u + line[1] * v + line[2] >= 0)
    cut = clip_spans(valid, line)
    assert_array_equal((u >= cut[:, :1]) & (u < cut[:, 1:]), seen)


@pytest.mark.parametrize("unknown", [True, False])
def test_overlap_counts_pixels(rng, unknown):
    bones, flesh, seen = bones_of(rng), ellipsoids_of(rng), silhouettes_of(rng, unknown=unknown)
    seen = [replace(s, mask=np.sign(np.round(s.mask))) for s in seen]
    overlap = outline_overlap(seen, flesh, bones)
    for i, silhouette in enumerate(seen):
        dense = dense_field([silhouette], flesh, bones)
        model, mask = dense.predicted < 0, dense.observed < 0
        assert overlap.model[i] == model.sum()
        assert overlap.mask[i] == mask.sum()
        assert overlap.both[i] == (model & mask).sum()
        assert overlap.iou[i] == pytest.approx((model & mask).sum() / (model | mask).sum())
    every_other = outline_overlap(seen, flesh, bones, row_step=2)
    assert_allclose(every_other.model, overlap.model, rtol=0.2)
    assert_allclose(every_other.iou, overlap.iou, atol=0.1)


def test_one_circle_by_hand():
    """A sphere seen along the axis: the field at the centre pixel is −1, the gradient has no sideways part."""
    valid = np.zeros((41, 2), np.int32)
    valid[20] = 20, 21
    silhouette = Silhouette(pinhole("c", (41, 41), 100), np.zeros((41, 41), np.float32), valid)
    flesh, bones = parts_at([[0.1] * 3], [[0, 0, 1.0]])
    system = ConicFieldTerm([silhouette], flesh).linearize(bones)
    assert system.cost == pytest.approx(0.5)
    assert_allclose(system.gradient, 0, atol=1e-12)


@pytest.mark.parametrize(("antisymmetric", "step"), [(True, 1), (False, 3)])
def test_what_nobody_knows_counts_for_nothing(rng, antisymmetric, step):
    """As if those pixels were not observed, which the dense form leaves out one by one."""
    bones, flesh, seen = bones_of(rng), ellipsoids_of(rng), silhouettes_of(rng, unknown=True)

    def term_of(silhouettes):
        steps = (step,) * len(seen)
        return CoverageTerm(silhouettes, flesh, 4.0, bones, antisymmetric, 0.3, row_steps=steps)

    rows = [replace(s, valid=s.valid * (np.arange(72) % step == step // 2)[:, None]) for s in seen]
    term = term_of(seen)
    dense = dense_field(rows, flesh, bones, [f.levels for f in term.fields], clamp=True).system(
        0.3 * step
    )
    assert_same_system(term.linearize(bones), dense)
    as_background = [replace(s, mask=np.maximum(s.mask, 0)) for s in seen]
    assert term_of(as_background).cost(bones) > 1.01 * term.cost(bones)
