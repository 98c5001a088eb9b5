"""A first pose that was found, how sure it is, and how it differs from others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field, replace

import numpy as np

from handtrack.arrays import D3, Floats, J, P, array_dataclass
from handtrack.errors import unknown_name
from handtrack.geometry.rotation import rotation_matrix, turned_by
from handtrack.model.articulated import ArticulatedModel, keypoint_names
from handtrack.observation.observation import ImageKeypoints, Observation
from handtrack.session.first_pose.first_pose import FirstPose
from handtrack.session.session import Session
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.search.auto_start import auto_start
from handtrack.tracking.search.engine import Candidate
from handtrack.tracking.search.global_search import GIVEN_JOINTS
from handtrack.tracking.search.initialize import fit_keypoints
from handtrack.tracking.search.keypoint_start import hands_from_images, in_space
from handtrack.tracking.search.scores.hand_shapes import shape_of
from handtrack.tracking.search.start_confidence import clustered_modes

_TURNED_DEG = 30.0  # less than that is not worth a word


@array_dataclass
class FirstPoseCandidate(Candidate):
    """A pose that tracking may start from: of a whole hand in the size in use, with a forearm where one is seen, or of a body."""

    frame: int = field(kw_only=True)
    note: str = ""
    """in words: how it fits, or how it differs from the surest"""
    given: FirstPose | None = None
    """points in space that the pose was fitted to, where there are any: they tell the hand's size as well"""

    @classmethod
    def of(cls, found: Candidate, frame: int) -> FirstPoseCandidate:
        """Return a pose that was found in a frame, without what else a search knows of it."""
        return cls(
            found.model,
            found.params,
            found.cost,
            confidence=found.confidence,
            p_in_basin=found.p_in_basin,
            frame=frame,
        )

    @property
    def settled(self) -> float:
        """How surely it is the right one of the poses that were found, however well it is known."""
        return self.confidence / self.p_in_basin

    @property
    def first_pose(self) -> FirstPose:
        """The pose as init.json holds it."""
        if self.given is not None:
            return replace(self.given, confidence=self.confidence)
        joint = self.model.joint_params(self.params)
        names = self.model.parameter_names
        values = dict(zip(names, joint.tolist(), strict=True))
        return FirstPose(self.frame, values, confidence=self.confidence)


def differs(best: FirstPoseCandidate, other: FirstPoseCandidate) -> str:
    """Return in words how far a pose is from the best, and how much worse it fits."""
    here, there = (_joints(c.model, c.params) for c in (best, other))
    away = 1e3 * float(np.linalg.norm(here - there, axis=1).mean())
    a, b = (rotation_matrix(c.model.joint_params(c.params)[3:6]) for c in (best, other))
    turned = np.rad2deg(float(turned_by(a, b)))
    parts = "limbs" if best.model.kind == "body" else "fingers"
    way = f"turned by {turned:.0f}°" if turned > _TURNED_DEG else f"{parts} bent otherwise"
    worse = other.cost / max(best.cost, 1e-12)
    return f"{way}, joints {away:.0f} mm away on average; fits {worse:.1f} times worse"


def _joints(model: ArticulatedModel, params: Floats[P]) -> Floats[J, D3]:
    """Return the joints by which poses are compared, world [m]: a hand with a forearm has more."""
    bones = model.bones(params)
    return model.keypoints21(bones) if model.has_keypoints21 else model.joint_positions(bones)


# ---- A first pose given as joints in images, brought into space: triangulated, or all that one camera leaves open


def poses_from_images(
    session: Session,
    settings: TrackerSettings,
    model: ArticulatedModel,
    first: FirstPose,
    seen: Observation,
) -> list[FirstPoseCandidate]:
    """Return the poses that joints in images may mean, the surest first.

    Where two cameras agree on most joints there is one, the points in space. Otherwise fingers may
    bend to or from the camera: silhouettes and cloud of the frame decide as far as there are any.

    Parameters
    ----------
    model
        A hand with all joints.

    Raises
    ------
    HandtrackError
        For a camera that the session does not have, and for too few joints.
    """
    images = image_keypoints(session, settings, first)
    placed = pose_in_space(settings, model, first.frame, images)
    if placed is not None:
        return [placed]
    candidates = [
        replace(c, shape=shape_of(model, model.joint_params(c.params), "given"))
        for c in hands_from_images(model, images)[: GIVEN_JOINTS.most]
    ]
    with_joints = replace(seen, keypoints=tuple(images))
    found = auto_start((), settings, with_joints, found=candidates)
    rows = [FirstPoseCandidate.of(candidate, first.frame) for candidate in found]
    return _noted(rows, images) if rows else poses_by_joints(model, first.frame, images)


def poses_by_joints(
    model: ArticulatedModel, frame: int, images: Sequence[ImageKeypoints]
) -> list[FirstPoseCandidate]:
    """Return the poses that joints in a frame's undistorted images may mean, by nothing else, the surest first.

    Raises HandtrackError for too few joints.
    """
    found = clustered_modes(hands_from_images(model, images))
    return _noted([FirstPoseCandidate.of(candidate, frame) for candidate in found], images)


def _noted(
    rows: Sequence[FirstPoseCandidate], images: Sequence[ImageKeypoints]
) -> list[FirstPoseCandidate]:
    cameras = len({joints.camera for joints in images})
    many = "one camera" if cameras == 1 else f"{cameras} cameras"
    notes = [f"joints seen by {many}", *(differs(rows[0], row) for row in rows[1:])]
    return [replace(row, note=note) for row, note in zip(rows, notes, strict=True)]


def pose_in_space(
    settings: TrackerSettings,
    model: ArticulatedModel,
    frame: int,
    images: Sequence[ImageKeypoints],
) -> FirstPoseCandidate | None:
    """Return the pose that joints in a frame's undistorted images say, where two cameras or more
    agree on most; else None.

    Parameters
    ----------
    model
        A hand with all joints, or a body.
    """
    known = in_space(model, images, settings.keypoints.sigma_mm * 1e-3)
    if known is None:
        return None
    points = known.positions
    given = FirstPose(frame, xyz=points) if model.has_keypoints21 else None
    cameras, count = len({joints.camera for joints in images}), known.count
    note = f"{cameras} cameras agree on {count} of {len(points)} joints"
    pose = Candidate(model, fit_keypoints(model, known), 0.0, confidence=1.0)
    return replace(FirstPoseCandidate.of(pose, frame), note=note, given=given)


def image_keypoints(
    session: Session, settings: TrackerSettings, first: FirstPose
) -> list[ImageKeypoints]:
    """Return a first pose's joints in the undistorted images of the session's cameras. Raises HandtrackError."""
    found = []
    for name, pixels in first.pixels.items():
        if name not in session.camera_names:
            raise unknown_name("camera", name, session.camera_names, "the first pose")
        camera = session.rig[name]
        flat = camera.without_distortion()
        found.append(
            ImageKeypoints(
                flat,
                keypoint_names(),
                camera.undistort_points(pixels),
                settings.keypoints.detected_px,
            )
        )
    return found
