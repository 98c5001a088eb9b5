"""Where cameras stand relative to one another, from boards that two of them saw in the same frame.

Not all cameras need to see one board: pairs are chained, the pairs with most common views first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from handtrack.arrays import D3, D4, C, Floats, K
from handtrack.capture.calibration.board_detection import BoardView
from handtrack.capture.calibration.board_views import CameraViews
from handtrack.capture.calibration.boards import Board
from handtrack.errors import HandtrackError

_MOST_LATE = 60  # frames
_TURN_M = 1.0  # a degree of disagreement counts as much as 1.7 % of the distance to the board


@dataclass(frozen=True)
class Placed:
    """A first estimate of the rig."""

    cameras: tuple[CameraViews, ...]
    """the same views; of a board that looks alike when turned, renumbered to agree"""
    T_camera_world: Floats[C, D4, D4]
    T_world_board: dict[int, Floats[D4, D4]]
    """by frame, of shared views"""
    disagreement: dict[tuple[str, str], float]
    """median share of the board's distance by which common views disagree about a pair"""


def pose_of_view(
    view: BoardView, board: Board, matrix: Floats[D3, D3], distortions: Floats[K]
) -> Floats[D4, D4]:
    """Return T_camera_board of one view, the better of a plane's two poses."""
    points = board.points[view.ids]
    count, turns, shifts, errors = cv2.solvePnPGeneric(
        points, view.pixels.reshape(-1, 1, 2), matrix, distortions, flags=cv2.SOLVEPNP_IPPE
    )
    if not count:
        _, turn, shift = cv2.solvePnP(points, view.pixels, matrix, distortions)
    else:
        best = int(np.argmin([float(np.ravel(e)[0]) for e in errors]))
        turn, shift = cv2.solvePnPRefineLM(
            points, view.pixels, matrix, distortions, turns[best], shifts[best]
        )
    pose = np.eye(4)
    pose[:3, :3] = cv2.Rodrigues(turn)[0]
    pose[:3, 3] = np.ravel(shift)
    return pose


def common_frames(a: CameraViews, b: CameraViews) -> list[int]:
    """Return the frames in which both cameras saw the board, ascending."""
    return sorted({view.frame for view in a.shared} & {view.frame for view in b.shared})


def place_cameras(
    cameras: Sequence[CameraViews], poses: Sequence[dict[int, Floats[D4, D4]]], board: Board
) -> Placed:
    """Return all cameras in the first one's frame.

    poses: per camera T_camera_board by frame. Raises HandtrackError naming the groups of cameras that
    share no view.
    """
    edges = {
        (i, j): common_frames(cameras[i], cameras[j])
        for i in range(len(cameras))
        for j in range(i + 1, len(cameras))
    }
    _require_connected(cameras, edges)
    turns = _turn_transforms(board)
    poses = [dict(own) for own in poses]
    placed: dict[int, Floats] = {0: np.eye(4)}
    boards = dict(poses[0])
    renumbered = list(cameras)
    disagreement: dict[tuple[str, str], float] = {}
    while len(placed) < len(cameras):
        near, new = max(
            ((i, j) if i in placed else (j, i) for i, j in edges if (i in placed) != (j in placed)),
            key=lambda pair: (len(edges[min(pair), max(pair)]), -pair[1]),
        )
        frames = edges[min(near, new), max(near, new)]
        T_new_near, off = _agreed(
            [poses[new][f] for f in frames], [poses[near][f] for f in frames], turns
        )
        disagreement[cameras[near].name, cameras[new].name] = off
        placed[new] = T_new_near @ placed[near]
        renumbered[new] = _renumbered(cameras[new], poses[new], placed[new], boards, turns, board)
        for frame, pose in poses[new].items():
            boards.setdefault(frame, np.linalg.inv(placed[new]) @ pose)
    return Placed(
        tuple(renumbered), np.stack([placed[i] for i in range(len(cameras))]), boards, disagreement
    )


def frame_offset(
    a: dict[int, Floats[D4, D4]], b: dict[int, Floats[D4, D4]], board: Board
) -> int | None:
    """Return by how many frames the second camera seems to be late, None when no shift explains it.

    a, b: T_camera_board by frame. With frames rightly matched, all views agree on the cameras' places.
    """
    turns = _turn_transforms(board)
    found: dict[int, float] = {}
    for offset in range(-_MOST_LATE, _MOST_LATE + 1):
        frames = [frame for frame in a if frame + offset in b][:60]
        if len(frames) >= 5:
            news, nears = [b[f + offset] for f in frames], [a[f] for f in frames]
            found[offset] = _agreed(news, nears, turns)[1]
    best = min(found, key=lambda offset: found[offset], default=0)
    return best if best != 0 and found[best] < 0.3 * found.get(0, np.inf) else None


