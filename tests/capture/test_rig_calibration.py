"""Calibration: known rigs are found again, real boards agree with published values, errors are clear."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import cv2
import numpy as np
import pytest

from handtrack.capture.calibration.board_detection import BoardView
from handtrack.capture.calibration.board_views import (
    CameraViews,
    choose_views,
    require_views,
    search_views,
)  # fmt: skip
from handtrack.capture.calibration.boards import parse_board
from handtrack.capture.calibration.bundle_adjustment import (
    LENS,
    Corners,
    RigState,
    _jacobian,
    _Layout,
    residuals,
)
from handtrack.capture.calibration.rig_calibration import CalibrationSettings, calibrate_rig
from handtrack.capture.calibration.rig_file import read_rig
from handtrack.capture.images.frames import ImageFiles
from handtrack.errors import HandtrackError
from handtrack_app.cli import main
from tests.capture.board_scene import BoardPhotographer, board_poses, seen_pixels, three_cameras

BOARD = parse_board("chessboard:9x6:25mm")
NOISE_PX = 0.1


def views_of(camera, board, poses, rng, frames=None):
    """Return what a camera would find: corners with noise, where the whole board is in the image."""
    found = []
    for frame, pose in enumerate(poses):
        pixels = seen_pixels(camera, board, pose)
        known = np.isfinite(pixels).all() and (pixels > 3).all()
        inside = known and (pixels < np.array(camera.size) - 4).all()
        if inside and (frames is None or frame in frames):
            noisy = pixels + rng.normal(size=pixels.shape) * NOISE_PX
            found.append(BoardView(frame, np.arange(len(pixels)), noisy, 1.5))
    return CameraViews(camera.name, camera.size, tuple(found), (), len(poses), "simulated")


@pytest.fixture(scope="module")
def rig():
    return three_cameras()


@pytest.fixture(scope="module")
def poses():
    return board_poses(BOARD, 40, np.random.default_rng(7), spread=0.08)


def assert_same_rig(found, rig, report, centre_mm):
    """Compare with the truth in the first camera's frame; lenses within 5 stated deviations."""
    first = rig.cameras[0]
    for got, true, stated in zip(found, rig, report.cameras, strict=True):
        lens = [*true.matrix[[0, 1, 0, 1], [0, 1, 2, 2]], *true.distortions]
        for name, value in zip(LENS, lens, strict=True):
            assert abs(stated.lens[name] - value) <= 5 * stated.lens_std[name] + 1e-9, (
                true.name,
                name,
            )
        centre = first.to_camera(true.centre)
        assert np.linalg.norm(got.centre - centre) < centre_mm * 1e-3
        turn = got.rotation @ (true.rotation @ first.rotation.T).T
        assert np.rad2deg(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1))) < 0.2


def test_derivatives(rig, poses, rng):
    """The analytic Jacobian against central differences, every free number of a state."""
    cameras = [views_of(camera, BOARD, poses[:4], rng) for camera in rig]
    parts = [(c, view) for c, seen in enumerate(cameras) for view in seen.shared]
    count = [len(view.ids) for _, view in parts]
    corners = Corners(
        np.repeat([c for c, _ in parts], count),
        np.repeat([view.frame for _, view in parts], count),
        np.concatenate([BOARD.points[view.ids] for _, view in parts]),
        np.concatenate([view.pixels for _, view in parts]),
    )
    lens = [[430, 431, 240, 170, -0.2, 0.06, 1e-3, -5e-4, 0.02]] * 3
    state = RigState(
        np.array(lens),
        rng.normal(size=(3, 6)) * 0.05,
        rng.normal(size=(4, 6)) * 0.1 + [0, 0, 0, 0, 0, 0.5],
    )
    layout = _Layout(state, np.ones((3, 9), bool), fixed_camera=0)
    vector = layout.vector(state)
    analytic = _jacobian(state, corners, layout).toarray()
    for i in range(len(vector)):
        step = 1e-6 * max(abs(vector[i]), 1e-2)
        moved = [vector + step * s * (np.arange(len(vector)) == i) for s in (1, -1)]
        ahead, behind = (residuals(layout.state(v), corners).reshape(-1) for v in moved)
        numeric = -(ahead - behind) / (2 * step)
        assert np.allclose(
            analytic[:, i], numeric, rtol=1e-4, atol=1e-4 * max(1, np.abs(numeric).max())
        )


