"""Boards: found in images, and cameras calibrated by them."""

import json
import re
from dataclasses import replace

import cv2
import numpy as np
import pytest
from PIL import Image

from handtrack import CameraRig
from handtrack.capture.calibration.boards import (
    Board,
    BoardView,
    CameraViews,
    draw_board,
    find_board,
    page_size_mm,
    parse_board,
    require_views,
    search_views,
    write_board,
)
from handtrack.capture.calibration.bundle_adjustment import (
    LENS,
    Corners,
    free_numbers,
    jacobian_of,
    residuals,
)
from handtrack.capture.calibration.rig_calibration import CalibrationSettings, calibrate_rig
from handtrack.capture.calibration.rig_file import read_rig
from handtrack.capture.images.frames import ImageFiles
from handtrack.geometry.rotation import looking_along, rotation_matrix, rotation_vector
from handtrack_app.cli import main
from tests.cameras import pinhole
from tests.conftest import refused
from tests.derivatives import check_jacobian

CHARUCO = "charuco:7x5:30mm:22mm:DICT_4X4_50"
MARGIN_MM = 15.0  # of the CHARUCO print: half a square


def test_a_board_is_one_text():
    for size in ("25mm", "2.5cm", "0.025m"):
        assert parse_board(f"chessboard:9x6:{size}") == Board(9, 6, 0.025)
    assert parse_board(CHARUCO) == Board(7, 5, 0.03, 0.022, "DICT_4X4_50")
    for text in (CHARUCO, "chessboard:4x7:12.5mm"):
        assert parse_board(text).text == text


@pytest.mark.parametrize("text", ["chessboard:9x6:25mm", "chessboard:8x6:20mm", CHARUCO])
def test_what_is_printed_is_found_where_it_was_printed(text):
    board = parse_board(text)
    view = find_board(draw_board(board, 3.0), board)
    assert len(view.ids) == len(board.points)
    expected = board.points[view.ids, :2] * 3e3
    off = view.pixels - view.pixels[0] - (expected - expected[0])
    assert np.abs(off).max() < 0.05
    if board.dictionary:  # also in OpenCV 4, whose own corners are half a pixel off
        assert np.allclose(view.pixels, expected + 3 * MARGIN_MM - 0.5, atol=0.05)


@pytest.mark.parametrize("quarter_turns", [1, 2, 3])
def test_corners_keep_their_numbers_when_the_board_is_turned(quarter_turns):
    board = parse_board("chessboard:7x4:25mm")
    page = draw_board(board, 2.0)
    upright = find_board(page, board)
    turned = find_board(np.ascontiguousarray(np.rot90(page, quarter_turns)), board)
    height, width = page.shape
    x, y = upright.pixels.T
    expected = {1: (y, width - 1 - x), 2: (width - 1 - x, height - 1 - y), 3: (height - 1 - y, x)}
    assert np.allclose(turned.pixels, np.stack(expected[quarter_turns], -1), atol=0.1)


def test_a_part_of_a_charuco_board_is_enough_and_blur_is_told():
    board = parse_board(CHARUCO)
    page = draw_board(board, 3.0)
    soft = find_board(cv2.GaussianBlur(page, (0, 0), 3.0), board)
    assert 2 * find_board(page, board).blur_px < soft.blur_px
    page[:, :360] = 128
    assert 8 <= len(find_board(page, board).ids) < len(board.points)


def test_the_outline_of_a_board_that_is_cut_off_is_no_row_of_it():
    at = np.float32([[0, 0], [550, 0], [550, 400], [0, 400]])
    seen = np.float32([[610, 282], [335, 245], [379, 33], [710, 83]])
    page, turn = draw_board(BOARD, 2.0), cv2.getPerspectiveTransform(at, seen)
    image = cv2.warpPerspective(page, turn, (640, 480), borderValue=120)
    assert find_board(image, BOARD, thorough=True) is None


