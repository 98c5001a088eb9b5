"""Two cameras before something that moves: which frames show the same moment."""

import numpy as np
import pytest

from handtrack.capture.images.synchrony import ImageMotion, time_offsets
from handtrack.geometry.rotation import rotation_matrix
from tests.cameras import pinhole

FRAMES = 60
SIZE = (96, 72)


def camera(name, turn):
    """Looks at the origin from half a metre, turned by an angle [rad] around it."""
    rotation = rotation_matrix(np.array([0.2 * turn, turn, 0.3 * turn]))
    return pinhole(name, SIZE, 110, rotation, (0, 0, 0.5))


def pictures(seen_by, late, rng):
    """Return pictures of a few spots on smooth paths (the same for every camera), `late` frames late, with noise."""
    paths = np.random.default_rng(5)
    phase, speed = paths.uniform(0, 6, (8, 3)), paths.uniform(0.1, 0.4, (8, 3))
    frames = []
    for frame in range(FRAMES):
        time = frame - late
        spots = 0.08 * np.sin(phase + speed * time + 0.5 * np.sin(0.07 * time))
        picture = rng.normal(60.0, 1.0, SIZE[::-1])
        for column, row in seen_by.project(spots):
            v, u = np.mgrid[: SIZE[1], : SIZE[0]]
            picture += 150 * np.exp(-((u - column) ** 2 + (v - row) ** 2) / 18)
        frames.append(np.clip(picture, 0, 255).astype(np.uint8))
    return frames


@pytest.mark.parametrize("offsets", [(0, -0.4, 2.4, 0), (0,) * 5, (0, 5, 0, 0), (2, 0)])
def test_all_cameras_are_told_to_a_tenth_or_two(offsets):
    """And those that are late beside the most are sure, or of a pair the second."""
    turns = np.linspace(-1.2, 1.4, len(offsets))
    motions, half = [], FRAMES // 2
    for i, (turn, late) in enumerate(zip(turns, offsets, strict=True)):
        seen_by = camera(f"cam{i}", turn)
        frames = pictures(seen_by, late, np.random.default_rng(97 + i))
        motions.append((ImageMotion(seen_by, frames[:half]), ImageMotion(seen_by, frames[half:])))
    found = time_offsets(motions)
    apart = np.array([found[i].frames for i in range(len(offsets))]) - offsets
    assert np.abs(apart - np.median(apart)).max() <= 0.2 + 1e-9
    sure = {i for i, offset in found.items() if offset.is_sure}
    late = {i for i, offset in enumerate(offsets) if offset != np.median(offsets)}
    assert sure == late if len(offsets) > 2 else sure == {1}
