"""`handtrack new` with videos that do not simply go together."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from handtrack.session.bundled import bundled_session
from handtrack.session.session import Session
from tests.app.command_line import CommandLine


def video(path: Path, fps: float, count: int, size: tuple[int, int]) -> Path:
    """Write a video whose frame n is n grey levels bright, times 8."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), fps, size)
    for level in range(count):
        writer.write(np.full((size[1], size[0], 3), 8 * level, np.uint8))
    writer.release()
    return path


def test_c11_scaled_videos_are_taken_where_that_is_said(
    handtrack: CommandLine, tmp_path: Path
) -> None:
    calibration = bundled_session() / "calibration.toml"
    width, height = Session.open(bundled_session()).rig["cam0"].size
    small = video(tmp_path / "small.avi", 25, 3, (width // 2, height // 2))
    cut = video(tmp_path / "cut.avi", 25, 3, (width, height // 2))
    words = ["new", "--out", tmp_path / "made", "--calibration", calibration, "--masks", "none"]
    refused = handtrack(*words, "--video", f"cam0={small}")
    assert refused.code == 2
    assert "0.5 times as large" in refused.err
    assert "`handtrack new --scaled`" in refused.err
    refused = handtrack(*words, "--scaled", "--video", f"cam0={cut}")
    assert refused.code == 2
    assert "scale its matrix and size" in refused.err
    assert handtrack(*words, "--scaled", "--video", f"cam0={small}").code == 0
    assert Session.open(tmp_path / "made").rig["cam0"].size == (width // 2, height // 2)


def test_c7_videos_of_different_rates_are_joined_by_time(
    handtrack: CommandLine, tmp_path: Path
) -> None:
    calibration = bundled_session() / "calibration.toml"
    size = Session.open(bundled_session()).rig["cam0"].size
    slow, fast = (video(tmp_path / f"{fps}.avi", fps, fps // 5, size) for fps in (25, 100))
    ended = handtrack(
        "new", "--out", tmp_path / "made", "--calibration", calibration, "--masks", "none",
        "--video", f"cam0={slow}", "--video", f"cam1={fast}",
    )  # fmt: skip
    assert ended.code == 0
    assert "the video of camera 'cam1' says 100 frames a second, the first 25" in ended.err
    session = Session.open(tmp_path / "made")
    assert [camera.fps for camera in session.file.cameras] == [None, 100.0]
    seen = [session.image(name, 4) for name in session.camera_names]
    levels = [-1 if image is None else round(float(image.mean()) / 8) for image in seen]
    assert levels == [4, 16]
