"""Calibration by photographs of real boards agrees with published values."""

import re

import cv2
import numpy as np
import pytest

from handtrack.capture.calibration.board_detection import find_board
from handtrack.capture.calibration.board_views import CameraViews, search_views
from handtrack.capture.calibration.boards import parse_board
from handtrack.capture.calibration.rig_calibration import calibrate_rig
from handtrack.capture.images.frames import ImageFiles

BOARD = parse_board("chessboard:9x6:25mm")


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
    image = source.read(frame)
    return None if image is None else find_board(image, board, frame)
