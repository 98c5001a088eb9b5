"""Clouds of a session: from files, depth and pairs, filtered, and what is odd about them said."""

import numpy as np
from numpy.testing import assert_array_equal

from handtrack import PointCloud, Session, TrackingRun
from handtrack.capture.clouds.cloud_files import write_cloud
from handtrack.capture.clouds.cloud_filters import CloudFilters, HandRegion
from handtrack.capture.clouds.point_cloud import EMPTY


def add(folder, clouds):
    """Append [clouds] to session.toml."""
    path = folder / "session.toml"
    path.write_text(path.read_text() + f"\n[clouds]\n{clouds}\n")


def write_clouds(folder, rng):
    (folder / "c").mkdir()
    flat = rng.uniform(-0.05, 0.05, (3000, 3)) * (1, 1, 0.001) + (0, 0, 0.0005)
    write_cloud(folder / "c" / "000.npz", PointCloud(flat))
    write_cloud(folder / "c" / "001.npz", EMPTY)
    write_cloud(
        folder / "c" / "003.ply", PointCloud(np.vstack([flat, [[np.nan, 0, 0], [0.5, 0, 0]]]))
    )


def test_files_are_filtered_and_a_missing_one_is_no_cloud(folder, rng):
    write_clouds(folder, rng)
    add(folder, 'files = "c/*"\nvoxel_m = 0.004')
    session = Session.open(folder)
    assert len(session.measured_cloud(0)) == 3000
    seen = session.observation(0).cloud
    assert 400 < len(seen.points) < 800
    assert len(session.observation(1).cloud) == 0  # seen emptiness
    assert session.observation(2).cloud is None  # not seen
    assert len(session.measured_cloud(3)) == 3001
    assert np.abs(session.observation(3).cloud.points).max() < 0.06  # the stray one is gone
    (warning,) = session.warnings
    assert "003.ply" in warning and "1 of 3002" in warning
    assert [len(s.mask) for s in session.observation(0).silhouettes] == [48, 48]


def test_the_crop_needs_the_hand_of_the_frame_before(folder, rng):
    write_clouds(folder, rng)
    add(folder, 'files = "c/*"\ncrop_m = 0.02')
    session = Session.open(folder)
    for x in (0.0, 0.01, -0.03, 0.2):  # one part of the cloud does for the first three
        hand = HandRegion(np.array([[x, 0, 0, 0.1]]), lambda p, x=x: np.abs(p[:, 0] - x))
        near = session.cloud(0, hand)[0].points
        assert (hand.distance(near) <= 0.02).all()
        assert_array_equal(session.observation(0, hand=hand).cloud.points, near)
    assert len(near) == 0
    assert np.abs(session.cloud(0)[0].points[:, 0]).max() > 0.04
    session.cloud_filters = CloudFilters(
        None, None, None, voxel_m=None, outlier_neighbours=None, max_points=None
    )
    every, reports = session.cloud(0)
    assert (len(every), reports) == (3000, ())
    assert session.cloud(2) == (None, ())


# ---------------------------------------------------------------- recordings


def test_the_seed_decides_which_points_stay(folder, rng):
    write_clouds(folder, rng)
    add(folder, 'files = "c/*"\nmax_points = 500')
    session = Session.open(folder)

    def points(seed):
        run = TrackingRun.open(session, {"model.fit_size": False, "tracker.seed": seed})
        return run.session.observation(0).cloud.points

    other = points(2)
    assert_array_equal(points(1), points(1))
    assert not np.array_equal(points(1), other)
    run = TrackingRun.open(session, {"model.fit_size": False}).with_values({"tracker.seed": 2})
    assert_array_equal(run.session.observation(0).cloud.points, other)
