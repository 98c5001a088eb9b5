"""The cloud of the frame shown: points coloured by their distance to the model, by their own colour, or plain."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field

import numpy as np
import viser

from handtrack.arrays import D3, Bytes, N
from handtrack_app.page.page import put
from handtrack_app.page.scene.moments import Moments
from handtrack_app.page.state import Display
from handtrack_app.protocol.palette import residual_colours
from handtrack_app.protocol.snapshots import CloudSnapshot

_PLAIN, _DROPPED = (225, 228, 232), (120, 124, 132)


@dataclass
class CloudView:
    """Handles of the points that stay and of those that were dropped."""

    points: viser.PointCloudHandle
    dropped: viser.PointCloudHandle
    cloud: CloudSnapshot | None = None
    lock: threading.Lock = field(default_factory=threading.Lock)
    """frames come on one thread, display options on others: the colours shown are of the latest of both"""


def add_cloud(server: viser.ViserServer, name: str) -> CloudView:
    """Add the two clouds, empty and hidden."""
    none = np.zeros((0, 3), np.float32)
    points, dropped = (
        server.scene.add_point_cloud(
            f"{name}/{part}", none, colour, point_size=0.0016, point_shape="circle",
            precision="float32", point_shading="flat", visible=False,
        )
        for part, colour in (("points", _PLAIN), ("dropped", _DROPPED))
    )  # fmt: skip
    return CloudView(points, dropped)


def update_cloud(view: CloudView, cloud: CloudSnapshot, display: Display) -> None:
    """Take a frame's cloud; where only the hand moved, the points stay and their colours change."""
    with view.lock:
        before, view.cloud = view.cloud, cloud
        if before is None or not np.array_equal(before.points, cloud.points):
            view.points.points = cloud.points
        view.points.colors = cloud_colours(cloud, display.cloud_colour)
    if before is None or not np.array_equal(before.dropped, cloud.dropped):
        view.dropped.points = cloud.dropped


def show_cloud(view: CloudView, display: Display, moments: Moments, recolour: bool = False) -> None:
    """Apply the display options; a cloud of another frame than those shown now is hidden."""
    cloud = view.cloud
    known = cloud is not None and moments.fits(cloud.frame)
    put(view.points, visible=display.cloud and known)
    put(view.dropped, visible=display.cloud and display.cloud_dropped and known)
    size = 1e-3 * display.cloud_size_mm
    if view.points.point_size != size:
        view.points.point_size, view.dropped.point_size = size, 0.7 * size
    if recolour:
        with view.lock:
            if view.cloud is not None:
                view.points.colors = cloud_colours(view.cloud, display.cloud_colour)


def cloud_colours(cloud: CloudSnapshot, how: str) -> Bytes[N, D3]:
    """Return the points' colours; of none, one that stands for any: a page refuses an empty list."""
    if not len(cloud.points):
        return np.array([_PLAIN], np.uint8)
    if how == "own" and cloud.colors is not None:
        return cloud.colors
    if how == "residual" and np.isfinite(cloud.residual_mm).any():
        return residual_colours(cloud.residual_mm)
    return np.tile(np.array(_PLAIN, np.uint8), (len(cloud.points), 1))
