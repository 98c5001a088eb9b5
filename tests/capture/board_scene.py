"""Calibration boards before known cameras."""

import cv2
import numpy as np

from handtrack import Camera, CameraRig
from handtrack.capture.calibration.boards import Board, CharucoBoard, draw_board, page_size_mm
from handtrack.geometry.rotation import looking_along, rotation_matrix
from tests.cameras import pinhole

_PER_MM = 4.0


def looking_at(name, size, focal, centre, target, distortions=(0, 0, 0, 0, 0)) -> Camera:
    """Return a camera at `centre` looking at `target`, world y down."""
    forward = np.subtract(target, centre)
    rotation = looking_along(forward / np.linalg.norm(forward), np.array([0.0, 1.0, 0.0]))
    at = size[0] / 2 + 3, size[1] / 2 - 5
    return pinhole(
        name, size, (focal, 1.004 * focal), rotation, -rotation @ centre, distortions, at
    )


def board_poses(board: Board, count: int, rng, spread=0.05):
    """Return T_world_board (4, 4) of a board waved about (0, 0, 0.45), its front to the cameras."""
    middle = np.append(board.points[:, :2].mean(axis=0), 0)
    poses = []
    for _ in range(count):
        pose = np.eye(4)
        turn = np.append(rng.uniform(-0.55, 0.55, 2), rng.uniform(-0.35, 0.35))
        pose[:3, :3] = rotation_matrix(turn)
        place = np.array([0, 0, 0.45]) + rng.uniform(-1, 1, 3) * [spread, spread, 1.4 * spread]
        pose[:3, 3] = place - pose[:3, :3] @ middle
        poses.append(pose)
    return poses


def seen_pixels(camera: Camera, board: Board, pose) -> np.ndarray:
    """Return where the camera sees the board's corners (N, 2), exactly."""
    return camera.project(board.points @ pose[:3, :3].T + pose[:3, 3])


def photograph(camera: Camera, board: CharucoBoard, pose, rng) -> np.ndarray:
    """Return the image (H, W) uint8 of a board at T_world_board by a camera without distortion."""
    page, pixel = draw_board(board, _PER_MM), 1e-3 / _PER_MM
    margin = 0.5e-3 * page_size_mm(board)[0] - 0.5 * board.squares[0] * board.square_m
    to_board = np.array([[pixel, 0, pixel / 2 - margin], [0, pixel, pixel / 2 - margin], [0, 0, 1]])
    turn, twice = camera.rotation @ pose[:3, :3], np.array([[2, 0, 0.5], [0, 2, 0.5], [0, 0, 1]])
    seen = np.column_stack([turn[:, :2], camera.to_camera(pose[:3, 3])])
    width, height = camera.size
    fine = cv2.warpPerspective(
        page, twice @ camera.matrix @ seen @ to_board, (2 * width, 2 * height), borderValue=120
    )  # fmt: skip
    image = 0.8 * cv2.resize(fine, camera.size, interpolation=cv2.INTER_AREA) + 20
    return np.clip(np.round(rng.normal(image, 2.0)), 0, 255).astype(np.uint8)


def three_cameras() -> CameraRig:
    """Return a rig of three distorted cameras about 45 cm from where boards are waved."""
    size, middle = (480, 360), (0, 0, 0.45)
    return CameraRig(
        (
            looking_at("a", size, 430, (-0.12, 0.0, 0.0), middle, (-0.2, 0.06, 1e-3, -5e-4, 0.0)),
            looking_at("b", size, 445, (0.1, -0.03, 0.02), middle, (-0.15, 0.02, 0.0, 1e-3, 0.0)),
            looking_at("c", size, 420, (0.28, 0.05, 0.12), middle, (-0.18, 0.04, 0.0, 0.0, 0.0)),
        )
    )
