"""Pictures of a calibration: the rig with its boards in space, and where corners were missed."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import cv2
import numpy as np

from handtrack.arrays import D3, Array, Floats, H, N, W
from handtrack.capture.calibration.boards import Board
from handtrack.capture.calibration.rig_calibration import RigCalibration
from handtrack.geometry.camera import Camera, CameraRig
from handtrack.geometry.rotation import rotation_matrix

_PANEL = 620  # [px] side of one view of the rig
_INK, _FAINT, _PAPER = (40, 40, 40), (200, 200, 200), (255, 255, 255)
_COLOURS = [
    (180, 110, 30),
    (40, 90, 220),
    (60, 150, 50),
    (160, 60, 160),
    (20, 150, 200),
    (120, 120, 0),
]
_PLAIN, _ODD = (120, 120, 120), (0, 94, 213)  # BGR
_MAGNIFIED = 50  # times a residual is drawn


def draw_calibration(calibration: RigCalibration, board: Board) -> Array[H, W, D3]:
    """Return a picture of a calibration's cameras and boards."""
    low, high = board.points.min(axis=0), board.points.max(axis=0)
    around = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 0]])
    outline = low + around * (high - low) + (2 * around - [1, 1, 0]) * board.square_m
    places = calibration.T_world_board.values()
    return draw_rig(calibration.rig, [outline @ T[:3, :3].T + T[:3, 3] for T in places])


def draw_rig(
    rig: CameraRig, lines: Sequence[Floats[N, D3]], odd: Collection[str] = ()
) -> Array[H, W, D3]:
    """Return a picture BGR of cameras and of lines in space, world [m]: from behind the first
    camera, from its side and from above it.

    Parameters
    ----------
    odd
        Cameras that are drawn in orange.
    """
    first = rig.cameras[0]
    tilted = rotation_matrix(np.array([0.45, 0, 0])) @ rotation_matrix(np.array([0, 0.5, 0]))
    side = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    above = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    views = [
        ("oblique", tilted),
        (f"from the side of {first.name}", side),
        (f"from above {first.name}", above),
    ]
    return cv2.hconcat(
        [_rig_panel(rig, lines, odd, turn @ first.rotation, title) for title, turn in views]
    )


def _rig_panel(
    rig: CameraRig, lines: Sequence[Floats], odd: Collection[str], look: Floats, title: str
) -> Array:
    """Return one view without perspective along the z axis of `look` (3, 3), R_view_world."""
    size = _frustum_size(rig, lines)
    cameras = [_frustum(camera, size) for camera in rig]
    everything = np.concatenate([*cameras, *lines]) @ look.T
    low, high = everything[:, :2].min(axis=0), everything[:, :2].max(axis=0)
    zoom = 0.86 * _PANEL / max(float((high - low).max()), 1e-9)
    middle = (low + high) / 2

    def place(points: Floats) -> Array:
        flat = (points @ look.T)[:, :2]
        return np.round((flat - middle) * zoom + _PANEL / 2).astype(np.int32)

    panel = np.full((_PANEL, _PANEL, 3), 255, np.uint8)
    for points in lines:
        cv2.polylines(panel, [place(points)], False, (170, 190, 170), 1, cv2.LINE_AA)
    for i, (camera, points) in enumerate(zip(rig, cameras, strict=True)):
        plain = _PLAIN if odd else _COLOURS[i % len(_COLOURS)]
        _draw_camera(panel, place(points), camera.name, _ODD if camera.name in odd else plain)
    _write(panel, title, (12, 22), _INK)
    _draw_scale(panel, zoom)
    cv2.rectangle(panel, (0, 0), (_PANEL - 1, _PANEL - 1), _FAINT, 1)
    return panel


def _frustum_size(rig: CameraRig, lines: Sequence[Floats]) -> float:
    """Return how long cameras are drawn [m]: smaller than their distances to each other and the lines."""
    centres = np.stack([camera.centre for camera in rig])
    middles = np.stack([line.mean(axis=0) for line in lines] or [centres.mean(axis=0)])
    away = np.linalg.norm(middles[:, None] - centres[None], axis=-1)
    return 0.15 * (float(np.median(away)) or 1.0)


