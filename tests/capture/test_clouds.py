"""Clouds: files of others, filters, and depth images."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
import trimesh

from handtrack import PointCloud
from handtrack.capture.clouds import cloud_files
from handtrack.capture.clouds import cloud_filters as filters
from handtrack.capture.clouds.cloud_files import read_cloud, read_ply, write_cloud
from handtrack.capture.clouds.cloud_filters import CloudFilters, fit_skin_ellipse
from handtrack.capture.clouds.point_cloud import depth_cloud, surface_pixels
from handtrack.geometry.rotation import rotation_matrix
from tests.cameras import pinhole
from tests.conftest import refused


@pytest.fixture
def cloud(rng):
    points = rng.normal(size=(50, 3)).astype(np.float32).astype(float)
    return PointCloud(points, rng.integers(0, 256, (50, 3)).astype(np.uint8))


@pytest.mark.parametrize("suffix", [".ply", ".npz"])
def test_written_clouds_read_back(suffix, cloud, tmp_path):
    for colors in (cloud.colors, None):
        path = tmp_path / f"0{suffix}"
        write_cloud(path, PointCloud(cloud.points * 0.01, colors), 0.01)
        back, warnings = read_cloud(path, 0.01)
        assert warnings == ()
        assert np.allclose(back.points, cloud.points * 0.01, atol=1e-7)
        assert np.array_equal(back.colors, colors)


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
def test_what_trimesh_writes_is_read_and_the_other_way_round(encoding, cloud, tmp_path):
    path = tmp_path / "0.ply"
    path.write_bytes(
        trimesh.PointCloud(cloud.points, cloud.colors).export(file_type="ply", encoding=encoding)
    )
    points, colors, count = read_ply(path, 1000)
    assert count == 50
    assert np.allclose(points, cloud.points, atol=1e-5)
    assert np.array_equal(colors, cloud.colors)
    write_cloud(path, cloud)
    assert np.allclose(trimesh.load(path).vertices, cloud.points, atol=1e-6)


@pytest.mark.parametrize("suffix", [".ply", ".npz"])
def test_huge_clouds_are_read_in_part(suffix, tmp_path, monkeypatch, rng):
    monkeypatch.setattr(cloud_files, "MOST_POINTS", 1000)
    write_cloud(tmp_path / f"0{suffix}", PointCloud(rng.uniform(size=(25_000, 3))))
    back, warnings = read_cloud(tmp_path / f"0{suffix}")
    assert len(back) == 1000
    assert "25000" in warnings[0]
    assert np.array_equal(back.points, read_cloud(tmp_path / f"0{suffix}")[0].points)


PLY = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nend_header\n"


def named(old, new):
    return PLY.replace(old, new).encode()


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("0.ply", b"no", "not a .ply file"),
        ("0.ply", (PLY + "1 2 3\n").encode(), "2 points.* 1;.* cut off"),
        ("0.ply", (PLY + "1 2 3\n1 b 3\n").encode(), "the points cannot be read"),
        ("0.ply", named("float z", "float w"), "no x, y, z; .*: x, y, w"),
        ("0.ply", named("ascii", "xml"), "no known format"),
        ("0.ply", named("vertex", "face"), "expected the vertices first"),
        ("0.ply", named("vertex 2", "vertex 99999999999999999999999"), "99999999999999999999999 points"),
        ("0.ply", named("float y", "float y\nproperty float x"), "twice: x, y, x, z"),
        ("0.ply", (PLY + "1,2,3\n1,2,3\n").encode(), "numbers with spaces"),
        ("0.npz", b"no", "not a readable .npz"),
        ("0.npz", {"xyz": np.zeros((2, 3))}, "no array `points`.*: xyz"),
        ("0.npz", {"points": np.zeros((2, 4))}, r"`points` .*\(2, 4\)"),
        ("0.npz", {"points": np.zeros((2, 3)), "colors": np.zeros((1, 3))}, r"`colors` .*\(1, 3\)"),
        ("0.xyz", b"", "neither .ply nor .npz"),
    ],
)  # fmt: skip
def test_files_that_cannot_be_used(name, content, words, tmp_path):
    if isinstance(content, dict):
        np.savez(tmp_path / name, **content)
    else:
        (tmp_path / name).write_bytes(content)
    refused(words, read_cloud, tmp_path / name)


def test_colours_may_be_shares(tmp_path):
    np.savez(tmp_path / "0.npz", points=np.zeros((2, 3)), colors=np.full((2, 3), 0.5))
    assert (read_cloud(tmp_path / "0.npz")[0].colors == 127).all()


EYE = np.zeros((1, 3))


def test_what_any_camera_has_in_range_stays():
    points, second = np.array([[0, 0, 0.05], [0, 0, 0.5], [0, 0, 2.0]]), [[0, 0, 0], [0, 0, 3.0]]
    assert filters.within_range(points, EYE, 0.1, 1.5).tolist() == [False, True, False]
    assert filters.within_range(points, np.array(second), 0.1, 1.5).tolist() == [False, True, True]


AT_HALF = filters.HandRegion(np.array([[0, 0, 0, 9]]), lambda p: np.abs(p[:, 2] - 0.5))


def patch(rng, centre, count=2000, side=0.1):
    """A square of points facing the camera."""
    flat = rng.uniform(-side / 2, side / 2, (count, 2))
    return np.column_stack([flat, rng.normal(0, 1e-4, count)]) + np.array(centre)


def test_thinning_keeps_a_fixed_number_per_cell_whatever_is_in_others(rng):
    points = rng.uniform(0, 0.1, (20_000, 3))
    cell = filters.cell_numbers(points, 0.02)
    for count in (1, 3):
        keep = filters.thinned(points, 0.02, count)
        part = points[:, 0] < 0.06
        assert np.array_equal(keep[part], filters.thinned(points[part], 0.02, count))
        _, left = np.unique(cell[keep], return_counts=True)
        assert len(left) == len(np.unique(cell))
        assert (left == count).all()


def test_the_nearest_and_the_largest_part(rng):
    hand, body = patch(rng, (0, 0, 0.5), 1500), patch(rng, (0.1, 0, 0.9), 20_000, 0.5)
    stray = np.array([[0, 0, 0.2], [0.3, 0, 0.3]])
    points = np.vstack([hand, body, stray])
    near = filters.nearest_part(points, EYE)
    assert np.flatnonzero(near).tolist() == list(range(1500))
    large = filters.largest_part(points)
    assert np.flatnonzero(large).tolist() == list(range(1500, 21_500))


def test_an_object_before_a_hand_that_is_known_is_not_taken_for_it(rng):
    """Both stay, what is behind does not: the object tells what it hides."""
    parts = ((0, 0, 0.42), 800), ((0, 0, 0.5), 1500), ((0.1, 0, 0.9), 5000)
    points = np.vstack([patch(rng, middle, count) for middle, count in parts])

    for front in (None, 0.1):
        near = filters.nearest_part(points, EYE, front, AT_HALF)
        assert np.flatnonzero(near).tolist() == list(range(2300))


def test_a_hand_is_cut_from_the_body_it_hangs_on(rng):
    arm = np.column_stack([rng.uniform(-0.03, 0.03, (20_000, 2)), np.linspace(0.5, 0.9, 20_000)])
    points = np.vstack([patch(rng, (0, 0, 0.5), 2000), arm, patch(rng, (0, 0, 0.9), 50_000, 0.5)])
    assert filters.nearest_part(points, EYE).all()
    keep = filters.nearest_part(points, EYE, front_m=0.12)
    assert keep[:2000].all()
    assert points[keep, 2].max() == pytest.approx(0.62, abs=0.01)


def test_skin_ellipse_from_samples_with_size_as_threshold(rng):
    tone = np.clip(rng.normal((190, 140, 115), 6, (500, 3)), 0, 255)
    shade = np.linspace(0.4, 1.0, 500)[:, None]  # brightness drops out
    background = rng.normal((60, 90, 200), 5, (60, 3)).astype(np.uint8)
    ellipse = fit_skin_ellipse(np.vstack([tone * shade, background]).astype(np.uint8), size=3.0)

    def share(colors, chosen=ellipse):
        return filters.skin_coloured(PointCloud(0.0 * colors, colors), chosen).mean()

    skin = (tone * 0.7).astype(np.uint8)
    assert share(skin) > 0.95
    assert share(background) == share(np.zeros((2, 3), np.uint8)) == 0.0
    assert share(skin, replace(ellipse, size=0.5)) < 0.4
    assert filters.skin_coloured(PointCloud(np.zeros((4, 3))), ellipse).all()
    refused("20 .* 3", fit_skin_ellipse, skin[:3])


def test_the_chain_reports_every_step(rng):
    cloud = PointCloud(np.vstack([patch(rng, (0, 0, 0.5), 30_000), patch(rng, (0, 0, 3.0))]))
    chain = CloudFilters(component="nearest", max_points=500)
    left, reports = chain.apply(cloud, AT_HALF, EYE)
    named = " ".join(r.name for r in reports)
    assert named == "range crop component voxel outliers most"
    assert (reports[0].before, reports[0].after) == (32_000, 30_000)
    assert [r.before for r in reports[1:]] == [r.after for r in reports[:-1]]
    assert len(left) == reports[-1].after == 500


def camera(distortions=(0, 0, 0, 0, 0)):
    rotation = rotation_matrix(np.array([0.3, -0.2, 0.1]))
    return pinhole("kinect", (160, 120), (300, 310), rotation, (0.1, 0.2, 0.3), distortions)


@pytest.mark.parametrize("distortions", [(0, 0, 0, 0, 0), (-0.3, 0.1, 0.002, -0.001, 0.0)])
def test_points_project_back_to_their_pixels(distortions):
    seen = camera(distortions)
    depth = np.full((120, 160), 0.5)
    depth[:, :40] = 0
    depth[0, 40:43] = -1, np.nan, np.inf  # no measurements
    cloud = depth_cloud(seen, depth, np.ones_like(depth), support=0)
    assert len(cloud) == 120 * 120 - 3
    assert np.allclose(seen.to_camera(cloud.points)[:, 2], 0.5)
    rows, columns = np.nonzero(depth == 0.5)
    assert np.allclose(seen.project(cloud.points), np.column_stack([columns, rows]), atol=1e-4)


def test_flying_pixels_go_and_surfaces_stay(rng):
    depth = np.full((120, 160), 0.9)
    depth[30:90, 40:120] = 0.5
    flying = np.zeros(depth.shape, bool)
    flying[30:90, 40] = rng.random(60) < 0.5
    flying[30:90, 119] = rng.random(60) < 0.5
    depth += rng.normal(0, 0.0008, depth.shape)
    depth[flying] = rng.uniform(0.6, 0.8, flying.sum())
    keep = surface_pixels(depth, 300.0)
    assert keep[flying].mean() < 0.15
    assert keep[~flying].mean() > 0.99
    assert len(depth_cloud(camera(), depth)) == keep.sum()


def test_grazing_surfaces_go():
    def inclined(deg):
        slope = np.tan(np.radians(deg)) / 300.0
        return 0.5 * np.exp(slope * np.arange(40))[None].repeat(50, axis=0)

    strict = {"grazing_deg": 80, "jump_share": 0.0}
    assert not surface_pixels(inclined(85), 300.0, **strict).any()
    assert surface_pixels(inclined(60), 300.0, **strict)[1:-1, 1:-1].all()


def test_a_real_hand_before_a_body(data_dir):
    files = sorted((data_dir / "sr305_depth_hand" / "20210326-230536").glob("*.png"))
    assert files
    sr305 = pinhole("sr305", (640, 480), 476.007, at=(313.683, 242.755))
    chain = CloudFilters(component="nearest", front_m=0.12)
    for path in files:
        depth = cv2.imread(str(path), cv2.IMREAD_UNCHANGED) * 0.000125
        hand, _ = chain.apply(depth_cloud(sr305, depth), centres=EYE)
        low, high = np.quantile(hand.points, [0.01, 0.99], axis=0)
        assert 2500 <= len(hand) <= 4000, path.name
        assert 0.15 < np.linalg.norm(high - low) < 0.5, path.name  # hand and some forearm
