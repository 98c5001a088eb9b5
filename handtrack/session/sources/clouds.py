"""The point clouds of a session, frame by frame: from files, depth images or stereo pairs."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from handtrack.arrays import D3, C, Floats, K
from handtrack.capture.clouds.cloud_files import read_cloud
from handtrack.capture.clouds.depth import depth_cloud
from handtrack.capture.clouds.disparity import StereoSettings
from handtrack.capture.clouds.point_cloud import PointCloud, merged
from handtrack.capture.clouds.stereo import StereoMatcher, check_pair
from handtrack.capture.images.frames import FrameNotes
from handtrack.errors import HandtrackError
from handtrack.geometry.camera import CameraRig
from handtrack.session.session_file import SessionFile
from handtrack.session.sources.views import View

_TRIED = 5  # files, until one can be read


class CloudSource:
    """Measured clouds by frame, before any filter: those of its parts merged. Safe to read from several threads."""

    def __init__(
        self,
        cameras_needed: tuple[Floats[K, D3], ...],
        names: tuple[str, ...] = (),
        parts: Sequence[Callable[[int], PointCloud | None]] = (),
    ) -> None:
        self._parts = parts
        self.names = names
        """of the session's cameras whose images are measured; none where clouds are read from files"""
        self.cameras_needed = cameras_needed
        """centres (K, 3), world [m], of cameras that must all see a point for it to be measured, a set each"""
        self.camera_centres: Floats[C, D3] = np.concatenate(cameras_needed)
        """(C, 3) world [m], of the cameras that measured"""

    @property
    def warnings(self) -> list[str]:
        """What was odd so far, in plain sentences; what was odd about images is said by their views."""
        return []

    def read(self, frame: int) -> PointCloud | None:
        """Return the frame's cloud in the world frame; None where none was taken."""
        clouds = [cloud for part in self._parts if (cloud := part(frame)) is not None]
        return merged(clouds) if clouds else None


class StereoClouds(CloudSource):
    """Clouds of calibrated pairs, merged; where a camera has masks, only their pixels.

    The first frame matched of a pair is also looked at for why it might not fit.
    """

    def __init__(self, pairs: tuple[tuple[View, View], ...], settings: StereoSettings) -> None:
        """Raises HandtrackError for cameras that cannot make a pair."""
        super().__init__(
            tuple(np.stack([a.camera.centre, b.camera.centre]) for a, b in pairs),
            tuple(view.name for pair in pairs for view in pair),
            [partial(self._read, index) for index in range(len(pairs))],
        )
        # along level lines mosaics are interpolated at the real coordinates that rectification asks for
        by_level_lines = [
            all(str(view.settings.demosaic or "").startswith("level_line") for view in pair)
            for pair in pairs
        ]
        self._pairs = tuple(
            (a, b, StereoMatcher(a.camera, b.camera, settings, exact))
            for (a, b), exact in zip(pairs, by_level_lines, strict=True)
        )
        self._met: dict[int, str] = {}  # by pair, once it was looked at; empty: nothing is odd
        self._lock = threading.Lock()

    @property
    def warnings(self) -> list[str]:
        with self._lock:
            met = [text for _, text in sorted(self._met.items())]
        lengths = (_length_warning(a, b) for a, b, _ in self._pairs)
        return [*filter(None, (*lengths, *met))]

    def _read(self, index: int, frame: int) -> PointCloud | None:
        first, second, matcher = self._pairs[index]
        left, right = first.image(frame), second.image(frame)
        if left is None or right is None:
            return None
        images = left, right
        view = matcher.match(*images, first.hand_pixels(frame), second.hand_pixels(frame))
        if view.asked > 0:  # an empty mask is no fault of the pair
            with self._lock:
                is_new = index not in self._met
                self._met.setdefault(index, "")
            if is_new and (problem := check_pair(matcher, view, *images)) is not None:
                with self._lock:
                    self._met[index] = f"[clouds] stereo, frame {frame}, {problem}"
        return matcher.triangulate(view)


class FileClouds(CloudSource):
    """Clouds from files, one a frame. A damaged file among others is a missing cloud, and said."""

    def __init__(self, files: Mapping[int, Path], rig: CameraRig, world_unit_m: float) -> None:
        """Raises HandtrackError when none of the first files can be read."""
        super().__init__(tuple(camera.centre[None] for camera in rig))
        self._files = files
        self._unit = world_unit_m
        self._notes = FrameNotes()
        self._first: tuple[int, PointCloud | None] = (-1, None)
        self._try_first()

    @property
    def warnings(self) -> list[str]:
        return list(self._notes.texts)

    def read(self, frame: int) -> PointCloud | None:
        path = self._files.get(frame)
        if path is None:
            return None
        first, self._first = self._first, (-1, None)
        if first[0] == frame:
            return first[1]
        try:
            return self._read(frame, path)
        except HandtrackError as error:
            self._notes.add(frame, f"{error} Frame {frame} counts as missing.")
            return None

    def _read(self, frame: int, path: Path) -> PointCloud:
        cloud, warnings = read_cloud(path, self._unit)
        self._notes.add(frame, *warnings)
        return cloud

    def _try_first(self) -> None:
        """Read a file, so that a session none of whose clouds can be used is refused at once."""
        problem: HandtrackError | None = None
        for frame, path in list(self._files.items())[:_TRIED]:
            try:
                self._first = (frame, self._read(frame, path))
                return
            except HandtrackError as error:
                problem = problem or error
        if problem is not None:
            raise problem


def _length_warning(first: View, second: View) -> str:
    """Return that a pair's recordings end at different frames; empty when they do not."""
    lengths = [0 if v.images is None else len(v.images.known_frames) for v in (first, second)]
    if lengths[0] == lengths[1]:
        return ""
    return (
        f"[clouds] stereo, cameras '{first.name}' and '{second.name}': images of {lengths[0]} and {lengths[1]} "
        f"frames; from frame {min(lengths)} on the pair has no cloud. Is one recording cut? If it started at another "
        "time, every cloud is wrong: frames of equal number must show the same moment."
    )


def _depth_cloud(view: View, frame: int) -> PointCloud | None:
    """Return a depth camera's cloud; where it has masks, only of their pixels."""
    depth = view.depth_m(frame)
    if depth is None:
        return None
    return depth_cloud(view.camera, depth, view.hand_pixels(frame), view.image(frame))


def cloud_source(
    file: SessionFile, files: Mapping[int, Path], views: tuple[View, ...], rig: CameraRig
) -> CloudSource | None:
    """Return the source that [clouds] names, None without one. Raises HandtrackError."""
    settings = file.clouds
    if settings is None:
        return None
    by_name = {view.name: view for view in views}
    if settings.depth:
        chosen = [by_name[name] for name in settings.depth]
        return CloudSource(
            tuple(view.camera.centre[None] for view in chosen),
            settings.depth,
            [partial(_depth_cloud, view) for view in chosen],
        )
    if settings.stereo:
        pairs = tuple((by_name[first], by_name[second]) for first, second in settings.stereo)
        return StereoClouds(pairs, settings.matching)
    return FileClouds(files, rig, file.session.world_unit_m)
