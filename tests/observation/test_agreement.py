"""Silhouettes of one ball agree; what one camera alone calls hand counts against it, not against those that agree."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from handtrack.geometry.camera import Camera
from handtrack.observation.agreement import outlines_off
from handtrack.observation.observation import UNKNOWN, Silhouette

SIZE = (200, 160)
BALL_M = 0.04


def ball_from(degrees: float) -> Silhouette:
    """Return a ball's silhouette by a camera around it, half a metre away."""
    matrix = np.array([[300.0, 0, 100], [0, 300, 80], [0, 0, 1]])
    turn = Rotation.from_euler("y", degrees, degrees=True).as_matrix()
    camera = Camera(f"cam{degrees}", SIZE, matrix, np.zeros(5), turn, np.array([0, 0, 0.5]))
    u, v = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    away = np.hypot(u - 100, v - 80)
    mask = (away < 300 * BALL_M / 0.5).astype(np.float32)
    mask[(away > 40) & (v > 140)] = UNKNOWN
    return Silhouette(camera, mask, np.tile(np.int32([0, SIZE[0]]), (SIZE[1], 1)))


def with_lobe(silhouette: Silhouette, value: float = 1.0) -> Silhouette:
    mask = silhouette.mask.copy()
    mask[20:56, 90:110] = value  # above the ball
    return replace(silhouette, mask=mask)


def test_one_body_agrees_with_itself():
    np.testing.assert_allclose(outlines_off([ball_from(0), ball_from(50)]), 0, atol=0.3)
    assert outlines_off([ball_from(0)]).tolist() == [0]


def test_what_two_cannot_tell_a_third_does():
    good, bad = ball_from(50), with_lobe(ball_from(0))
    added = (bad.mask > 0.5).sum() - (ball_from(0).mask > 0.5).sum()
    two = outlines_off([bad, good])
    assert two[0] == pytest.approx(two[1])
    # half of the added area by the outline's length, each: nobody knows who is wrong
    assert two[0] == pytest.approx(added / 2 / (2 * np.pi * 24 + 50), rel=0.3)
    three = outlines_off([bad, good, ball_from(-40)])
    assert three[0] == pytest.approx(two[0], rel=0.3)
    assert three[1:].max() < 0.3
