"""Finds a calibration board in one image: numbered inner corners to a fraction of a pixel."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from handtrack.arrays import D2, Array, Axes, Bytes, Floats, H, Ints, N, W
from handtrack.capture.calibration.boards import Board, CharucoBoard, Chessboard

_FLAGS = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
_LARGE = 2000  # [px] longer side above which corners are first looked for in a half-size image
_LEAST_CORNERS = 8  # of a ChArUco board that is partly seen; a pose needs four, a check more


@dataclass(frozen=True)
class BoardView:
    """A board as one camera saw it in one frame."""

    frame: int
    ids: Ints[N]
    """rows of the board's `points`."""
    pixels: Floats[N, D2]
    blur_px: float
    """width of the board's edges [px]: about 1.5 to 2 in a sharp image."""
    source: str = ""
    """file or frame, for messages."""
    goes_on: bool = False
    """whether the squares go on beyond the board's edge: the board is larger than was said."""


def find_board(
    image: Array[H, W, *Axes],
    board: Board,
    frame: int = 0,
    source: str = "",
    thorough: bool = False,
) -> BoardView | None:
    """Return the board in an image (H, W[, 3]) uint8, None where it is not (fully) seen.

    thorough: take a second or two an image for hard ones: blurred, or lit unevenly.
    """
    gray: Bytes = (
        image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)
    )
    if isinstance(board, CharucoBoard):
        found = _find_charuco(gray, board)
    else:
        found = _find_chessboard(gray, board, thorough)
    if found is None:
        return None
    ids, pixels = found
    goes_on = isinstance(board, Chessboard) and _goes_on(gray, board, pixels)
    return BoardView(frame, ids, pixels, _blur(gray, board, ids, pixels), source, goes_on)


def _find_charuco(gray: Bytes, board: CharucoBoard) -> tuple[Ints, Floats] | None:
    corners, ids, *_ = cv2.aruco.CharucoDetector(board.cv2_board).detectBoard(gray)
    if ids is None or len(ids) < _LEAST_CORNERS:
        return None
    numbers = np.array(ids, dtype=np.int64).reshape(-1)
    rows, columns = np.divmod(numbers, board.columns - 1)
    if len(np.unique(rows)) < 2 or len(np.unique(columns)) < 2:
        return None  # all in one line: no pose
    pixels = np.array(corners, dtype=float).reshape(-1, 2)
    # OpenCV 4's own refinement leaves half a pixel where markers are large; 5's does not
    sides = _grid_lines(board, numbers, pixels)
    side = float(np.linalg.norm(sides[:, 1] - sides[:, 0], axis=1).min()) if len(sides) else 0.0
    return numbers, _refined(gray, pixels, side * _free(board))


def _find_chessboard(gray: Bytes, board: Chessboard, thorough: bool) -> tuple[Ints, Floats] | None:
    size = (board.columns, board.rows)
    half = max(gray.shape) > _LARGE
    searched = cv2.pyrDown(gray) if half else gray
    found, corners = cv2.findChessboardCorners(searched, size, flags=_FLAGS)
    if not found and thorough:
        flags = cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
        found, corners = cv2.findChessboardCornersSB(searched, size, flags=flags)
    if not found:
        return None
    pixels = np.array(corners, dtype=float).reshape(-1, 2) * (2 if half else 1)
    grid = _oriented(gray, pixels.reshape(board.rows, board.columns, 2))
    if grid is None:
        return None
    sides = [np.linalg.norm(np.diff(grid, axis=axis), axis=-1).min() for axis in (0, 1)]
    return np.arange(len(pixels)), _refined(gray, grid.reshape(-1, 2), min(sides) * _free(board))


def _free(board: Board) -> float:
    """Return how far from a corner there is nothing but its own edges, as a share of the square."""
    if isinstance(board, CharucoBoard):
        return 0.45 * (1 - board.marker_m / board.square_m)
    return 0.35


def _refined(gray: Bytes, pixels: Floats, free_px: float) -> Floats:
    """Return corners (N, 2) moved to where their edges meet, looking `free_px` about them."""
    window = int(np.clip(free_px, 2, 11))
    points = np.ascontiguousarray(pixels.reshape(-1, 1, 2), dtype=np.float32)
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 60, 1e-3)
    refined = cv2.cornerSubPix(gray, points, (window, window), (-1, -1), stop)
    return np.array(refined, dtype=float).reshape(-1, 2)


def _oriented(gray: Bytes, grid: Floats) -> Floats | None:
    """Return corners (rows, columns, 2) numbered as the board is: not mirrored, first square black.

    The detectors number from either end. Where colours leave a choice, the numbering whose first
    corner is nearest to the image's upper left is taken. None when no numbering fits the colours.
    """
    turned = [np.rot90(grid, k) for k in range(4)]
    ways = [way for way in (*turned, *(way[:, ::-1] for way in turned)) if way.shape == grid.shape]
    fitting = [way for way in ways if not _mirrored(way) and _black_first(gray, way)]
    return min(fitting, key=lambda way: float(way[0, 0].sum()), default=None)