def test_a_known_rig_is_found_again(rig, poses, rng):
    cameras = [views_of(camera, BOARD, poses, rng) for camera in rig]
    found = calibrate_rig(BOARD, cameras)
    assert_same_rig(found.rig, rig, found.report, centre_mm=0.5)
    assert found.report.sigma_px == pytest.approx(NOISE_PX, rel=0.1)
    assert [pair.common_views > 0 for pair in found.report.pairs] == [True] * 3
    for pair in found.report.pairs:
        a, b = (rig[name] for name in pair.names)
        assert pair.baseline_m == pytest.approx(np.linalg.norm(a.centre - b.centre), abs=5e-4)
    for seen, left in zip(found.cameras, found.residuals, strict=True):
        for view, off in list(zip(seen.shared, left, strict=False))[::7]:
            pose = found.T_world_board[view.frame]
            corners = BOARD.points[view.ids] @ pose[:3, :3].T + pose[:3, 3]
            camera = found.rig[seen.name]
            there, _ = cv2.projectPoints(
                camera.to_camera(corners),
                np.zeros(3),
                np.zeros(3),
                camera.matrix,
                camera.distortions,
            )
            np.testing.assert_allclose(off, view.pixels - there[:, 0], atol=1e-6)


def test_cameras_that_never_share_a_view_are_chained(rig, poses, rng):
    """a and c never see the board together; b binds them."""
    frames = {"a": range(25), "b": range(40), "c": range(25, 40)}
    cameras = [views_of(camera, BOARD, poses, rng, frames[camera.name]) for camera in rig]
    found = calibrate_rig(BOARD, cameras)
    assert_same_rig(found.rig, rig, found.report, centre_mm=1.5)
    assert {pair.names for pair in found.report.pairs} == {("a", "b"), ("b", "c")}


def test_a_wrong_view_is_left_out_and_named(rig, poses, rng):
    cameras = [views_of(camera, BOARD, poses, rng) for camera in rig]
    first = cameras[0].shared[3]
    shifted = replace(
        first, pixels=first.pixels * [1.0, 0.93] + 5 * rng.normal(size=first.pixels.shape)
    )
    cameras[0] = replace(
        cameras[0], shared=(*cameras[0].shared[:3], shifted, *cameras[0].shared[4:])
    )
    found = calibrate_rig(BOARD, cameras)
    assert_same_rig(found.rig, rig, found.report, centre_mm=0.6)
    assert any(f"left out frame {first.frame}" in text for text in found.report.warnings)


def test_a_board_that_looks_alike_when_turned_is_settled_by_agreement(rig, rng):
    """An even x even board, numbered from either end at random in each camera and view."""
    board = parse_board("chessboard:8x6:25mm")
    poses = board_poses(board, 24, rng, spread=0.08)
    cameras = []
    for camera in rig:
        seen = views_of(camera, board, poses, rng)
        turned = tuple(
            replace(view, ids=board.turns[1][view.ids]) if rng.random() < 0.5 else view
            for view in seen.shared
        )
        cameras.append(replace(seen, shared=turned))
    found = calibrate_rig(board, cameras)
    assert_same_rig(found.rig, rig, found.report, centre_mm=1.0)
    assert "looks the same after half a turn" in found.report.warnings[0]