def test_a_board_larger_than_was_said_is_told():
    view = BoardView(np.arange(9), np.zeros((9, 2)), 1.5)
    page = draw_board(BOARD, 3.0)
    refused(
        "larger.* 9 x 6",
        require_views,
        replace(BOARD, columns=8),
        [CameraViews("a", (9, 9), {("", 0): view})],
        lambda _: [page],
    )


@pytest.mark.parametrize("text", ["chessboard:9x6:25mm", CHARUCO])
def test_prints_state_their_true_size(tmp_path, text):
    board = parse_board(text)
    width, height = page_size_mm(board)
    for suffix in ("svg", "pdf", "png"):
        assert write_board(tmp_path / f"b.{suffix}", board, dpi=127.0) == (width, height)
    size = f'width="{width:g}mm" height="{height:g}mm" viewBox="0 0 {width:g} {height:g}"'
    assert size in (tmp_path / "b.svg").read_text()
    pdf = (tmp_path / "b.pdf").read_bytes()
    box = [float(v) for v in re.search(rb"MediaBox \[0 0 (\S+) (\S+)\]", pdf).groups()]
    assert np.allclose(box, np.array([width, height]) / 25.4 * 72, atol=1e-3)
    assert pdf[int(pdf.split(b"startxref\n")[1].split()[0]) :].startswith(b"xref")
    with Image.open(tmp_path / "b.png") as png:
        assert png.info["dpi"] == pytest.approx((127.0, 127.0))
        assert png.size == (round(width * 5), round(height * 5))


BOARD = parse_board("chessboard:9x6:25mm")


def test_against_opencv_s_stereo_chessboard(data_dir):
    """13 real pairs; published with all five coefficients free (its README)."""
    folder = data_dir / "opencv_stereo_chessboard"
    cameras = []
    for side in ("left", "right"):
        source = ImageFiles(sorted(folder.glob(f"{side}??.jpg")))
        cameras.append(search_views(side, [(source, source.frames, False)], BOARD))
    assert [len(camera.shared) for camera in cameras] == [13, 13]
    found = calibrate_rig(BOARD, cameras)
    left, right = found.report["cameras"]
    assert left["rms_px"] < 0.20
    assert right["rms_px"] < 0.21
    assert found.report["pairs"][0]["baseline_m"] == pytest.approx(0.0832, abs=2e-4)
    names, within = ("fx", "fy", "cx", "cy", "k1"), [1.5] * 4 + [0.01]
    for side, published in (
        (left, (532.83, 532.94, 342.49, 233.86, -0.281)),
        (right, (537.45, 536.97, 327.59, 248.88, -0.298)),
    ):
        off = [side["lens"][name] for name in names] - np.array(published)
        assert (np.abs(off) < within).all(), off
    second = found.rig["right"]
    turn = np.rad2deg(cv2.Rodrigues(second.rotation)[0]).ravel()
    assert np.allclose(turn, [0.39, 0.22, -0.22], atol=0.1)
    assert np.allclose(second.translation / 0.025, [-3.328, 0.037, 0.014], atol=0.03)


PER_MM = 2.0


def looking_at_boards(name, focal, centre, distortions):
    """Return a camera at `centre` looking at where boards are waved, world y down."""
    forward = np.subtract((0, 0, 0.45), centre)
    rotation = looking_along(forward / np.linalg.norm(forward), np.array([0.0, 1.0, 0.0]))
    place = -rotation @ centre
    return pinhole(
        name, (480, 360), (focal, 1.004 * focal), rotation, place, distortions, (243, 175)
    )


def board_poses(board, count, rng):
    """Return T_world_board (4, 4) of a board waved about (0, 0, 0.45), its front to the cameras."""
    middle = np.append(board.points[:, :2].mean(axis=0), 0)
    poses = []
    for _ in range(count):
        pose = np.eye(4)
        turn = np.append(rng.uniform(-0.55, 0.55, 2), rng.uniform(-0.35, 0.35))
        pose[:3, :3] = rotation_matrix(turn)
        place = rng.uniform(-1, 1, 3) * [0.08, 0.08, 0.112] + [0, 0, 0.45]
        pose[:3, 3] = place - pose[:3, :3] @ middle
        poses.append(pose)
    return poses


