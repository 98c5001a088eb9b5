"""The 2D joints of one camera of a session, frame by frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from handtrack.arrays import D2, D3, Floats, J
from handtrack.capture.images.frames import FrameNotes, files_by_frame, frames_of
from handtrack.capture.images.openpose import (
    LAYOUTS,
    Layout,
    landmark_definition,
    read_openpose,
)
from handtrack.errors import HandtrackError
from handtrack.geometry.camera import Camera
from handtrack.model.articulated import ArticulatedModel
from handtrack.observation.observation import ImageKeypoints, Observation

_LEAST = 0.3  # confidence below which a point counts as missing; above, it says nothing of the error (docs/explanation/accuracy.md)
NO_JOINTS = (
    "a body (model '{model}') is found by 2D joints only, and no camera has any that count. Detect them with a program such as "
    'OpenPose, and name their files: keypoints = "pose/cam0/*.json" and keypoint_layout = "body_25" in [[camera]] of session.toml.'
)
"""what a body's first pose needs, in words"""


def of_model(seen: Observation, model: ArticulatedModel) -> Observation:
    """Return what was seen, with the keypoints and pins of places that a model has."""
    if not (seen.keypoints or seen.pins):
        return seen
    joints = [
        joints_of_model(one, model) if isinstance(one, ImageKeypoints) else one
        for one in seen.keypoints
    ]
    names = model.joint_names, model.skeleton.bone_names
    pins = [replace(s, pins=tuple(p for p in s.pins if p.is_on(*names))) for s in seen.pins]
    return replace(
        seen,
        keypoints=tuple(one for one in joints if one.names),
        pins=tuple(one for one in pins if one.pins),
    )


def joints_of_model(seen: ImageKeypoints, model: ArticulatedModel) -> ImageKeypoints:
    """Return the joints that a model has."""
    rows = [i for i, name in enumerate(seen.names) if name in model.joint_names]
    names = tuple(seen.names[i] for i in rows)
    return ImageKeypoints(seen.camera, names, seen.pixels[rows], np.asarray(seen.sigma_px)[rows])


class KeypointFiles:
    """Files of 2D joints by frame number, and how they are to be read."""

    def __init__(self, files: Sequence[Path], layout: str, camera: Camera) -> None:
        """Raises HandtrackError when two files have the same number, or the first cannot be read."""
        self.files = files_by_frame(files)
        self.layout: Layout = LAYOUTS[layout]
        self.landmark_definition = landmark_definition(layout)
        self.camera = camera
        self.flat = camera.without_distortion()
        self._notes = FrameNotes()
        # the estimate of all frames asks for each about nine times
        self._undistorted = dict[int, Floats[J, D2]]()
        read_openpose(next(iter(self.files.values())), self.layout)

    @property
    def frames(self) -> range:
        """From 0 to the last frame there is."""
        return frames_of(self.files)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What was odd so far, in plain sentences."""
        return self._notes.texts

    def read(self, frame: int, sigma_px: float) -> tuple[ImageKeypoints, ...]:
        """Return the tallest person's joints in the undistorted image, all as exact as sigma_px; none where none were found."""
        if frame not in self._undistorted:
            rows = self._rows(frame)
            if rows is None:
                return ()
            straight = self.camera.undistort_points(rows[:, :2])
            straight[rows[:, 2] < _LEAST] = np.nan
            self._undistorted[frame] = straight
        names = tuple(self.layout.points)
        sigma = np.full(len(names), sigma_px)
        return (ImageKeypoints(self.flat, names, self._undistorted[frame], sigma),)

    def as_taken(self, frame: int) -> dict[str, Floats[D2]]:
        """Return the same joints by name, in the image as it was taken [px]; those that count as missing are left out."""
        rows = self._rows(frame)
        if rows is None:
            return {}
        named = zip(self.layout.points, rows, strict=True)
        return {name: row[:2] for name, row in named if row[2] >= _LEAST}

    def _rows(self, frame: int) -> Floats[J, D3] | None:
        path = self.files.get(frame)
        try:
            points = None if path is None else read_openpose(path, self.layout)
        except HandtrackError as error:
            self._notes.add(frame, f"{error} Frame {frame} counts as missing.")
            return None
        return None if points is None else points[list(self.layout.points.values())]
