"""A project of another program as `handtrack new --project` takes it: what the user names goes before what is found."""

from __future__ import annotations

import argparse
from collections.abc import Mapping

from handtrack.capture.joints.pose2sim import Pose2SimProject, read_pose2sim
from handtrack.errors import HandtrackError


def with_project(args: argparse.Namespace) -> Pose2SimProject | None:
    """Fill in the options of `handtrack new` that the user left open by the project's folder. Raises HandtrackError."""
    if args.project is None:
        if not args.calibration:
            raise HandtrackError(
                "give the cameras with --calibration FILE, or a Pose2Sim project with --project FOLDER."
            )
        return None
    if len(args.calibration) > 1:
        raise HandtrackError("--project: expected one --calibration at most.")
    project = read_pose2sim(args.project, next(iter(args.calibration), None))
    args.calibration = [project.calibration]
    args.video = _filled(args.video, project.videos)
    args.images = _filled(args.images, project.images)
    args.keypoints = _filled(args.keypoints, project.keypoints)
    args.fps = project.fps if args.fps is None else args.fps
    return project


def _filled(given: list[str], found: Mapping[str, object]) -> list[str]:
    said = {pair.partition("=")[0] for pair in given}
    return [*given, *(f"{camera}={path}" for camera, path in found.items() if camera not in said)]
