"""A first pose given as joints in images, brought into space: triangulated, or all that one camera leaves open."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from handtrack.errors import unknown_name
from handtrack.model.articulated import ArticulatedModel, keypoint_names
from handtrack.observation.observation import ImageKeypoints, Observation
from handtrack.session.first_pose.first_pose import CONVENTIONS, FirstPose
from handtrack.session.first_pose.first_pose_candidate import FirstPoseCandidate, differs
from handtrack.session.session import Session
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.search.auto_start import auto_start
from handtrack.tracking.search.evidence.hand_shapes import shape_of
from handtrack.tracking.search.global_search import GIVEN_JOINTS
from handtrack.tracking.search.initialize import fit_keypoints
from handtrack.tracking.search.keypoint_start import hands_from_images, in_space
from handtrack.tracking.search.start_confidence import clustered_modes


def poses_from_images(
    session: Session,
    settings: TrackerSettings,
    model: ArticulatedModel,
    first: FirstPose,
    seen: Observation,
) -> list[FirstPoseCandidate]:
    """Return the poses that joints in images may mean, the surest first.

    Where two cameras agree on most joints there is one, the points in space. Otherwise fingers may bend to or from the
    camera: silhouettes and cloud of the frame decide as far as there are any. model: a hand with all joints.
    Raises HandtrackError for a camera that the session does not have, and for too few joints.
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
    rows = [
        FirstPoseCandidate(first.frame, c.params, c.confidence, "", c.model, c.cost)
        for c in auto_start((), settings, with_joints, found=candidates)
    ]
    return _noted(rows, images) if rows else poses_by_joints(model, first.frame, images)


def poses_by_joints(
    model: ArticulatedModel, frame: int, images: Sequence[ImageKeypoints]
) -> list[FirstPoseCandidate]:
    """Return the poses that joints in a frame's undistorted images may mean, by nothing else, the surest first.

    Raises HandtrackError for too few joints.
    """
    found = clustered_modes(hands_from_images(model, images))
    rows = [FirstPoseCandidate(frame, c.params, c.confidence, "", model, c.cost) for c in found]
    return _noted(rows, images)


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
    """Return the pose that joints in a frame's undistorted images say, where two cameras or more agree on most; else None.

    model: a hand with all joints, or a body.
    """
    known = in_space(model, images, settings.keypoints.sigma_mm * 1e-3)
    if known is None:
        return None
    points = known.positions
    given = FirstPose(frame, {}, points, CONVENTIONS[0]) if model.has_keypoints21 else None
    cameras, count = len({joints.camera for joints in images}), known.count
    note = f"{cameras} cameras agree on {count} of {len(points)} joints"
    return FirstPoseCandidate(frame, fit_keypoints(model, known), 1.0, note, model, 0.0, given)


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