def photograph(camera, board, pose, rng):
    """Return the image (H, W) uint8 of a board at T_world_board by a camera without distortion."""
    page, pixel = draw_board(board, PER_MM), 1e-3 / PER_MM
    margin = 0.5e-3 * page_size_mm(board)[0] - 0.5 * board.squares[0] * board.square_m
    to_board = np.array([[pixel, 0, pixel / 2 - margin], [0, pixel, pixel / 2 - margin], [0, 0, 1]])
    turn, place = camera.rotation @ pose[:3, :3], camera.to_camera(pose[:3, 3])
    seen = camera.matrix @ np.column_stack([turn[:, :2], place]) @ to_board
    image = 0.8 * cv2.warpPerspective(page, seen, camera.size, borderValue=120) + 20
    return np.clip(np.round(rng.normal(image, 2.0)), 0, 255).astype(np.uint8)


RIG = CameraRig(
    (
        looking_at_boards("a", 430, (-0.12, 0.0, 0.0), (-0.2, 0.06, 1e-3, -5e-4, 0.0)),
        looking_at_boards("b", 445, (0.1, -0.03, 0.02), (-0.15, 0.02, 0.0, 1e-3, 0.0)),
        looking_at_boards("c", 420, (0.28, 0.05, 0.12), (-0.18, 0.04, 0.0, 0.0, 0.0)),
    )
)


NOISE_PX = 0.1


def views_of(camera, board, poses, rng, frames=None):
    """Return what a camera would find: corners with noise, where the whole board is in the image."""
    found = {}
    for frame, pose in enumerate(poses):
        pixels = camera.project(board.points @ pose[:3, :3].T + pose[:3, 3])
        inside = ((pixels > 3) & (pixels < np.array(camera.size) - 4)).all()
        if inside and (frames is None or frame in frames):
            noisy = pixels + rng.normal(size=pixels.shape) * NOISE_PX
            found["", frame] = BoardView(np.arange(len(pixels)), noisy, 1.5)
    return CameraViews(camera.name, camera.size, found, len(poses), "simulated")


POSES = board_poses(BOARD, 40, np.random.default_rng(7))


def assert_same_rig(calibrated, centre_mm):
    """Compare with the truth in the first camera's frame; lenses within 5 stated deviations."""
    first, stated_of = RIG.cameras[0], calibrated.report["cameras"]
    for got, true, stated in zip(calibrated.rig, RIG, stated_of, strict=True):
        lens = [*true.matrix[[0, 1, 0, 1], [0, 1, 2, 2]], *true.distortions]
        lens_off = [stated["lens"][name] for name in LENS] - np.array(lens)
        lens_std = np.array([stated["lens_std"][name] for name in LENS])
        assert (np.abs(lens_off) <= 5 * lens_std + 1e-9).all(), (true.name, lens_off, lens_std)
        assert np.linalg.norm(got.centre - first.to_camera(true.centre)) < centre_mm * 1e-3
        turn = rotation_vector(got.rotation @ (true.rotation @ first.rotation.T).T)
        assert np.rad2deg(np.linalg.norm(turn)) < 0.2


def test_derivatives(rng):
    """Every free number of a state."""
    count = len(BOARD.points)
    camera, view = np.repeat(np.mgrid[:3, :4].reshape(2, -1), count, axis=1)
    corners = Corners(camera, view, np.tile(BOARD.points, (12, 1)), np.zeros((12 * count, 2)))
    lens = [430, 431, 240, 170, -0.2, 0.06, 1e-3, -5e-4, 0.02] * 3
    turns, boards = rng.normal(size=(3, 6)) * 0.05, rng.normal(size=(4, 6)) * 0.1
    state = np.concatenate([lens, *turns, *(boards + [0, 0, 0, 0, 0, 0.5])])
    free = free_numbers(state, corners, np.ones((3, 9), bool))
    assert np.flatnonzero(~free).tolist() == [*range(27, 33)]  # the first camera

    def projected(vector):
        moved = state.copy()
        moved[free] = vector
        return -residuals(moved, corners).ravel()

    found = jacobian_of(state, corners, free).toarray()
    check_jacobian(projected, found, state[free], rtol=1e-8)