def _mirrored(grid: Floats) -> bool:
    right = grid[:, -1].mean(axis=0) - grid[:, 0].mean(axis=0)
    down = grid[-1].mean(axis=0) - grid[0].mean(axis=0)
    return bool(right[0] * down[1] - right[1] * down[0] < 0)


def _black_first(gray: Bytes, grid: Floats) -> bool:
    """Whether the squares like the one between the first four corners are darker than the others."""
    centres = (grid[:-1, :-1] + grid[1:, :-1] + grid[:-1, 1:] + grid[1:, 1:]) / 4
    column = np.clip(centres[..., 0].round().astype(int), 0, gray.shape[1] - 1)
    row = np.clip(centres[..., 1].round().astype(int), 0, gray.shape[0] - 1)
    value = cv2.GaussianBlur(gray, (3, 3), 0)[row, column].astype(float)
    like_first = np.add.outer(np.arange(value.shape[0]), np.arange(value.shape[1])) % 2 == 0
    return bool(value[like_first].mean() < value[~like_first].mean())


def _goes_on(gray: Bytes, board: Chessboard, pixels: Floats) -> bool:
    """Whether squares alternate beyond the outer ones, on some side; a detector may find a part of a
    larger board at a smaller size."""
    columns, rows = board.columns, board.rows
    corners = board.points[:, :2] / board.square_m
    homography, _ = cv2.findHomography(corners, pixels)
    if homography is None:
        return False
    along_x, along_y = np.arange(columns - 1) + 0.5, np.arange(rows - 1) + 0.5
    inner = np.stack(np.meshgrid(along_x, along_y), -1).reshape(-1, 2)
    contrast = _alternation(gray, inner, homography)
    just = (
        0.2  # of a square beyond the outer ones, as the last squares of some boards are cut narrow
    )
    sides = [
        *(np.stack([along_x, np.full(columns - 1, y)], -1) for y in (-1 - just, rows + just)),
        *(np.stack([np.full(rows - 1, x), along_y], -1) for x in (-1 - just, columns + just)),
    ]
    return any(_alternation(gray, side, homography) > 0.5 * contrast for side in sides)


def _alternation(gray: Bytes, cells: Floats, homography: Array) -> float:
    """Return how much brighter the white squares among cells (N, 2) are than the black ones; 0 when
    they are not in the image."""
    places = cv2.perspectiveTransform(cells[:, None], homography)[:, 0].round().astype(int)
    height, width = gray.shape
    inside = ((places >= 0) & (places < [width, height])).all(axis=1)
    black = np.floor(cells).sum(axis=1) % 2 == 0
    if not (inside & black).any() or not (inside & ~black).any():
        return 0.0
    values = gray[places[:, 1].clip(0, height - 1), places[:, 0].clip(0, width - 1)].astype(float)
    return float(values[inside & ~black].mean() - values[inside & black].mean())


def _blur(gray: Bytes, board: Board, ids: Ints, pixels: Floats) -> float:
    """Return the width of the board's edges [px].

    An edge of contrast C and width w has ∫ |∇I|² = C² / w across it, so that w is C² times the
    edges' length over the sum of |∇I|² along them, here in strips about the grid's lines.
    """
    segments = _grid_lines(board, ids, pixels)
    if not len(segments):
        return float("inf")
    start, end = segments[:, 0], segments[:, 1]
    length = np.linalg.norm(end - start, axis=1)
    reach = float(np.clip(_free(board) * np.median(length), 2, 12))
    along = start[:, None] + (end - start)[:, None] * np.linspace(0.25, 0.75, 9)[None, :, None]
    normal = np.stack([-(end - start)[:, 1], (end - start)[:, 0]], -1) / length[:, None]
    across = np.arange(-reach, reach + 0.25, 0.5)
    points = along[:, :, None] + normal[:, None, None] * across[None, None, :, None]
    flat = points.reshape(len(segments) * along.shape[1], len(across), 2).astype(np.float32)
    profile = cv2.remap(gray, flat, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)  # type: ignore[call-overload]
    profile = profile.astype(float)
    contrast = np.abs(profile[:, -1] - profile[:, 0])
    energy = (np.diff(profile, axis=1) ** 2).sum(axis=1) / 0.5
    clear = contrast > 0.5 * np.median(contrast)
    widths = contrast[clear] ** 2 / np.maximum(energy[clear], 1e-9)
    return float(np.median(widths)) if clear.any() else float("inf")


def _grid_lines(board: Board, ids: Ints, pixels: Floats) -> Floats:
    """Return (L, 2, 2) the sides of squares, ends in pixels, whose two corners were found."""
    place = {
        tuple(np.round(board.points[i, :2] / board.square_m).astype(int)): p
        for i, p in zip(ids, pixels)
    }
    lines = [
        (p, place[near])
        for (column, row), p in place.items()
        for near in ((column + 1, row), (column, row + 1))
        if near in place
    ]
    return np.array(lines, dtype=float).reshape(-1, 2, 2)
