"""Bad clouds and depth, end to end: clear words, nothing lost; a bad frame is one frame's matter."""

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from handtrack import Camera, PointCloud, load_model, read_npz
from handtrack.capture.clouds.cloud_files import write_cloud
from handtrack.model.pose_library import named_pose
from handtrack.simulation.render import pixel_rays, render
from tests.app.cloud_session import FRAMES, STEP_M, cloud_file, cloud_recording
from tests.session.small_session import edit

TRACKED, LOST = 0, 2


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return cloud_recording(tmp_path_factory.mktemp("clouds") / "clouds")


@pytest.fixture
def clouds(made, tmp_path):
    return Path(shutil.copytree(made, tmp_path / "session"))


def statuses(ended, folder):
    """Return each frame's status; the command ended well, and every pose has numbers."""
    assert ended.code == 0, ended.err
    track = read_npz(folder / "tracks/poses.npz")
    assert np.isfinite(track.parameters).all()
    return track.status.tolist()


def nothing(folder):
    np.savez(cloud_file(folder, 2), points=np.zeros((0, 3)))


def no_numbers(folder):
    np.savez(cloud_file(folder, 2), points=np.tile([[np.nan], [np.inf], [-np.inf]], (700, 3)))


def missing(folder):
    cloud_file(folder, 2).unlink()


def cut_ply(folder):
    missing(folder)
    path = folder / "clouds/002.ply"
    write_cloud(path, PointCloud(np.zeros((1000, 3))))
    path.write_bytes(path.read_bytes()[:5000])


@pytest.mark.parametrize(
    ("damage", "told"),
    [(nothing, "lost: frames 2"), (no_numbers, "2100 of 2100 points"), (cut_ply, "002.ply")],
)  # fmt: skip
def test_a_bad_cloud_is_one_lost_frame(damage, told, handtrack, clouds):
    damage(clouds)
    ended = handtrack("track", clouds)
    assert statuses(ended, clouds) == [TRACKED, TRACKED, LOST, TRACKED, TRACKED]
    assert told in ended.err


# ---- depth -------------------------------------------------------------------------------------------


@pytest.fixture
def depth(clouds):
    """The same recording as a depth camera (320 x 240) sees it."""
    shutil.rmtree(clouds / "clouds")
    (clouds / "depth").mkdir()
    edit(clouds / "session.toml", 'files = "clouds/*"', 'depth = ["cam0"]')
    source = 'name = "cam0"\ndepth = "depth/*.png"\ndepth_scale_m = 0.0001'
    edit(clouds / "session.toml", 'name = "cam0"', source)
    edit(clouds / "calibration.toml", "size = [64, 48]", "size = [320, 240]")
    edit(clouds / "calibration.toml", "[[80.0, 0.0, 31.5], [0.0, 80.0, 23.5]", MATRIX)
    for frame in range(FRAMES):
        cv2.imwrite(str(clouds / "depth" / f"{frame}.png"), depth_image(frame))
    return clouds


MATRIX = "[[400.0, 0.0, 159.5], [0.0, 400.0, 59.5]"  # the hand, fingers up in y, fills the image


def depth_image(frame):
    """(240, 320) uint16, 0.1 mm a unit: the model's hand 0.5 m before the camera, nothing behind it."""
    model = load_model()
    joint = named_pose(model, "open")
    joint[0] = STEP_M * frame
    matrix = np.array([[400.0, 0, 159.5], [0, 400.0, 59.5], [0, 0, 1]])
    camera = Camera("cam0", (320, 240), matrix, np.zeros(5), np.eye(3), np.array([0, 0, 0.5]))
    posed = model.flesh["fine"].posed(model.bones(model.transform.solver_params(joint)))
    front, z, _ = render(camera, posed, pixel_rays(camera))
    return np.where(front >= 0, np.nan_to_num(z, posinf=0.0) * 1e4, 0).round().astype(np.uint16)


def test_an_image_of_another_size_in_the_middle_loses_nothing(handtrack, depth):
    """It is an error, since it may be another camera's; but what was tracked before it is saved and named."""
    cv2.imwrite(str(depth / "depth/3.png"), depth_image(3)[::2, ::2])
    ended = handtrack("track", depth)
    assert ended.code == 2
    assert "3.png" in ended.err and "160 x 120" in ended.err
    assert read_npz(depth / "tracks/poses.npz").status.tolist() == [TRACKED] * 3


def test_missing_and_damaged_depth_are_lost_frames(handtrack, depth):
    (depth / "depth/1.png").unlink()
    (depth / "depth/3.png").write_bytes((depth / "depth/3.png").read_bytes()[:500])
    ended = handtrack("track", depth)
    assert statuses(ended, depth) == [TRACKED, LOST, TRACKED, LOST, TRACKED]
    assert "3.png" in ended.err