def test_cameras_that_are_not_synchronised_are_told_by_how_much(rig, poses, rng):
    """The second camera's frames are numbered two too high."""
    cameras = [views_of(camera, BOARD, poses, rng) for camera in rig]
    late = tuple(replace(view, frame=view.frame + 2) for view in cameras[1].shared)
    found = calibrate_rig(BOARD, [cameras[0], replace(cameras[1], shared=late), cameras[2]])
    (told,) = found.report.contradictions
    assert "with the frames of 'b' shifted by -2 they agree" in told
    assert found.report.cameras[1].lens["fx"] == pytest.approx(rig["b"].matrix[0, 0], rel=0.01)
    assert any("'b' fits by" in text for text in found.report.doubts)


def test_the_world_can_be_a_board(rig, poses, rng):
    cameras = [views_of(camera, BOARD, poses[:12], rng) for camera in rig]
    frame = cameras[0].shared[0].frame
    found = calibrate_rig(BOARD, cameras, CalibrationSettings(world=f"board:{frame}"))
    seen = found.rig["a"].project(BOARD.points * [1, -1, 1])  # y up the print, z out of it
    assert np.abs(seen - cameras[0].shared[0].pixels).max() < 0.6
    assert (found.rig["a"].centre[2] > 0.2) and (found.rig["b"].centre[2] > 0.2)
    with pytest.raises(
        HandtrackError,
        match=r"--world board:99: expected camera:NAME \(of a, b, c\) or board:FRAME",
    ):
        calibrate_rig(BOARD, cameras, CalibrationSettings(world="board:99"))


def test_known_lenses_are_kept(rig, poses, rng):
    cameras = [views_of(camera, BOARD, poses[:4], rng) for camera in rig]
    found = calibrate_rig(BOARD, cameras, CalibrationSettings(known=rig))
    for got, true in zip(found.rig, rig, strict=True):
        assert np.array_equal(got.matrix, true.matrix)
        assert np.array_equal(got.distortions, true.distortions)
    assert found.report.cameras[0].lens_std["fx"] == 0


def test_groups_that_share_no_view_are_named(rig, poses, rng):
    frames = {"a": range(20), "b": range(20), "c": range(20, 40)}
    cameras = [views_of(camera, BOARD, poses, rng, frames[camera.name]) for camera in rig]
    with pytest.raises(
        HandtrackError, match=re.escape("groups that share no view of the board: 'a', 'b' | 'c'.")
    ):
        calibrate_rig(BOARD, cameras)


def test_too_few_views(rig, poses, rng):
    cameras = [views_of(camera, BOARD, poses[:2], rng) for camera in rig]
    with pytest.raises(
        HandtrackError, match="the board was found in 2 of 2 images; at least 3 are needed"
    ):
        calibrate_rig(BOARD, cameras)


def test_no_board_and_a_board_of_another_size(rig):
    blind = CameraViews("a", (480, 360), (), (), 5, "a*.png")
    with pytest.raises(
        HandtrackError,
        match=r"no chessboard:9x6:25mm board was found in any of 5 images of camera 'a'",
    ):
        require_views(BOARD, [blind], lambda: [np.full((360, 480), 128, np.uint8)])
    picture = BoardPhotographer(rig["a"], BOARD).picture(
        board_poses(BOARD, 1, np.random.default_rng(1), spread=0.01)[0]
    )
    with pytest.raises(
        HandtrackError,
        match=r"There is a chessboard of 9 x 6 inner corners: use --board chessboard:9x6:25mm",
    ):
        require_views(parse_board("chessboard:10x7:25mm"), [blind], lambda: [picture])


def test_images_of_two_sizes_are_refused(tmp_path):
    for number, size in enumerate([(60, 80), (60, 81)]):
        cv2.imwrite(str(tmp_path / f"{number}.png"), np.zeros(size, np.uint8))
    source = ImageFiles(sorted(tmp_path.glob("*.png")))
    with pytest.raises(
        HandtrackError, match=r"1\.png is 81 x 60, but .*0\.png of the same camera is 80 x 60"
    ):
        search_views(source, BOARD, source.frames)


