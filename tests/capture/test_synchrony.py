"""Two cameras before something that moves: which frames show the same moment."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from handtrack.arrays import Array
from handtrack.capture.images.synchrony import Motion, agreement, lag_of, plane_angles
from handtrack.geometry.camera import Camera
from handtrack.geometry.rotation import rotation_matrix
from handtrack.session.doctor.check_synchrony import late_cameras

FRAMES = 60
SIZE = (96, 72)


def camera(name: str, turn: float) -> Camera:
    """Looks at the origin from half a metre, turned by an angle [rad] around it."""
    matrix = np.array([[110.0, 0, 47.5], [0, 110.0, 35.5], [0, 0, 1]])
    rotation = rotation_matrix(np.array([0.2 * turn, turn, 0.3 * turn]))
    return Camera(name, SIZE, matrix, np.zeros(5), rotation, np.array([0.0, 0.0, 0.5]))


def pictures(
    seen_by: Camera, late: int, rng: np.random.Generator, moves: bool = True
) -> list[Array]:
    """Return pictures of a few spots on smooth paths (the same for every camera), `late` frames late, with noise."""
    paths = np.random.default_rng(5)
    phase, speed = paths.uniform(0, 6, (8, 3)), paths.uniform(0.1, 0.4, (8, 3))
    frames = []
    for frame in range(FRAMES):
        time = (frame - late) * moves
        spots = 0.08 * np.sin(phase + speed * time + 0.5 * np.sin(0.07 * time))
        picture = rng.normal(60.0, 1.0, SIZE[::-1])
        for column, row in seen_by.project(spots):
            v, u = np.mgrid[: SIZE[1], : SIZE[0]]
            picture += 150 * np.exp(-((u - column) ** 2 + (v - row) ** 2) / 18)
        frames.append(np.clip(picture, 0, 255).astype(np.uint8))
    return frames


def two_stretches(name: str, turn: float, late: int, moves: bool = True) -> tuple[Motion, Motion]:
    seen_by, rng = camera(name, turn), np.random.default_rng(ord(name) + abs(late))
    frames = pictures(seen_by, late, rng, moves)
    half = FRAMES // 2
    return Motion(seen_by, frames[:half]), Motion(seen_by, frames[half:])


@pytest.mark.parametrize("turn", [0.2, 0.9, 2.4], ids=["a pair", "apart", "nearly opposite"])
def test_a_point_has_one_angle_in_both_cameras(turn: float, rng: np.random.Generator) -> None:
    a, b = camera("a", 0.0), camera("b", turn)
    points = rng.uniform(-0.1, 0.1, (20, 3))
    angles = [plane_angles(one, other, one.project(points)) for one, other in ((a, b), (b, a))]
    assert np.allclose(angles[0], angles[1], atol=1e-9)
    assert np.ptp(angles[0]) > 0.1
    assert np.isnan(plane_angles(a, a, a.project(points))).all()


@pytest.mark.parametrize("turn", [0.2, 0.9, 2.4], ids=["a pair", "apart", "nearly opposite"])
@pytest.mark.parametrize("late", [-4, 0, 3])
def test_the_lag_is_found(late: int, turn: float) -> None:
    lag = lag_of(agreement(two_stretches("a", 0.0, 0), two_stretches("b", turn, late)))
    assert lag is not None
    assert lag.frames == late


def test_where_nothing_moves_nothing_is_told() -> None:
    still = [two_stretches(name, turn, 0, moves=False) for name, turn in (("a", 0.0), ("b", 0.4))]
    assert lag_of(agreement(*still)) is None
    assert late_cameras(still) == []


def test_missing_pictures_cost_nothing() -> None:
    first, second = (camera(name, turn) for name, turn in (("a", 0.0), ("b", 0.4)))
    shown = [pictures(c, late, np.random.default_rng(1)) for c, late in ((first, 0), (second, 3))]
    shown[0][10:13] = [None] * 3  # type: ignore[list-item]
    halves = [
        (Motion(c, p[:30]), Motion(c, p[30:])) for c, p in zip((first, second), shown, strict=True)
    ]
    lag = lag_of(agreement(*halves))
    assert lag is not None
    assert lag.frames == 3


def test_the_late_camera_of_several_is_named() -> None:
    turns = {"a": 0.0, "b": 0.5, "c": 1.1, "d": -0.6}
    together = [two_stretches(name, turn, 0) for name, turn in turns.items()]
    assert late_cameras(together) == []
    late = [two_stretches(name, turn, 5 * (name == "b")) for name, turn in turns.items()]
    (found,) = late_cameras(late)
    assert str(found).startswith("camera 'b' comes 5 frames late against the others")
    pair = [two_stretches("a", 0.0, 2), two_stretches("b", 0.5, 0)]
    assert str(late_cameras(pair)[0]).startswith("camera 'b' comes 2 frames early against 'a'")


def test_paths_do_not_repeat_within_the_lags_searched() -> None:
    """Otherwise the tests above could not tell a lag from another."""
    frames = pictures(camera("a", 0.0), 0, np.random.default_rng(0))
    assert all(np.abs(a.astype(float) - b).max() > 5 for a, b in pairwise(frames))
