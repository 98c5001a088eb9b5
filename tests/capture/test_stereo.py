"""Stereo: a textured plane seen by pairs in every arrangement, real pairs with truth, bad pairs."""

import cv2
import numpy as np
import pytest

from handtrack.capture.calibration.rig_file import read_rig
from handtrack.capture.clouds.stereo import (
    StereoMatcher,
    StereoSettings,
    check_pair,
    matches,
    without_speckles,
)
from handtrack.geometry.rotation import rotation_matrix
from tests.cameras import pinhole

METHODS = ("sgbm", "correlation")
PLANE_M = 0.5


def cloud_of(matcher, *taken):
    """Return the points that a pair of images, and masks, give."""
    return matcher.triangulate(matcher.match(*taken))


def camera(name, centre=(0, 0, 0), turn=(0, 0, 0), distortions=(0, 0, 0, 0, 0)):
    rotation = rotation_matrix(np.array(turn, dtype=float))
    return pinhole(name, (240, 180), 300, rotation, -rotation @ centre, distortions)


@pytest.fixture(scope="module")
def texture():
    """(H, W, 3) uint8: blobs of several sizes, 0.5 mm a pixel."""
    rng = np.random.default_rng(3)
    noise = sum(
        s * cv2.GaussianBlur(rng.normal(size=(1200, 1200, 3)), (0, 0), s) for s in (5.0, 10.0, 20.0)
    )
    return np.clip(128 + 45 * noise / noise.std(), 0, 255).astype(np.uint8)


def picture(seen, texture, plane_m=PLANE_M):
    """What a camera sees of the textured plane z = 0.5 m, or another."""
    u, v = np.meshgrid(np.arange(240.0), np.arange(180.0))
    rays = seen.rays(np.stack([u, v], -1))
    hit = seen.centre + rays * ((plane_m - seen.centre[2]) / rays[..., 2])[..., None]
    place = (hit[..., :2] / 0.0005 + 600).astype(np.float32)
    return cv2.remap(
        texture,
        np.ascontiguousarray(place[..., 0]),
        np.ascontiguousarray(place[..., 1]),
        cv2.INTER_LINEAR,
    )


ARRANGEMENTS = {
    "parallel": camera("b", (0.06, 0, 0)),
    "towards each other, rolled": camera("b", (0.07, 0.01, 0), (0.02, 0.12, 0.06)),
    "above one another": camera("b", (0, 0.06, 0), (-0.08, 0, 0)),
    "to the left": camera("b", (-0.06, 0, 0.01)),
    "a lens with distortion": camera("b", (0.06, 0, 0), (0, 0.05, 0), (-0.25, 0.1, 0.002, 0, 0)),
}


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("arrangement", ARRANGEMENTS)
def test_a_plane_is_found_where_it_is(arrangement, method, texture):
    first, second = camera("a"), ARRANGEMENTS[arrangement]
    images = picture(first, texture), picture(second, texture)
    matcher = StereoMatcher(first, second, StereoSettings(method, near_m=0.3, far_m=1.0))
    view = matcher.match(*images)
    cloud = matcher.triangulate(view)
    assert len(cloud) > 0.45 * 240 * 180
    error = np.abs(cloud.points[:, 2] - PLANE_M)
    pixel = PLANE_M**2 / (300 * matcher.pair.baseline_m)  # of disparity, in depth
    assert np.median(error) < (0.2 if method == "sgbm" else 0.06) * pixel
    assert np.quantile(error, 0.98) < 0.01
    left = matcher.pair.real[0]
    pixels = left.project(cloud.points).round().astype(int)
    there = images[left is second][pixels[:, 1].clip(0, 179), pixels[:, 0].clip(0, 239), ::-1]
    assert np.median(np.abs(there.astype(int) - cloud.colors)) < 12


