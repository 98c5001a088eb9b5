"""A box dragged over a camera's image: the bare image while it is dragged, and where the box lies in it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import viser.transforms as vtf

from handtrack_app.page.state import Display
from handtrack_app.protocol.messages import CameraCard


def bare(display: Display) -> Display:
    """Return the display options without all that stands before the image."""
    return replace(
        display, mode="", cloud=False, ghosts=False, handle=False, tips=False, truth=False
    )


def pixel_box(
    client_camera: Any, card: CameraCard, corners: tuple[tuple[float, float], tuple[float, float]]
) -> tuple[int, int, int, int] | None:
    """Return x, y, w, h [px] in a camera's undistorted image of a rectangle dragged over a view from its centre.

    corners: opposite ones, as shares of the window. None for a rectangle beside the image.
    """
    up = np.tan(0.5 * float(client_camera.fov))
    across = up * float(client_camera.aspect)
    turn = vtf.SO3(np.asarray(client_camera.wxyz, dtype=float)).as_matrix()
    places = []
    for x, y in (
        (a, b) for a in (corners[0][0], corners[1][0]) for b in (corners[0][1], corners[1][1])
    ):
        ray = card.rotation.T @ turn @ np.array([(2 * x - 1) * across, (2 * y - 1) * up, 1.0])
        if ray[2] <= 1e-6:
            return None
        places.append((card.matrix @ (ray / ray[2]))[:2])
    low, high = np.min(places, axis=0), np.max(places, axis=0)
    low = np.clip(np.round(low), 0, np.array(card.size) - 1)
    high = np.clip(np.round(high), 0, card.size)
    width, height = (high - low).astype(int)
    return (int(low[0]), int(low[1]), int(width), int(height)) if width > 1 and height > 1 else None
