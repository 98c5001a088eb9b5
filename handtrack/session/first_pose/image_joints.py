"""A first pose given as joints in images, brought into space: triangulated, or all that one camera leaves open."""

from __future__ import annotations

from dataclasses import replace

from handtrack.errors import unknown_name
from handtrack.model.articulated import ArticulatedModel, keypoint_names
from handtrack.observation.observation import ImageKeypoints, Observation
from handtrack.session.first_pose.first_pose import FirstPose
from handtrack.session.session import Session
from handtrack.tracking.find_pose import PoseEstimate, noted, pose_in_space, poses_by_joints
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.search.auto_start import auto_start
from handtrack.tracking.search.global_search import GIVEN_JOINTS
from handtrack.tracking.search.keypoint_start import hands_from_images
from handtrack.tracking.search.scores.hand_shapes import shape_of


def poses_from_images(
    session: Session,
    settings: TrackerSettings,
    model: ArticulatedModel,
    first: FirstPose,
    seen: Observation,
) -> list[PoseEstimate]:
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
    rows = [PoseEstimate.of(candidate, first.frame) for candidate in found]
    return noted(rows, images) if rows else poses_by_joints(model, first.frame, images)


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