def test_cameras_that_stand_close_together_measure_what_is_right_before_them(texture):
    first, second = camera("a"), camera("b", (0.012, 0, 0))
    images = picture(first, texture, 0.15), picture(second, texture, 0.15)
    cloud = cloud_of(StereoMatcher(first, second), *images)
    assert len(cloud) > 0.45 * 240 * 180
    assert np.median(np.abs(cloud.points[:, 2] - 0.15)) < 0.002


def test_only_masked_pixels_are_matched(texture):
    first, second = camera("a"), ARRANGEMENTS["parallel"]
    images = picture(first, texture), picture(second, texture)
    mask, other = np.zeros((2, 180, 240), np.uint8)
    mask[40:140, 60:180] = 255
    other[:, :] = 255
    cloud = cloud_of(StereoMatcher(first, second), *images, mask, other)
    pixels = first.project(cloud.points)
    assert len(cloud) > 0.9 * 100 * 120
    assert (pixels > (59, 39)).all()
    assert (pixels < (180, 140)).all()
    assert len(cloud_of(StereoMatcher(first, second), *images, mask, 0 * other)) == 0
    assert len(cloud_of(StereoMatcher(first, second), *images, 0 * mask, other)) == 0


def test_small_patches_that_stand_off_are_left_out():
    found = np.full((40, 40), 5.0, np.float32)
    found[10:14, 10:14] = 25
    cleaned = without_speckles(found, 30)
    assert np.isnan(cleaned[10:14, 10:14]).all()
    assert np.isfinite(cleaned).sum() == 40 * 40 - 16


# ---------------------------------------------------------------- pairs that do not fit


def test_a_wrong_calibration_is_noticed(texture):
    first, second = camera("a"), camera("b", (0.06, 0, 0))
    images = picture(first, texture), picture(second, texture)
    matcher = StereoMatcher(first, camera("b", (0.06, 0, 0), (0.05, 0, 0)))
    text = check_pair(matcher, matcher.match(*images), *images) or ""
    assert "rectification" in text


# ---------------------------------------------------------------- data with truth


@pytest.mark.parametrize(
    ("method", "density", "within_1", "within_2"),
    [("sgbm", 0.84, 0.91, 0.93), ("correlation", 0.72, 0.87, 0.90)],
)
def test_a_real_pair_with_true_disparity(method, density, within_1, within_2, data_dir):
    folder = data_dir / "stereo_pairs_truth"
    truth = np.load(folder / "motorcycle_disp.npz")["arr_0"]
    left, right = (cv2.imread(str(folder / f"motorcycle_{side}.png")) for side in ("left", "right"))
    found, _ = matches(left, right, 0, 64, StereoSettings(method))
    known = np.isfinite(truth)
    error = np.abs(found - truth)[known & np.isfinite(found)]
    assert np.isfinite(found)[known].mean() > density
    assert (error <= 1).mean() > within_1
    assert (error <= 2).mean() > within_2


@pytest.mark.parametrize("method", METHODS)
def test_a_hand_with_true_depth(method, data_dir):
    folder = data_dir / "sessions" / "webxr_stereo_768"
    rig = read_rig(folder / "calibration.toml")
    left = rig["left"]

    def of(kind):
        return cv2.imread(str(sorted((folder / kind).glob("*"))[30]), cv2.IMREAD_UNCHANGED)

    matcher = StereoMatcher(left, rig["right"], StereoSettings(method))
    cloud = cloud_of(matcher, of("left"), of("right"), of("masks/left"), of("masks/right"))
    truth = of("truth_depth/left") * 0.0001
    columns, rows = left.project(cloud.points).round().astype(int).T
    on_hand = truth[rows, columns] > 0
    error = np.abs(left.to_camera(cloud.points)[:, 2] - truth[rows, columns])[on_hand]
    assert on_hand.mean() > 0.98
    assert len(cloud) > 0.8 * (truth > 0).sum()
    assert np.median(error) < 0.0007
    assert np.quantile(error, 0.9) < 0.004
