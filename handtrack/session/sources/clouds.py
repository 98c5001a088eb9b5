"""The point clouds of a session, frame by frame: from files, depth images or stereo pairs."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np

from handtrack.arrays import D3, C, Floats
from handtrack.capture.clouds.cloud_files import read_cloud
from handtrack.capture.clouds.cloud_filters import HandRegion
from handtrack.capture.clouds.point_cloud import PointCloud, depth_cloud, merged
from handtrack.capture.clouds.stereo import StereoMatcher, StereoSettings, check_pair
from handtrack.capture.images.frames import FrameNotes
from handtrack.errors import HandtrackError
from handtrack.geometry.camera import CameraRig
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.kinematics import BonePoses
from handtrack.model.metaballs import MetaballSurface
from handtrack.observation.observation import CloudView, view_centres
from handtrack.parallel import in_parallel
from handtrack.session.session_file import SessionFile
from handtrack.session.sources.views import View

_TRIED = 5  # files, until one can be read


class CloudSource:
    """Measured clouds by frame, before any filter: those of its parts merged. Safe to read from several threads."""

    def __init__(
        self,
        views: Sequence[CloudView],
        names: Sequence[str],
        parts: Sequence[Callable[[int], PointCloud | None]],
        told: Callable[[], Iterable[str]] = tuple,
    ) -> None:
        """told: what was odd so far, in plain sentences; what was odd about images is said by their views."""
        self._parts, self._told = parts, told
        self.names = tuple(names)
        """of the session's cameras whose images are measured; none where clouds are read from files"""
        self.views = tuple(views)
        """what can have seen the points"""
        self.camera_centres: Floats[C, D3] = np.concatenate([view_centres(v) for v in self.views])
        """(C, 3) world [m], of the cameras that measured"""

    @property
    def warnings(self) -> list[str]:
        """What was odd so far, in plain sentences."""
        return list(self._told())

    def read(self, frame: int) -> PointCloud | None:
        """Return the frame's cloud in the world frame; None where none was taken."""
        clouds = in_parallel(lambda part: part(frame), self._parts)
        taken = [cloud for cloud in clouds if cloud is not None]
        return merged(taken) if taken else None


class _StereoPair:
    """The clouds of a calibrated pair; where a camera has masks, only of their pixels.

    The first frame that is matched is also looked at for why the pair might not fit.
    """

    def __init__(self, first: View, second: View, settings: StereoSettings) -> None:
        """Raises HandtrackError for cameras that cannot make a pair."""
        self._views = first, second
        # along level lines mosaics are interpolated at the real coordinates that rectification asks for
        exact = all(str(v.settings.demosaic or "").startswith("level_line") for v in self._views)
        self._matcher = StereoMatcher(first.camera, second.camera, settings, exact)
        self._unlooked_at = threading.Lock()  # the first frame takes it for good
        self.odd = ""

    def read(self, frame: int) -> PointCloud | None:
        images = [view.image(frame) for view in self._views]
        left, right = images
        if left is None or right is None:
            return None
        view = self._matcher.match(left, right, *(v.hand_pixels(frame) for v in self._views))
        # an empty mask is no fault of the pair
        if view.asked > 0 and self._unlooked_at.acquire(blocking=False):
            problem = check_pair(self._matcher, view, left, right)
            self.odd = f"[clouds] stereo, frame {frame}, {problem}" if problem else ""
        return self._matcher.triangulate(view)


def _files(files: Mapping[int, Path], rig: CameraRig, world_unit_m: float) -> CloudSource:
    """Return clouds of files, one a frame. A damaged file among others is a missing cloud, and said; where none of the first
    can be read, HandtrackError is raised.
    """
    notes = FrameNotes()

    def cloud_of(frame: int) -> PointCloud:
        cloud, warnings = read_cloud(files[frame], world_unit_m)
        notes.add(frame, *warnings)
        return cloud

    def read(frame: int) -> PointCloud | None:
        try:
            return cloud_of(frame) if frame in files else None
        except HandtrackError as error:
            notes.add(frame, f"{error} Frame {frame} counts as missing.")
            return None

    problems: list[HandtrackError] = []
    for frame in islice(files, _TRIED):
        try:
            cloud_of(frame)
            break
        except HandtrackError as error:
            problems.append(error)
    else:
        if problems:
            raise problems[0]
    return CloudSource([camera.centre[None] for camera in rig], (), [read], lambda: notes.texts)


def _length_warning(first: View, second: View) -> str:
    """Return that a pair's recordings end at different frames; empty when they do not."""
    lengths = [
        0 if v.images is None else len(v.session_frames(v.images.known_frames))
        for v in (first, second)
    ]
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
        alone = [(view.camera,) for view in chosen]
        return CloudSource(alone, settings.depth, [partial(_depth_cloud, v) for v in chosen])
    if settings.stereo:
        both = [(by_name[first], by_name[second]) for first, second in settings.stereo]
        pairs = [_StereoPair(*views, settings.matching) for views in both]

        def told() -> Iterable[str]:
            lengths = (_length_warning(*views) for views in both)
            return filter(None, (*lengths, *(pair.odd for pair in pairs)))

        return CloudSource(
            [(first.camera, second.camera) for first, second in both],
            [view.name for views in both for view in views],
            [pair.read for pair in pairs],
            told,
        )
    return _files(files, rig, file.session.world_unit_m)


def hand_region(model: ArticulatedModel, bones: BonePoses) -> HandRegion:
    """Return where the hand posed by `bones` is."""
    surface = MetaballSurface.of(model)
    ellipsoids = surface.ellipsoids.posed(bones)
    # merging moves the surface outwards by no more than this
    merged = np.log(len(ellipsoids.radii)) / surface.sharpness
    balls = np.column_stack([ellipsoids.centre, ellipsoids.radii.max(axis=1) + merged])
    return HandRegion(balls, lambda points: surface.distance(bones, points))