def test_views_are_chosen_sharp_and_spread(rig, poses, rng):
    seen = views_of(rig["a"], BOARD, poses, rng)
    blurred = {view.frame for view in seen.shared[::7]}
    cameras = [
        replace(
            seen,
            shared=tuple(replace(v, blur_px=9.0) if v.frame in blurred else v for v in seen.shared),
        )
    ]
    chosen = choose_views(cameras, most=10)[0]
    assert len(chosen.shared) == 10
    assert not blurred & {view.frame for view in chosen.shared}
    everything = np.stack([view.pixels.mean(axis=0) for view in seen.shared])
    kept = np.stack([view.pixels.mean(axis=0) for view in chosen.shared])
    assert (np.ptp(kept, axis=0) > 0.7 * np.ptp(everything, axis=0)).all()


@pytest.mark.parametrize("text", ["chessboard:8x5:25mm", "charuco:7x5:30mm:22mm:DICT_4X4_50"])
def test_from_pictures_to_calibration_file(tmp_path, capsys, rig, text):
    """Pictures of a board with noise, as numbered files and as a video, through the command line."""
    board = parse_board(text)
    rng = np.random.default_rng(7)
    poses = board_poses(board, 12, rng, spread=0.08)
    arguments = []
    for camera in rig.cameras[:2]:
        photographer = BoardPhotographer(camera, board)
        (tmp_path / camera.name).mkdir()
        for frame, pose in enumerate(poses):
            cv2.imwrite(
                str(tmp_path / camera.name / f"{frame:03d}.png"), photographer.picture(pose, rng)
            )
        arguments += ["--camera", f"{camera.name}={tmp_path / camera.name}/*.png"]
    out = tmp_path / "calibration.toml"
    assert (
        main(["calibrate", "--out", str(out), "--board", text, "--no-k3", "--json", *arguments])
        == 0
    )
    report = json.loads(capsys.readouterr().out)
    assert all(camera["rms_px"] < 0.3 for camera in report["cameras"])
    found = read_rig(out)
    first = rig.cameras[0]
    assert np.linalg.norm(found["b"].centre - first.to_camera(rig["b"].centre)) < 2e-3
    assert found["a"].matrix[0, 0] == pytest.approx(first.matrix[0, 0], rel=0.005)
    for name in ("calibration_rig.png", "calibration_residuals.png"):
        assert cv2.imread(str(tmp_path / name)) is not None
    assert "baseline mm" in (tmp_path / "calibration_report.txt").read_text()


def test_a_video_of_a_moving_board(tmp_path, capsys, rig):
    board = parse_board("chessboard:7x4:30mm")
    rng = np.random.default_rng(3)
    keys = board_poses(board, 9, rng, spread=0.06)
    photographer = BoardPhotographer(rig["a"], board)
    path = tmp_path / "a.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 25, rig["a"].size)
    for pose in keys:
        picture = cv2.cvtColor(photographer.picture(pose, rng), cv2.COLOR_GRAY2BGR)
        for _ in range(2):
            writer.write(picture)
    writer.release()
    out = tmp_path / "a.toml"
    arguments = [
        "--board",
        "chessboard:7x4:30mm",
        "--camera",
        f"a={path}",
        "--no-k3",
        "--no-tangential",
    ]
    assert main(["calibrate", "--out", str(out), *arguments]) == 0
    assert read_rig(out)["a"].matrix[0, 0] == pytest.approx(430, rel=0.02)
    assert "skew that would fit" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--camera", "left"], "--camera left: expected NAME=FILES, such as left=left*.jpg"),
        (["--camera", "left=nothing*.png"], "--camera left: nothing found at nothing*.png"),
        ([], "no camera given: --camera NAME=FILES"),
        (["--bayer", "RGB"], "no Bayer pattern 'RGB' in --bayer; known: RGGB, BGGR, GRBG, GBRG"),
    ],
)
def test_the_command_explains_what_is_wrong(tmp_path, capsys, arguments, message):
    out = str(tmp_path / "c.toml")
    assert main(["calibrate", "--out", out, "--board", "chessboard:9x6:25mm", *arguments]) == 2
    assert message in capsys.readouterr().err


