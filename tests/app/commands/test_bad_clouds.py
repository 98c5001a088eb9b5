"""Bad clouds, depth and pairs, end to end: clear words, nothing lost; a bad frame is one frame's matter."""

import shutil
import tracemalloc
from pathlib import Path

import cv2
import numpy as np
import pytest

from handtrack.capture.clouds.cloud_files import write_cloud
from handtrack.capture.clouds.point_cloud import PointCloud
from handtrack.session.formats.tables import read_npz
from tests.app.cloud_session import FRAMES, STEP_M, cloud_file, cloud_recording, points_of
from tests.app.command_line import Ended, refused
from tests.session.small_session import edit

TRACKED, LOST = 0, 2
MEGABYTE = 1e6


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return cloud_recording(tmp_path_factory.mktemp("clouds") / "clouds")


@pytest.fixture
def clouds(made, tmp_path):
    return Path(shutil.copytree(made, tmp_path / "session"))


def statuses(ended: Ended, folder: Path) -> list[int]:
    """Return each frame's status; the command ended well, and every pose has numbers."""
    assert ended.code == 0, ended.err
    track = read_npz(folder / "tracks/poses.npz")
    assert np.isfinite(track.parameters).all()
    return track.status.tolist()


def one_bad(frame: int) -> list[int]:
    return [LOST if k == frame else TRACKED for k in range(FRAMES)]


def test_the_recording_is_good_before_it_is_damaged(handtrack, clouds):
    ended = handtrack("track", clouds)
    assert statuses(ended, clouds) == [TRACKED] * FRAMES
    assert "note:" not in ended.err
    moved = read_npz(clouds / "tracks/poses.npz").parameters[:, 0]
    np.testing.assert_allclose(moved, STEP_M * np.arange(FRAMES), atol=5e-4)


# ---- one frame is bad: it is lost, the others are not ------------------------------------------------


def test_empty_clouds_and_clouds_without_a_number_are_lost_frames(handtrack, clouds):
    """Fault C19."""
    np.savez(cloud_file(clouds, 1), points=np.zeros((0, 3)))
    np.savez(cloud_file(clouds, 3), points=np.tile([[np.nan], [np.inf], [-np.inf]], (700, 3)))
    ended = handtrack("track", clouds)
    assert statuses(ended, clouds) == [TRACKED, LOST, TRACKED, LOST, TRACKED]
    assert "lost: frames 1, 3; the first: the cloud has hardly any points within" in ended.err
    assert "003.npz: 2100 of 2100 points are not finite numbers and are left out." in ended.err
    doctor = handtrack("doctor", clouds)
    assert "fewer than 300 are left in frames" in doctor.out


def test_single_points_without_numbers_cost_nothing_else(handtrack, clouds):
    """Fault C20."""
    points = points_of(clouds, 1).copy()
    points[::10, 1] = np.nan
    points[5::10] = np.inf
    points[7] = 1e30
    np.savez(cloud_file(clouds, 1), points=points)
    ended = handtrack("track", clouds)
    assert statuses(ended, clouds) == [TRACKED] * FRAMES
    assert "001.npz: 600 of 3000 points are not finite numbers and are left out." in ended.err


