"""Clouds of a session: from files, depth and pairs, filtered, and what is odd about them said."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from handtrack.capture.clouds.cloud_files import write_cloud
from handtrack.capture.clouds.cloud_filters import CloudFilters
from handtrack.capture.clouds.point_cloud import EMPTY, PointCloud
from handtrack.capture.clouds.skin_ellipse import SkinEllipse
from handtrack.errors import HandtrackError
from handtrack.session.doctor.examine import examine
from handtrack.session.run import TrackingRun
from handtrack.session.session import Session
from handtrack.session.session_file import CloudSettings, read_session_file, write_session_file
from handtrack_app.cli import main
from tests.session.small_session import edit, make_session


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return make_session(tmp_path)


def add(folder: Path, clouds: str, camera: str = "") -> None:
    """Append [clouds] to session.toml, and lines to its last camera."""
    path = folder / "session.toml"
    path.write_text(path.read_text() + f"{camera}\n[clouds]\n{clouds}\n")


def write_clouds(folder: Path, rng: np.random.Generator) -> None:
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
    assert session.has_clouds
    assert len(session.measured_cloud(0)) == 3000
    seen = session.observation(0).cloud
    assert 400 < len(seen.points) < 800
    assert len(session.observation(1).cloud) == 0  # seen emptiness
    assert session.observation(2).cloud is None  # not seen
    assert len(session.measured_cloud(3)) == 3001
    assert np.abs(session.observation(3).cloud.points).max() < 0.06  # the stray one is gone
    assert session.warnings == [
        f"{folder / 'c' / '003.ply'}: 1 of 3002 points are not finite numbers and are left out."
    ]
    assert [len(s.mask) for s in session.observation(0).silhouettes] == [48, 48]


def test_the_crop_needs_the_hand_of_the_frame_before(folder, rng):
    write_clouds(folder, rng)
    add(folder, 'files = "c/*"\ncrop_m = 0.02')
    session = Session.open(folder)
    near, reports = session.cloud(0, hand_distance=lambda p: np.abs(p[:, 0]))
    assert np.abs(near.points[:, 0]).max() <= 0.02
    assert reports[0].name == "crop"
    assert np.abs(session.cloud(0)[0].points[:, 0]).max() > 0.04
    every, reports = session.cloud(
        0,
        filters=CloudFilters(
            None, None, None, voxel_m=None, outlier_neighbours=None, max_points=None
        ),
    )
    assert (len(every), reports) == (3000, ())
    assert session.cloud(2) == (None, ())


def test_units_of_the_session_hold_for_clouds(folder):
    (folder / "c").mkdir()
    np.savez(folder / "c" / "0.npz", points=np.full((1, 3), 10.0))
    add(folder, 'files = "c/*.npz"')
    edit(folder / "session.toml", "fps = 10.0", "fps = 10.0\nworld_unit_m = 0.01")
    assert np.allclose(Session.open(folder).measured_cloud(0).points, 0.1)


def add_depth(folder: Path, clouds: str = 'depth = ["cam1"]') -> None:
    (folder / "depth").mkdir()
    image = np.zeros((48, 64), np.uint16)
    image[10:40, 10:50] = 5000
    for frame in (0, 1):
        cv2.imwrite(str(folder / "depth" / f"{frame}.png"), image)
    add(folder, clouds, 'depth = "depth/*.png"\ndepth_scale_m = 0.0001\n')


def test_depth_within_the_mask_and_the_region_of_interest(folder):
    add_depth(folder)
    session = Session.open(folder)
    camera = session.rig["cam1"]
    cloud = session.measured_cloud(0)
    assert len(cloud) == 30 * 30  # the mask has 30 columns of it
    assert np.allclose(camera.to_camera(cloud.points)[:, 2], 0.5)
    assert session.measured_cloud(2) is None
    edit(folder / "session.toml", 'name = "cam1"', 'name = "cam1"\nroi = [20, 20, 10, 5]')
    assert len(Session.open(folder).measured_cloud(0)) == 50


def test_the_filters_settings_come_from_session_toml(folder):
    add_depth(
        folder, 'depth = ["cam1"]\nnear_m = 0.3\nfront_m = 0.12\nper_voxel = 2\nmax_points = 70'
    )
    filters = Session.open(folder).cloud_filters
    assert (filters.near_m, filters.far_m, filters.front_m) == (0.3, 1.5, 0.12)
    assert (filters.component, filters.per_voxel, filters.max_points) == ("nearest", 2, 70)
    assert len(Session.open(folder).observation(0).cloud) == 70


def test_settings_read_back_as_written(folder, tmp_path):
    skin = SkinEllipse((0.45, 0.31), (4e-4, -1e-4, 3e-4), 2.0)
    given = {"near_m": 0.2, "skin": skin, "component": "all", "outlier_ratio": 3.0}
    settings = CloudSettings(depth=("cam1",), given=given)
    add_depth(folder)
    file = read_session_file(folder / "session.toml")
    write_session_file(
        tmp_path / "other.toml", type(file)(file.session, file.hand, file.cameras, settings)
    )
    assert read_session_file(tmp_path / "other.toml").clouds == settings


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("near_m = 2.0\nfar_m = 1.0", "far_m = 1.0; expected more than near_m = 2"),
        ('component = "first"', 'component = "first"; expected one of all, nearest, largest'),
        ('stereo_method = "bm"', "expected one of sgbm, correlation"),
        ("skin = { mean = [0.4] }", "skin: mean = .*expected 2 numbers"),
        ("skin = { mean = [0.4, 0.3], covariance = [1.0, 2.0, 1.0] }", "rr gg > rg²"),
        ("per_voxel = 0", "per_voxel = 0; expected a whole number of at least 1"),
    ],
)
def test_settings_that_cannot_be_used(line, words, folder):
    add_depth(folder, f'depth = ["cam1"]\n{line}')
    with pytest.raises(HandtrackError, match=words):
        Session.open(folder)


def test_the_doctor_looks_at_clouds(folder, rng):
    write_clouds(folder, rng)
    add(folder, 'files = "c/*"')
    texts = [f.text for f in examine(Session.open(folder)) if f.severity == "warning"]
    assert any("fewer than 300 are left in frames 1." in text for text in texts)
    assert any("not finite numbers" in text for text in texts)


def test_a_session_without_clouds_has_none(folder):
    session = Session.open(folder)
    assert not session.has_clouds
    assert session.observation(0).cloud is None
    assert session.measured_cloud(0) is None


# ---------------------------------------------------------------- recordings


def opened(data_dir: Path, name: str) -> Session:
    folder = data_dir / "sessions" / name
    if not folder.is_dir():
        pytest.skip(f"no {name} among the shared data")
    return Session.open(folder)


@pytest.mark.parametrize("name", ["webxr_depth_640", "webxr_exact_depth_768", "webxr_stereo_768"])
def test_recordings_give_some_thousand_points_on_the_hand(name, data_dir):
    session = opened(data_dir, name)
    cloud = session.observation(20).cloud
    assert 2500 <= len(cloud.points) <= 6000
    hand = session.truth.keypoints21[20]
    gap = np.linalg.norm(cloud.points[:, None] - hand, axis=-1)
    assert gap.min(axis=0).max() < 0.03  # every keypoint has points by it
    assert session.warnings == []


def test_the_same_points_from_files_as_from_depth(data_dir):
    session = opened(data_dir, "webxr_depth_640")
    file = sorted((session.folder / "clouds").glob("*.npz"))[5]
    given = np.load(file)["points"]
    from scipy.spatial import KDTree

    distance, _ = KDTree(session.measured_cloud(5).points).query(given)
    assert (distance < 1e-4).mean() > 0.97  # the others are flying


def test_the_command_writes_clouds_that_a_session_reads(data_dir, tmp_path, capsys):
    session = opened(data_dir, "webxr_stereo_768")
    out = tmp_path / "clouds"
    assert main(["stereo", str(session.folder), "--frames", "3:5", "--out", str(out)]) == 0
    assert sorted(path.name for path in out.glob("*")) == ["000003.ply", "000004.ply"]
    assert "2 clouds of 2 frames" in capsys.readouterr().out
    assert main(["stereo", str(session.folder), "--out", str(out)]) == 2
    assert "already holds .ply files" in capsys.readouterr().err


def test_the_command_needs_a_pair(folder, capsys):
    assert main(["stereo", str(folder)]) == 2
    assert "there is no pair to match" in capsys.readouterr().err
    assert not (folder / "clouds").exists()


def test_other_settings_of_clouds_are_another_run(folder, rng):
    """The run and the session before them stay as they are; what was read is not read again."""
    write_clouds(folder, rng)
    add(folder, 'files = "c/*"\nmax_points = 500')
    run = TrackingRun.open(Session.open(folder), {"model.fit_size": False})
    measured, before = run.session.measured_cloud(0), run.session.observation(0)
    other = run.with_clouds(run.session.file.clouds.with_values({"max_points": 70}))
    assert len(other.session.observation(0).cloud) == 70
    assert run.session.observation(0) is before
    assert len(before.cloud) == 500
    assert run.session.file.clouds.given == {"max_points": 500}
    assert other.session.measured_cloud(0) is measured
    assert not run.with_clouds(None).session.has_clouds
    assert run.session.has_clouds


def test_a_method_has_its_own_clouds_where_the_session_says_nothing(folder, rng):
    """2004: correlation, and neither thinned nor cleaned; taken back with the method, and kept when [clouds] is tuned."""
    write_clouds(folder, rng)
    add(folder, 'files = "c/*"')
    ours = TrackingRun.open(Session.open(folder), {"model.fit_size": False})
    paper = ours.with_values({"method": "paper2004"})
    opened = TrackingRun.open(
        Session.open(folder), {"model.fit_size": False, "method": "paper2004"}
    )
    assert len(ours.session.observation(0).cloud) < 2000
    for run in (paper, opened, paper.with_clouds(ours.session.file.clouds)):
        assert len(run.session.observation(0).cloud) == 3000
    tuned = paper.with_clouds(paper.session.file.clouds.with_values({"max_points": 70}))
    assert len(tuned.session.observation(0).cloud) == 70
    back = tuned.with_values({"method": "default"}).session.cloud_filters
    assert back == replace(ours.session.cloud_filters, max_points=70)
    pair = CloudSettings(stereo=(("cam0", "cam1"),), by_method=paper.session.file.clouds.by_method)
    assert pair.matching.method == "correlation"
    assert pair.with_values({"stereo_method": "sgbm"}).matching.method == "sgbm"


def test_what_is_usual_comes_with_the_source():
    depth = CloudSettings(depth=("cam1",), given={"voxel_m": False})
    assert depth.filters == CloudFilters(component="nearest", voxel_m=None)
    pair = depth.with_values({"stereo": (("cam0", "cam1"),), "stereo_method": "correlation"})
    assert pair.filters == CloudFilters(voxel_m=None)
    assert (pair.depth, pair.matching.method, pair.matching.window) == ((), "correlation", 11)
    assert pair.with_values({"stereo_window_px": 7}).in_force["stereo_window_px"] == 7
    assert pair.with_values({"voxel_m": None}).filters == CloudFilters()
    assert depth.given == {"voxel_m": False}


def test_the_seed_decides_which_points_stay(folder, rng):
    write_clouds(folder, rng)
    add(folder, 'files = "c/*"\nmax_points = 500')
    session = Session.open(folder)

    def points(seed: int) -> np.ndarray:
        run = TrackingRun.open(session, {"model.fit_size": False, "tracker.seed": seed})
        return run.session.observation(0).cloud.points

    first, again, other = points(1), points(1), points(2)
    np.testing.assert_array_equal(first, again)
    assert first.shape == other.shape
    assert not np.array_equal(first, other)
    run = TrackingRun.open(session, {"model.fit_size": False})
    by_change = run.with_values({"tracker.seed": 2}).session.observation(0).cloud.points
    np.testing.assert_array_equal(by_change, other)
