"""What the real stereo hand's points are of, and the two interpolations that disparity is compared by."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from handtrack.model.model_file import load_model
from handtrack.model.surfaces.metaballs import MetaballSurface
from handtrack.model.surfaces.surface_mesh import sample_surface
from tests.experiments.clouds.real_stereo import WAYS, Scene, _seen_raw, _turned_back


def test_the_arm_is_told_from_the_hand(rng):
    """A hand, a sleeve behind its wrist, and a wall before its fingers."""
    model = load_model()
    bones = model.bones(model.rest_params())
    hand, _ = sample_surface(MetaballSurface.of(model), bones, 300, rng)
    hand = hand[((hand - bones.position[0]) @ bones.rotation[0])[:, 1] > 0.0]
    sleeve = bones.to_world(0, rng.uniform((-0.04, -0.1, -0.04), (0.04, -0.01, 0.04), (50, 3)))
    wall = bones.to_world(0, rng.uniform((-0.1, 0.02, -0.12), (0.1, 0.2, -0.11), (50, 3)))
    run = type("Run", (), {"model": model})
    scene = Scene(run, 0, np.zeros(26), range(1), {}, {0: bones})
    parts = [scene.parts(0, points) for points in (hand, sleeve, wall)]
    assert [set(part.tolist()) for part in parts] == [{0}, {1}, {2}]


def test_each_way_takes_one_thing_more_away():
    assert WAYS["as_the_paper"] == ((), {})
    assert WAYS["without_arm"][0] == (1,) and WAYS["hand_alone"][0] == (1, 2)


@pytest.mark.parametrize("along", [False, True])
def test_a_turned_picture_comes_back(along):
    v, u = np.mgrid[:80, :100]
    picture = np.stack([128 + 60 * np.sin(u / 9), 100 + v, 200 - u], axis=-1).astype(np.uint8)
    back = _turned_back(picture, 2.0, along)[8:-8, 8:-8]
    assert np.abs(back.astype(int) - picture[8:-8, 8:-8]).max() <= 2
    raw = _seen_raw(cv2.GaussianBlur(picture, (0, 0), 2.0), "level_line" if along else "bilinear")
    assert raw.shape == picture.shape