def test_a_damaged_or_missing_cloud_is_a_lost_frame(handtrack, clouds):
    cloud_file(clouds, 2).unlink()
    whole = cloud_file(clouds, 1).read_bytes()
    cloud_file(clouds, 1).write_bytes(whole[: len(whole) // 2])
    cloud_file(clouds, 3).unlink()
    write_cloud(clouds / "clouds/003.ply", PointCloud(np.zeros((1000, 3))))
    part = (clouds / "clouds/003.ply").read_bytes()
    (clouds / "clouds/003.ply").write_bytes(part[:5000])
    ended = handtrack("track", clouds)
    assert statuses(ended, clouds) == [TRACKED, LOST, LOST, LOST, TRACKED]
    assert "001.npz: not a readable .npz" in ended.err
    assert "003.ply: announces 1000 points, but holds" in ended.err
    assert "the file is cut off. Write it again. Frame 3 counts as missing." in ended.err


def test_ten_million_points_take_bounded_memory(handtrack, clouds, rng):
    """A hand in a room of ten million points (120 MB): the hand is tracked, and a note says to thin. Fault C21."""
    count = 10_000_000
    room = rng.random((count, 3), np.float32)
    room *= 2
    room -= np.float32([1.0, 1.0, -0.3])
    hand = np.tile(points_of(clouds, 1), (100, 1))
    room[:: count // len(hand)][: len(hand)] = hand
    cloud_file(clouds, 1).unlink()
    write_cloud(clouds / "clouds/001.ply", PointCloud(room))
    del room, hand
    tracemalloc.start()
    try:
        ended = handtrack("track", clouds, "--frames", "0:2")
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert statuses(ended, clouds) == [TRACKED] * 2
    assert "001.ply: 10000000 points; an even part of 1000000 is used. Thin the clouds" in ended.err
    assert peak < 250 * MEGABYTE  # 81 MB: a tenth of it is kept, cropped, thinned
    (clouds / "clouds/001.ply").unlink()  # pytest would keep it


# ---- all of it is bad: refused, or asked -------------------------------------------------------------


def in_millimetres(folder: Path) -> None:
    for frame in range(FRAMES):
        np.savez(cloud_file(folder, frame), points=1000.0 * points_of(folder, frame))


def test_the_unit_that_was_suggested_is_right(handtrack, clouds):
    in_millimetres(clouds)
    edit(clouds / "session.toml", "fps = 10.0", "fps = 10.0\nworld_unit_m = 0.001")
    edit(clouds / "calibration.toml", "[0.0, 0.0, 0.5]", "[0.0, 0.0, 500.0]")
    ended = handtrack("track", clouds)
    assert statuses(ended, clouds) == [TRACKED] * FRAMES
    assert "note:" not in ended.err


def test_a_header_that_announces_what_no_memory_holds(handtrack, clouds):
    for frame in range(FRAMES):
        cloud_file(clouds, frame).unlink()
    axes = "".join(f"property float {axis}\n" for axis in "xyz")
    for kind in ("ascii", "binary_little_endian"):
        text = f"ply\nformat {kind} 1.0\nelement vertex 1000000000000\n{axes}end_header\n0 0 0\n"
        (clouds / "clouds/000.ply").write_text(text)
        expected = ["000.ply: announces 1000000000000 points, but holds", "the file is cut off"]
        refused(handtrack, clouds.parent, ["track", clouds], expected)


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


def depth_image(frame: int) -> np.ndarray:
    """(240, 320) uint16, 0.1 mm a unit: the model's hand 0.5 m before the camera, nothing behind it."""
    from handtrack.geometry.camera import Camera
    from handtrack.model.model_file import load_model
    from handtrack.model.pose_library import named_pose
    from handtrack.simulation.render import pixel_rays, render

    model = load_model()
    joint = named_pose(model, "open")
    joint[0] = STEP_M * frame
    matrix = np.array([[400.0, 0, 159.5], [0, 400.0, 59.5], [0, 0, 1]])
    camera = Camera("cam0", (320, 240), matrix, np.zeros(5), np.eye(3), np.array([0, 0, 0.5]))
    posed = model.flesh["fine"].posed(model.bones(model.transform.solver_params(joint)))
    front, z, _ = render(camera, posed, pixel_rays(camera))
    return np.where(front >= 0, np.nan_to_num(z, posinf=0.0) * 1e4, 0).round().astype(np.uint16)


def test_eight_bits_are_no_depth(handtrack, depth):
    """Fault C24."""
    for frame in range(FRAMES):
        eight = (depth_image(frame) // 40).astype(np.uint8)
        cv2.imwrite(str(depth / "depth" / f"{frame}.png"), eight)
    expected = ["0.png: depth must be one channel of 16 bits; found uint8", "export 16 bit PNG"]
    refused(handtrack, depth.parent, ["track", depth], expected)
    refused(handtrack, depth.parent, ["doctor", depth], expected)


def test_an_image_of_another_size_in_the_middle_loses_nothing(handtrack, depth):
    """It is an error, since it may be another camera's; but what was tracked before it is saved and named."""
    cv2.imwrite(str(depth / "depth/3.png"), depth_image(3)[::2, ::2])
    ended = handtrack("track", depth)
    assert ended.code == 2
    assert (
        "3.png, frame 3: the image is 160 x 120, but the camera is calibrated for 320 x 240"
        in ended.err
    )
    assert "Tracking ended there; the 3 frames tracked before it are in" in ended.err
    assert "3 of 5 frames: 3 tracked" in ended.out
    assert read_npz(depth / "tracks/poses.npz").status.tolist() == [TRACKED] * 3


def test_missing_and_damaged_depth_are_lost_frames(handtrack, depth):
    (depth / "depth/1.png").unlink()
    (depth / "depth/3.png").write_bytes((depth / "depth/3.png").read_bytes()[:500])
    ended = handtrack("track", depth)
    assert statuses(ended, depth) == [TRACKED, LOST, TRACKED, LOST, TRACKED]
    assert "3.png: the PNG is cut off; frame 3 counts as missing" in ended.err


def test_a_wrong_scale_of_depth_is_noticed(handtrack, depth):
    """Fault C23."""
    edit(depth / "session.toml", "depth_scale_m = 0.0001", "depth_scale_m = 0.1")
    ended = handtrack("doctor", depth)
    assert ended.code == 0
    assert "the median depth is 4" in ended.out
    assert "with depth_scale_m = 0.1. Is the scale right?" in ended.out
    tracked = handtrack("track", depth)
    assert set(statuses(tracked, depth)) == {LOST}


# ---- pairs -------------------------------------------------------------------------------------------


@pytest.fixture
def pair(data_dir, tmp_path):
    """The first five frames of a stereo recording."""
    source, target = data_dir / "sessions" / "webxr_stereo_768", tmp_path / "pair"
    if not source.is_dir():
        pytest.skip("no webxr_stereo_768 among the shared data")
    late = {f"{frame:06d}.{kind}" for frame in range(FRAMES, 1000) for kind in ("jpg", "png")}
    shutil.copytree(source, target, ignore=lambda _, names: late & set(names) | {"truth_depth"})
    edit(target / "session.toml", 'scale = "fit"', "scale = 1.0")
    return target


def test_exchanged_images_are_noticed(handtrack, pair):
    text = (pair / "session.toml").read_text()
    for kind in ("left/*.jpg", "right/*.jpg"):
        assert kind in text
    text = text.replace("left/*.jpg", "?").replace("right/*.jpg", "left/*.jpg")
    (pair / "session.toml").write_text(text.replace('"?"', '"right/*.jpg"'))
    asked = "Are the two cameras' images, or their calibrations, exchanged?"
    ended = handtrack("track", pair, "--frames", "0:1", "--use", "cloud")
    assert ended.code == 0
    assert asked in ended.err


def test_an_image_missing_in_the_middle_is_a_missing_cloud(handtrack, pair):
    (pair / "left/000002.jpg").unlink()
    ended = handtrack("track", pair, "--use", "cloud")
    assert statuses(ended, pair) == one_bad(2)
    masks = handtrack("track", pair, "--frames", "1:3")
    assert LOST not in statuses(masks, pair)