CHAINED = {"a": range(25), "b": range(40), "c": range(25, 40)}


@pytest.mark.parametrize(
    ("seen", "centre_mm", "pairs"),
    [({}, 0.5, "ab ac bc"), (CHAINED, 1.5, "ab bc")],
)
def test_a_known_rig_is_found_again(seen, centre_mm, pairs, rng):
    cameras = [views_of(camera, BOARD, POSES, rng, seen.get(camera.name)) for camera in RIG]
    found = calibrate_rig(BOARD, cameras)
    assert_same_rig(found, centre_mm)
    assert found.report["sigma_px"] == pytest.approx(NOISE_PX, rel=0.1)
    assert {"".join(pair["names"]) for pair in found.report["pairs"]} == set(pairs.split())
    for pair in found.report["pairs"]:
        a, b = (RIG[name].centre for name in pair["names"])
        assert abs(pair["baseline_m"] - np.linalg.norm(a - b)) <= 1e-3 * centre_mm


def test_a_board_that_looks_alike_when_turned_is_settled_by_agreement(rng):
    """An even x even board, numbered from either end at random in each camera and view."""
    board = parse_board("chessboard:8x6:25mm")
    poses = board_poses(board, 24, rng)
    cameras = []
    for camera in RIG:
        seen = views_of(camera, board, poses, rng)
        turned = {
            place: replace(view, ids=board.turns[1][view.ids]) if rng.random() < 0.5 else view
            for place, view in seen.shared.items()
        }
        cameras.append(replace(seen, views=turned))
    found = calibrate_rig(board, cameras)
    assert_same_rig(found, centre_mm=1.0)
    assert "half a turn" in found.report["warnings"][0]


def test_the_world_can_be_a_board(rng):
    cameras = [views_of(camera, BOARD, POSES[:12], rng) for camera in RIG]
    (_, frame), view = next(iter(cameras[0].shared.items()))
    found = calibrate_rig(BOARD, cameras, CalibrationSettings(world=f"board:{frame}"))
    seen = found.rig["a"].project(BOARD.points * [1, -1, 1])  # y up the print, z out of it
    assert np.abs(seen - view.pixels).max() < 0.6
    assert min(found.rig["a"].centre[2], found.rig["b"].centre[2]) > 0.2
    refused(
        "board:99.*a, b, c", calibrate_rig, BOARD, cameras, CalibrationSettings(world="board:99")
    )


def test_from_pictures_to_calibration_file(tmp_path, capsys, rng):
    """Pictures of a board with noise, through the command line."""
    board = parse_board(CHARUCO)
    first, second = (camera.without_distortion() for camera in RIG.cameras[:2])
    arguments = []
    for name in "ab":
        arguments += ["--camera", f"{name}={tmp_path}/{name}*.png"]
    for frame, pose in enumerate(board_poses(board, 12, rng)):
        for camera in (first, second):
            picture = photograph(camera, board, pose, rng)
            cv2.imwrite(f"{tmp_path}/{camera.name}{frame:03d}.png", picture)
    out = tmp_path / "calibration.toml"
    command = ["calibrate", "--out", str(out), "--board", CHARUCO, "--no-k3", "--json"]
    assert main([*command, *arguments]) == 0
    report = json.loads(capsys.readouterr().out)
    assert all(camera["rms_px"] < 0.3 for camera in report["cameras"])
    found = read_rig(out)
    assert np.linalg.norm(found["b"].centre - first.to_camera(second.centre)) < 2e-3
    assert found["a"].matrix[0, 0] == pytest.approx(first.matrix[0, 0], rel=0.005)
    for name in ("rig", "residuals"):
        assert cv2.imread(f"{tmp_path}/calibration_{name}.png") is not None
    assert (tmp_path / "calibration_report.txt").exists()