def _require_connected(
    cameras: Sequence[CameraViews], edges: dict[tuple[int, int], list[int]]
) -> None:
    group = list(range(len(cameras)))
    for (i, j), frames in edges.items():
        if frames:
            group = [group[i] if g == group[j] else g for g in group]
    names = [
        ", ".join(f"'{camera.name}'" for camera, g in zip(cameras, group) if g == one)
        for one in dict.fromkeys(group)
    ]
    if len(names) > 1:
        raise HandtrackError(
            f"the cameras fall into groups that share no view of the board: {' | '.join(names)}. "
            "Frames are matched by number (a video's frame, the last digits of a file's name). Show "
            "the board so that at least one camera of each group sees it together with one of "
            "another, and check that file numbers agree."
        )


def _turn_transforms(board: Board) -> list[Floats]:
    """Return T_board_turned (4, 4) of each way the board looks the same."""
    found = []
    for turn in board.turns:
        seen, real = board.points, board.points[turn]
        middle = board.points.mean(axis=0)
        covariance = (seen - middle).T @ (real - middle)
        covariance[2, 2] = 1.0  # all in the plane: the turn is about its normal
        u, _, vt = np.linalg.svd(covariance)
        rotation = (u @ vt).T
        transform = np.eye(4)
        transform[:3, :3] = rotation
        transform[:3, 3] = middle - rotation @ middle
        found.append(transform)
    return found


def _agreed(news: list[Floats], nears: list[Floats], turns: list[Floats]) -> tuple[Floats, float]:
    """Return T_new_near on which most common views agree, and their median disagreement.

    Each view proposes one per way the board looks the same; wrong ones move with the board, the right
    ones agree. The winner is averaged with those that agree with it.
    """
    proposals = np.stack(
        [[a @ turn @ np.linalg.inv(b) for turn in turns] for a, b in zip(news, nears, strict=True)]
    )  # (V, S, 4, 4)
    distance = float(np.median([np.linalg.norm(b[:3, 3]) for b in [*news, *nears]]))
    best, best_off, best_choice = proposals[0, 0], np.inf, None
    for candidate in proposals.reshape(-1, 4, 4):
        off = _disagreements(candidate, proposals, distance)
        nearest = off.argmin(axis=1)
        middle = float(np.median(off.min(axis=1)))
        if middle < best_off:
            best, best_off, best_choice = candidate, middle, nearest
    if best_choice is None or len(news) == 1:
        return best, 0.0
    chosen = proposals[np.arange(len(proposals)), best_choice]
    off = _disagreements(best, chosen[:, None], distance)[:, 0]
    agreeing = chosen[off <= max(2 * best_off, 1e-6)]
    mean = np.eye(4)
    mean[:3, :3] = Rotation.from_matrix(agreeing[:, :3, :3]).mean().as_matrix()
    mean[:3, 3] = np.median(agreeing[:, :3, 3], axis=0)
    return mean, float(np.median(_disagreements(mean, chosen[:, None], distance)))


def _disagreements(pose: Floats, others: Floats, distance: float) -> Floats:
    """Return how far poses (..., 4, 4) are from one, as a share of the distance to the board."""
    trace = np.einsum("ij,...ij->...", pose[:3, :3], others[..., :3, :3])
    angle = np.arccos(np.clip((trace - 1) / 2, -1, 1))
    shift = np.linalg.norm(others[..., :3, 3] - pose[:3, 3], axis=-1) / distance
    return _TURN_M * angle + shift


def _renumbered(
    camera: CameraViews,
    poses: dict[int, Floats],
    T_camera_world: Floats,
    boards: dict[int, Floats],
    turns: list[Floats],
    board: Board,
) -> CameraViews:
    """Return the camera's views numbered as the boards already placed are; poses are turned along."""
    views = []
    for view in camera.shared:
        if view.frame in boards and len(turns) > 1:
            expected = T_camera_world @ boards[view.frame]
            ways = [poses[view.frame] @ turn for turn in turns]
            distance = float(np.linalg.norm(expected[:3, 3]))
            off = _disagreements(expected, np.stack(ways), distance)
            best = int(off.argmin())
            poses[view.frame] = ways[best]
            inverse = np.argsort(board.turns[best])
            view = replace(view, ids=inverse[view.ids])
        views.append(view)
    return replace(camera, shared=tuple(views))
