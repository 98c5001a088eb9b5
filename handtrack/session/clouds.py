"""The point clouds of a session, frame by frame: from files, depth images or stereo pairs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Protocol

import numpy as np

from handtrack.arrays import Floats
from handtrack.capture.cloud_filters import CloudFilters
from handtrack.capture.depth import depth_cloud
from handtrack.capture.point_cloud import PointCloud, merged
from handtrack.geometry.camera import CameraRig
from handtrack.session.session_file import CloudSettings
from handtrack.session.views import View


class CloudSource(Protocol):
    """Measured clouds by frame, before any filter. Safe to read from several threads."""

    @property
    def warnings(self) -> list[str]:
        """What was odd so far, in plain sentences."""
        ...

    @property
    def eyes(self) -> Floats:
        """(C, 3) world [m], the centres of the cameras that measured."""
        ...

    def read(self, frame: int) -> PointCloud | None:
        """Return the frame's cloud in the world frame; None where none was taken."""
        ...


class DepthClouds:
    """Clouds from depth cameras, merged; where a camera has masks, only their pixels."""

    def __init__(self, views: tuple[View, ...]) -> None:
        self._views = views

    @property
    def warnings(self) -> list[str]:
        return []  # those of the images are the view's

    @property
    def eyes(self) -> Floats:
        return np.stack([view.camera.centre for view in self._views])

    def read(self, frame: int) -> PointCloud | None:
        clouds = [cloud for view in self._views if (cloud := _depth_cloud(view, frame)) is not None]
        return merged(clouds) if clouds else None


def _depth_cloud(view: View, frame: int) -> PointCloud | None:
    depth = view.depth_m(frame)
    if depth is None:
        return None
    return depth_cloud(view.camera, depth, view.hand_pixels(frame), view.image(frame))


def cloud_filters(settings: CloudSettings) -> CloudFilters:
    """Return the filters of a session: those set in [clouds], the others as they are usual.

    From depth images the part nearest to the camera is taken unless `component` says otherwise:
    nothing else tells the hand from what is behind it. Files may come from anywhere: their
    distance to the cameras is looked at only where near_m or far_m are set.
    """
    usual = CloudFilters()
    if settings.depth:
        usual = replace(usual, component="nearest")
    if settings.files is not None:
        usual = replace(usual, near_m=None, far_m=None)
    names = {field.name for field in fields(CloudSettings)}
    own = {f.name: getattr(settings, f.name) for f in fields(usual) if f.name in names}
    return replace(usual, **{name: value for name, value in own.items() if value is not None})


def cloud_source(
    settings: CloudSettings, files: Mapping[int, Path], views: tuple[View, ...], rig: CameraRig
) -> CloudSource:
    """Return the source that [clouds] names."""
    by_name = {view.name: view for view in views}
    return DepthClouds(tuple(by_name[name] for name in settings.depth))
