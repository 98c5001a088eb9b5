"""Colours that contradict what is known are found; where nothing is known nothing is said."""

import numpy as np
import pytest

from handtrack.terms.images.carried_texture import Texture, contradicts
from tests.terms.silhouette_scene import camera_of


@pytest.fixture
def known(rng):
    """Return a grid of points 4 mm apart on two bones that lie in each other, red and blue."""
    grid = np.stack(np.meshgrid(*2 * [np.arange(10) * 0.004], [0.0]), axis=-1).reshape(-1, 3)
    bone = np.repeat([0, 1], len(grid))
    color = np.where(bone[:, None] == 0, [30.0, 30.0, 200.0], [200.0, 30.0, 30.0])
    return Texture(camera_of(rng), bone, np.concatenate([grid, grid]), color)


def test_only_other_colours_on_known_places_contradict(rng, known):
    moved = known.local + rng.uniform(-0.001, 0.001, known.local.shape)
    color = known.color + rng.normal(scale=5.0, size=known.color.shape)
    slipped = np.arange(len(color)) % 7 == 0
    color[slipped] = 120.0
    texture = Texture(known.camera, known.bone, moved, color)
    np.testing.assert_array_equal(contradicts(texture, known, 0.004, 60.0), slipped)
    assert not contradicts(texture, known, 0.004, 500.0).any()


def test_other_bones_and_far_points_know_nothing(known):
    elsewhere = Texture(known.camera, known.bone + 2, known.local, 255.0 - known.color)
    assert not contradicts(elsewhere, known, 0.004, 60.0).any()
    behind = Texture(known.camera, known.bone, known.local + [0, 0, 0.02], 255.0 - known.color)
    assert not contradicts(behind, known, 0.004, 60.0).any()
    assert contradicts(behind, known, 0.03, 60.0).all()
    nothing = known.subset(np.zeros(len(known.bone), bool))
    assert contradicts(nothing, known, 0.004, 60.0).shape == (0,)
    assert not contradicts(known, nothing, 0.004, 60.0).any()
