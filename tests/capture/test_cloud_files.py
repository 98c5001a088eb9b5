"""Cloud files: .ply in its forms and .npz, in metres, with what is wrong said."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from handtrack.capture.clouds import cloud_files
from handtrack.capture.clouds.cloud_files import read_cloud, write_cloud
from handtrack.capture.clouds.ply import read_ply, spread_part
from handtrack.capture.clouds.point_cloud import EMPTY, PointCloud
from handtrack.errors import HandtrackError


@pytest.fixture
def cloud(rng) -> PointCloud:
    points = rng.normal(size=(50, 3)).astype(np.float32).astype(float)
    return PointCloud(points, rng.integers(0, 256, (50, 3)).astype(np.uint8))


@pytest.mark.parametrize("suffix", [".ply", ".npz"])
def test_written_clouds_read_back(suffix, cloud, tmp_path):
    for colors in (cloud.colors, None):
        path = tmp_path / f"0{suffix}"
        write_cloud(path, PointCloud(cloud.points * 0.01, colors), 0.01)
        back = read_cloud(path, 0.01)
        assert back.warnings == ()
        assert np.allclose(back.cloud.points, cloud.points * 0.01, atol=1e-7)
        if colors is None:
            assert back.cloud.colors is None
        else:
            assert np.array_equal(back.cloud.colors, colors)


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


def test_big_endian_doubles_and_other_properties(tmp_path):
    head = (
        "ply\r\nformat binary_big_endian 1.0\r\ncomment x\r\nelement vertex 2\r\nproperty float nx\r\n"
        "property double x\r\nproperty double y\r\nproperty double z\r\nelement face 0\r\n"
        "property list uchar int vertex_indices\r\nend_header\r\n"
    )
    kind = [("nx", ">f4"), *((axis, ">f8") for axis in "xyz")]
    rows = np.array([(9, 1, 2, 3), (9, 4, 5, 6)], kind)
    (tmp_path / "0.ply").write_bytes(head.encode() + rows.tobytes())
    points, colors, _ = read_ply(tmp_path / "0.ply", 10)
    assert points.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert colors is None


@pytest.mark.parametrize("suffix", [".ply", ".npz"])
def test_an_empty_cloud_is_a_cloud(suffix, tmp_path):
    write_cloud(tmp_path / f"0{suffix}", EMPTY)
    back = read_cloud(tmp_path / f"0{suffix}")
    assert len(back.cloud) == 0
    assert back.warnings == ()


def test_points_that_are_not_finite_are_dropped_with_words(cloud, tmp_path):
    points = cloud.points.copy()
    points[3], points[7, 1] = np.nan, np.inf
    write_cloud(tmp_path / "5.npz", PointCloud(points, cloud.colors))
    back = read_cloud(tmp_path / "5.npz")
    assert len(back.cloud) == 48
    assert np.array_equal(back.cloud.colors, np.delete(cloud.colors, [3, 7], axis=0))
    (text,) = back.warnings
    assert text.endswith("5.npz: 2 of 50 points are not finite numbers and are left out.")


def test_millimetres_are_noticed(cloud, tmp_path):
    write_cloud(tmp_path / "0.ply", PointCloud(cloud.points * 60))
    (text,) = read_cloud(tmp_path / "0.ply").warnings
    assert "are spread over" in text
    assert (
        "Are they millimetres? Then set world_unit_m = 0.001 in [session], if calibration.toml"
        in text
    )
    assert read_cloud(tmp_path / "0.ply", 0.001).warnings == ()


@pytest.mark.parametrize("suffix", [".ply", ".npz"])
def test_huge_clouds_are_read_in_part(suffix, tmp_path, monkeypatch, rng):
    monkeypatch.setattr(cloud_files, "MOST_POINTS", 1000)
    write_cloud(tmp_path / f"0{suffix}", PointCloud(rng.uniform(size=(25_000, 3))))
    back = read_cloud(tmp_path / f"0{suffix}")
    assert len(back.cloud) == 1000
    assert "25000 points; an even part of 1000 is used" in back.warnings[0]
    assert np.array_equal(back.cloud.points, read_cloud(tmp_path / f"0{suffix}").cloud.points)


def test_an_even_part_is_spread():
    part = spread_part(10_000, 100)
    assert (part // 100 == np.arange(100)).all()
    assert spread_part(3, 100).tolist() == [0, 1, 2]


PLY = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nend_header\n"


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("0.ply", b"no", "not a .ply file"),
        (
            "0.ply",
            (PLY + "1 2 3\n").encode(),
            "announces 2 points, but holds 1; the file is cut off",
        ),
        ("0.ply", (PLY + "1 2 3\n1 b 3\n").encode(), "the points cannot be read"),
        (
            "0.ply",
            PLY.replace("float z", "float w").encode(),
            "no x, y, z; properties there: x, y, w",
        ),
        ("0.ply", PLY.replace("ascii", "xml").encode(), "no known format"),
        ("0.ply", PLY.replace("vertex", "face").encode(), "expected the vertices first"),
        (
            "0.ply",
            PLY.replace("vertex 2", "vertex 99999999999999999999999").encode(),
            "announces 99999999999999999999999 points, but holds fewer",
        ),
        (
            "0.ply",
            PLY.replace("float y", "float y\nproperty float x").encode(),
            "a vertex property is named twice: x, y, x, z",
        ),
        ("0.ply", (PLY + "1,2,3\n1,2,3\n").encode(), "Expected numbers with spaces between them."),
        ("0.npz", b"no", "not a readable .npz"),
        ("0.xyz", b"", "neither .ply nor .npz"),
    ],
)
def test_files_that_cannot_be_used(name, content, words, tmp_path):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(HandtrackError, match=words):
        read_cloud(tmp_path / name)


def test_arrays_of_an_npz(tmp_path):
    path = tmp_path / "0.npz"
    np.savez(path, xyz=np.zeros((2, 3)))
    with pytest.raises(HandtrackError, match="no array `points`; arrays there: xyz"):
        read_cloud(path)
    np.savez(path, points=np.zeros((2, 4)))
    with pytest.raises(HandtrackError, match=r"`points` has the shape \(2, 4\)"):
        read_cloud(path)
    np.savez(path, points=np.zeros((2, 3)), colors=np.zeros((1, 3)))
    with pytest.raises(HandtrackError, match=r"`colors` has the shape \(1, 3\)"):
        read_cloud(path)
    np.savez(path, points=np.zeros((2, 3)), colors=np.full((2, 3), 0.5))
    assert (read_cloud(path).cloud.colors == 127).all()