def test_a_board_to_print(tmp_path, capsys):
    out = tmp_path / "board.svg"
    assert main(["board", "--out", str(out), "--board", "chessboard:9x6:25mm"]) == 0
    told = capsys.readouterr().out
    assert "page 275 x 200 mm (fits A4). Print at 100 %" in told
    assert "10 squares must be 250 mm wide" in told


def test_against_opencv_s_stereo_chessboard(data_dir):
    """13 real pairs; published with all five coefficients free (its README)."""
    folder = data_dir / "opencv_stereo_chessboard"
    if not folder.is_dir():
        pytest.skip(f"no {folder}")
    cameras = []
    for side in ("left", "right"):
        source = ImageFiles(sorted(folder.glob(f"{side}??.jpg")))
        views, size, tried = search_views(source, BOARD, source.frames)
        cameras.append(CameraViews(side, size, tuple(views), (), tried, str(folder)))
    assert [len(camera.shared) for camera in cameras] == [13, 13]
    found = calibrate_rig(BOARD, cameras)
    left, right = found.report.cameras
    assert left.rms_px < 0.20
    assert right.rms_px < 0.21
    assert found.report.pairs[0].baseline_m == pytest.approx(0.0832, abs=2e-4)
    published = {
        "fx": (532.83, 1.5),
        "fy": (532.94, 1.5),
        "cx": (342.49, 1.5),
        "cy": (233.86, 1.5),
        "k1": (-0.281, 0.01),
    }
    for name, (value, within) in published.items():
        assert left.lens[name] == pytest.approx(value, abs=within), name
    published = {
        "fx": (537.45, 1.5),
        "fy": (536.97, 1.5),
        "cx": (327.59, 1.5),
        "cy": (248.88, 1.5),
        "k1": (-0.298, 0.01),
    }
    for name, (value, within) in published.items():
        assert right.lens[name] == pytest.approx(value, abs=within), name
    turn = np.rad2deg(cv2.Rodrigues(found.rig["right"].rotation)[0]).ravel()
    assert np.allclose(turn, [0.39, 0.22, -0.22], atol=0.1)
    assert np.allclose(found.rig["right"].translation / 0.025, [-3.328, 0.037, 0.014], atol=0.03)


def test_against_pose2sim_s_boards(data_dir):
    """Seven photographs a camera; the focal lengths of the session's own calibration, within 1 %."""
    folder = data_dir / "pose2sim_body_4cam" / "intrinsics"
    if not folder.is_dir():
        pytest.skip(f"no {folder}")
    board = parse_board("chessboard:4x7:60mm")
    text = (folder.parent / "Calib.qca.txt").read_text()
    focal = [float(v) / 64 for v in re.findall(r'focalLengthU="([\d.]+)"', text)]
    for name, expected in (("cam01", focal[0]), ("cam03", focal[2])):
        source = ImageFiles(sorted((folder / name).glob("*.jpg")))
        views = [v for f in source.frames if (v := _quickly(source, f, board)) is not None]
        camera = CameraViews(name, source.size, (), tuple(views), 7, str(folder))
        found = calibrate_rig(board, [camera])
        assert len(views) >= 6
        assert found.report.cameras[0].rms_px < 0.35
        assert found.report.cameras[0].lens["fx"] == pytest.approx(expected, rel=0.01)


def _quickly(source, frame, board):
    """Return the view without the slow second search, to keep the test quick."""
    from handtrack.capture.calibration.board_detection import find_board

    image = source.read(frame)
    return None if image is None else find_board(image, board, frame)
