"""The conic field by moments equals eqs. 18–29 of the 2007 paper, pixel by pixel; and its properties."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from handtrack.geometry.camera import Camera
from handtrack.model.flesh import Ellipsoids
from handtrack.model.kinematics import BonePoses
from handtrack.observation.observation import Silhouette
from handtrack.terms.silhouettes.conic_field import ConicFieldTerm
from handtrack.terms.silhouettes.outline_overlap import outline_overlap
from handtrack.terms.silhouettes.prepared_silhouette import clip_spans
from tests.terms.conic_field_reference import dense_field
from tests.terms.silhouette_scene import (
    assert_same_system,
    bones_of,
    ellipsoids_of,
    silhouettes_of,
)


@pytest.mark.parametrize("normalised", [True, False])
@pytest.mark.parametrize("seed", range(2))
def test_moments_equal_the_dense_jacobian(seed, normalised):
    rng = np.random.default_rng(seed)
    bones, flesh, seen = bones_of(rng), ellipsoids_of(rng), silhouettes_of(rng)
    ours = ConicFieldTerm(seen, flesh, weight=1.7, normalised=normalised).linearize(bones)
    dense = dense_field(seen, flesh, bones, depth_scaled=not normalised).system(1.7)
    assert_same_system(ours, dense)


def test_tiny_huge_and_cut_ellipses_equal_the_dense_jacobian(rng):
    radii = np.array(
        [[1e-3] * 3, [2e-3, 4e-3, 1e-3], [0.3, 0.2, 0.3], [0.02, 0.2, 0.02], [0.01] * 3]
    )
    flesh = Ellipsoids(
        tuple("abcde"),
        np.arange(5),
        np.zeros((5, 3)),
        Rotation.random(5, rng=rng).as_matrix(),
        radii,
    )
    position = np.array(
        [[0.01, 0, 0], [-0.03, 0.02, 0], [0, 0.1, 0.2], [0.2, 0, 0], [0.24, 0.15, 0]]
    )
    bones = BonePoses(position[0], Rotation.random(5, rng=rng).as_matrix(), position)
    seen = silhouettes_of(rng, 4, distance=0.8)
    for normalised in (True, False):
        ours = ConicFieldTerm(seen, flesh, normalised=normalised).linearize(bones)
        assert_same_system(
            ours, dense_field(seen, flesh, bones, depth_scaled=not normalised).system()
        )


def test_moving_hand_and_cameras_together_changes_nothing(rng):
    bones, flesh, seen = bones_of(rng), ellipsoids_of(rng), silhouettes_of(rng)
    turn, shift = Rotation.random(rng=rng).as_matrix(), rng.normal(size=3)

    def carried(silhouette):
        camera = silhouette.camera
        rotation = camera.rotation @ turn.T
        moved = replace(
            camera, rotation=rotation, translation=camera.translation - rotation @ shift
        )
        return replace(silhouette, camera=moved)

    there = BonePoses(
        turn @ bones.reference + shift, turn @ bones.rotation, bones.position @ turn.T + shift
    )
    here = ConicFieldTerm(seen, flesh).linearize(bones)
    other = ConicFieldTerm([carried(s) for s in seen], flesh).linearize(there)
    both = np.kron(np.eye(10), turn)
    assert other.cost == pytest.approx(here.cost, rel=1e-9)
    np.testing.assert_allclose(
        both.T @ other.gradient, here.gradient, atol=1e-8 * np.abs(here.gradient).max()
    )
    np.testing.assert_allclose(
        both.T @ other.hessian @ both, here.hessian, atol=1e-8 * np.abs(here.hessian).max()
    )


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


@pytest.mark.parametrize(
    "line",
    [
        (1, 0, -10),
        (-1, 0, 10),
        (0, 1, -20),
        (0, -1, 20),
        (0.3, -1.1, 7.0),
        (-2.0, 0.7, 31),
        (0, 0, -1),
        (0, 0, 1),
    ],
)
def test_spans_are_cut_where_the_line_says(rng, line):
    valid = silhouettes_of(rng, 1)[0].valid
    u, v = np.arange(96), np.arange(72)[:, None]
    seen = (u >= valid[:, :1]) & (u < valid[:, 1:]) & (line[0] * u + line[1] * v + line[2] >= 0)
    cut = clip_spans(valid, line)
    assert cut.dtype == np.int32
    np.testing.assert_array_equal((u >= cut[:, :1]) & (u < cut[:, 1:]), seen)


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


def test_one_circle_by_hand():
    """A sphere seen along the axis: the field at the centre pixel is −1, the gradient has no sideways part."""
    camera = Camera(
        "c",
        (41, 41),
        np.array([[100.0, 0, 20], [0, 100, 20], [0, 0, 1]]),
        np.zeros(5),
        np.eye(3),
        np.zeros(3),
    )
    valid = np.tile(np.array([20, 21], np.int32), (41, 1))
    valid[np.arange(41) != 20] = 0
    silhouette = Silhouette(camera, np.zeros((41, 41), np.float32), valid)
    flesh = Ellipsoids(
        ("ball",), np.zeros(1, int), np.zeros((1, 3)), np.eye(3)[None], np.full((1, 3), 0.1)
    )
    bones = BonePoses(np.array([0, 0, 1.0]), np.eye(3)[None], np.array([[0, 0, 1.0]]))
    system = ConicFieldTerm([silhouette], flesh).linearize(bones)
    assert system.cost == pytest.approx(0.5)
    np.testing.assert_allclose(system.gradient, 0, atol=1e-12)
