"""Cloud files: .ply in its forms and .npz, in metres, with what is wrong said."""

import numpy as np
import pytest
import trimesh

from handtrack.capture.clouds import cloud_files
from handtrack.capture.clouds.cloud_files import read_cloud, write_cloud
from handtrack.capture.clouds.ply import read_ply
from handtrack.capture.clouds.point_cloud import PointCloud
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


@pytest.mark.parametrize("suffix", [".ply", ".npz"])
def test_huge_clouds_are_read_in_part(suffix, tmp_path, monkeypatch, rng):
    monkeypatch.setattr(cloud_files, "MOST_POINTS", 1000)
    write_cloud(tmp_path / f"0{suffix}", PointCloud(rng.uniform(size=(25_000, 3))))
    back = read_cloud(tmp_path / f"0{suffix}")
    assert len(back.cloud) == 1000
    assert "25000 points; an even part of 1000 is used" in back.warnings[0]
    assert np.array_equal(back.cloud.points, read_cloud(tmp_path / f"0{suffix}").cloud.points)


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
