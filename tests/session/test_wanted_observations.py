"""Of a frame only what is wanted is read and computed; a cloud is cropped to the hand before it is thinned."""

from pathlib import Path

import numpy as np
import pytest

from handtrack.capture.clouds.cloud_files import write_cloud
from handtrack.capture.clouds.point_cloud import PointCloud
from handtrack.session.session import Session
from tests.session.small_session import make_session

MIDDLE = np.array([0.0, 0.0, 0.01])


@pytest.fixture
def folder(tmp_path: Path, rng: np.random.Generator) -> Path:
    """A session with masks, and clouds of a hand-sized patch before a wall with forty times its points."""
    folder = make_session(tmp_path)
    (folder / "c").mkdir()
    hand = MIDDLE + rng.uniform(-0.04, 0.04, (1000, 3)) * (1, 1, 0.05)
    wall = rng.uniform(-1.0, 1.0, (40_000, 3)) * (1, 1, 0.001) + (0, 0, 0.4)
    for frame in range(2):
        write_cloud(folder / "c" / f"{frame}.npz", PointCloud(np.vstack([wall, hand])))
    settings = folder / "session.toml"
    text = settings.read_text().replace('scale = "fit"', "scale = 1.0")
    clouds = '[clouds]\nfiles = "c/*.npz"\nmax_points = 400\noutlier_neighbours = 8\n'
    settings.write_text(f"{text}\n{clouds}")
    return folder


def to_middle(points):
    return np.linalg.norm(points - MIDDLE, axis=1) - 0.04


def test_the_crop_comes_before_the_thinning(folder):
    session = Session.open(folder)
    everything = session.observation(0).cloud
    cropped = session.observation(0, hand_distance=to_middle).cloud
    assert len(everything) == len(cropped) == 400
    assert (everything.points[:, 2] < 0.1).sum() < 60  # hardly any of the hand is left
    assert (cropped.points[:, 2] < 0.1).all()