def _frustum(camera: Camera, size: float) -> Floats:
    """Return (5, 3) the centre and the four corners of the image at depth `size`, world [m]."""
    width, height = camera.size
    corners = np.array([[0, 0], [width, 0], [width, height], [0, height]], dtype=float)
    flat = (corners - camera.matrix[:2, 2]) / np.diag(camera.matrix)[:2]
    points = np.concatenate([flat, np.ones((4, 1))], axis=1) * size
    return np.concatenate([camera.centre[None], camera.centre + points @ camera.rotation])


def _draw_camera(panel: Array, points: Array, name: str, colour: tuple[int, int, int]) -> None:
    centre, corners = points[0], points[1:]
    rays = [np.stack([centre, corner]) for corner in corners]
    cv2.polylines(
        panel, [*rays, np.append(corners, corners[:1], axis=0)], False, colour, 1, cv2.LINE_AA
    )
    cv2.polylines(panel, [corners[:2]], False, colour, 2, cv2.LINE_AA)  # the image's upper side
    _write(panel, name, (int(centre[0]) + 6, int(centre[1]) - 6), colour)


def _draw_scale(panel: Array, zoom: float) -> None:
    metres = max(
        m
        for m in (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5)
        if m * zoom < 0.4 * _PANEL or m == 0.01
    )
    end = 12 + round(metres * zoom)
    cv2.line(panel, (12, _PANEL - 16), (end, _PANEL - 16), _INK, 2)
    _write(panel, f"{metres * 1e3:g} mm", (end + 8, _PANEL - 11), _INK)


def draw_residuals(calibration: RigCalibration) -> Array[H, W, D3]:
    """Return one picture with a panel a camera: each corner, and 50 times how far it was missed."""
    panels = [
        _residual_panel(camera, [v.pixels for v in seen.views.values()], left, told["rms_px"])
        for camera, seen, left, told in zip(
            calibration.rig,
            calibration.cameras,
            calibration.residuals,
            calibration.report["cameras"],
            strict=True,
        )
    ]
    columns = min(3, len(panels))
    height, width = (max(panel.shape[axis] for panel in panels) for axis in (0, 1))
    whole = np.full((-(-len(panels) // columns) * height, columns * width, 3), _PAPER, np.uint8)
    for i, panel in enumerate(panels):
        top, left = i // columns * height, i % columns * width
        whole[top : top + panel.shape[0], left : left + panel.shape[1]] = panel
    return whole


def _residual_panel(
    camera: Camera, pixels: Sequence[Floats], left: Sequence[Floats], rms: float
) -> Array:
    zoom = _PANEL / max(camera.size)
    width, height = (round(side * zoom) for side in camera.size)
    panel = np.full((height + 30, width, 3), 255, np.uint8)
    cv2.rectangle(panel, (0, 30), (width - 1, height + 29), _FAINT, 1)
    for view, (points, off) in enumerate(zip(pixels, left, strict=True)):
        hue = np.array([[[(view * 37) % 180, 200, 170]]], dtype=np.uint8)
        colour = tuple(int(v) for v in cv2.cvtColor(hue, cv2.COLOR_HSV2BGR)[0, 0])
        lines = np.stack([points, points + off * _MAGNIFIED], axis=1) * zoom + [0, 30]
        whole = np.round(lines).astype(np.int32)
        cv2.polylines(panel, list(whole), False, colour, 1, cv2.LINE_AA)
        for start in whole[:, 0].tolist():
            cv2.circle(panel, start, 1, _INK, -1)
    _write(
        panel,
        f"{camera.name}: {len(pixels)} views, rms {rms:.3f} px, residuals x {_MAGNIFIED}",
        (8, 20),
        _INK,
    )
    return panel


def _write(panel: Array, text: str, place: tuple[int, int], colour: tuple[int, int, int]) -> None:
    cv2.putText(panel, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.45, colour, 1, cv2.LINE_AA)
