"""Images of calibration boards by known cameras: every pixel's ray is cut with the board's plane."""

import cv2
import numpy as np
from scipy.ndimage import map_coordinates

from handtrack import Camera, CameraRig
from handtrack.capture.calibration.boards import Board, Chessboard, draw_board, page_size_mm
from handtrack.geometry.rotation import rotation_matrix

_PER_MM = 4.0


def looking_at(name, size, focal, centre, target, distortions=(0, 0, 0, 0, 0)) -> Camera:
    """Return a camera at `centre` looking at `target`, world y down."""
    forward = np.array(target, float) - centre
    forward /= np.linalg.norm(forward)
    right = np.cross([0.0, 1.0, 0.0], forward)
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    matrix = np.array([[focal, 0, size[0] / 2 + 3], [0, focal * 1.004, size[1] / 2 - 5], [0, 0, 1]])
    return Camera(
        name,
        size,
        matrix,
        np.array(distortions, float),
        rotation,
        -rotation @ np.array(centre, float),
    )


def board_poses(board: Board, count: int, rng, distance=0.45, tilt=0.55, spread=0.05):
    """Return T_world_board (4, 4) of a board waved about (0, 0, distance), its front to the cameras."""
    middle = np.append(board.points[:, :2].mean(axis=0), 0)
    poses = []
    for _ in range(count):
        pose = np.eye(4)
        turn = np.append(rng.uniform(-tilt, tilt, 2), rng.uniform(-0.35, 0.35))
        pose[:3, :3] = rotation_matrix(turn)
        place = np.array([0, 0, distance]) + rng.uniform(-1, 1, 3) * [spread, spread, 1.4 * spread]
        pose[:3, 3] = place - pose[:3, :3] @ middle
        poses.append(pose)
    return poses


def seen_pixels(camera: Camera, board: Board, pose) -> np.ndarray:
    """Return where the camera sees the board's corners (N, 2), exactly."""
    return camera.project(board.points @ pose[:3, :3].T + pose[:3, 3])


class BoardPhotographer:
    """Takes pictures of one board with one camera; the lens is traced once."""

    def __init__(self, camera: Camera, board: Board) -> None:
        self._camera = camera
        self._page = draw_board(board, _PER_MM)
        margin = (page_size_mm(board)[0] - board.squares[0] * board.square_m * 1e3) / 2
        # the board's origin is its first inner corner, or the outer corner of a ChArUco board
        inside = board.square_m * 1e3 if isinstance(board, Chessboard) else 0.0
        self._origin_mm = margin + inside
        width, height = camera.size
        u, v = np.meshgrid(np.arange(2 * width) / 2 - 0.25, np.arange(2 * height) / 2 - 0.25)
        # the lens is smooth: trace it on a coarse grid and interpolate
        coarse = np.stack(np.meshgrid(np.linspace(-1, width, 60), np.linspace(-1, height, 60)), -1)
        traced = camera.undistort_points(coarse)
        at = [(v + 1) / (height + 1) * 59, (u + 1) / (width + 1) * 59]
        # not cv2.remap: its steps of 1/32 of a coarse cell would be a quarter of a pixel
        straight = np.stack([map_coordinates(traced[..., i], at, order=3) for i in range(2)], -1)
        flat = (straight - camera.matrix[:2, 2]) / np.diag(camera.matrix)[:2]
        self._rays = np.concatenate([flat, np.ones_like(flat[..., :1])], -1)

    def picture(self, pose, rng=None, noise=2.0) -> np.ndarray:
        """Return the image (H, W) uint8 of the board at T_world_board."""
        camera = self._camera
        turn = camera.rotation @ pose[:3, :3]
        shift = camera.rotation @ pose[:3, 3] + camera.translation
        plane = np.linalg.inv(np.column_stack([turn[:, 0], turn[:, 1], shift]))
        on_board = self._rays @ plane.T
        place = on_board[..., :2] / on_board[..., 2:] * 1e3 + self._origin_mm
        at = (place * _PER_MM - 0.5).astype(np.float32)
        fine = cv2.remap(
            self._page,
            at[..., 0],
            at[..., 1],
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=120,
        )
        height, width = fine.shape[0] // 2, fine.shape[1] // 2
        image = fine.reshape(height, 2, width, 2).mean(axis=(1, 3)) * 0.8 + 20
        if rng is not None:
            image = image + rng.normal(size=image.shape) * noise
        return np.clip(np.round(image), 0, 255).astype(np.uint8)


def three_cameras(size=(480, 360)) -> CameraRig:
    """Return a rig of three distorted cameras about 45 cm from where boards are waved."""
    middle = (0, 0, 0.45)
    return CameraRig(
        (
            looking_at("a", size, 430, (-0.12, 0.0, 0.0), middle, (-0.2, 0.06, 1e-3, -5e-4, 0.0)),
            looking_at("b", size, 445, (0.1, -0.03, 0.02), middle, (-0.15, 0.02, 0.0, 1e-3, 0.0)),
            looking_at("c", size, 420, (0.28, 0.05, 0.12), middle, (-0.18, 0.04, 0.0, 0.0, 0.0)),
        )
    )
