"""Cameras that are off among those of a person: found with the poses of all frames, as before a hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from handtrack.geometry.camera import Camera
from handtrack.geometry.rotation import rotation_matrix
from handtrack.model.model_file import load_model
from handtrack.observation.observation import ImageKeypoints, Observation
from handtrack.simulation.motion import motion as named_motion
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.doubt.judgement import Judgement
from handtrack.tracking.frame.frame_result import posed_result
from handtrack.tracking.frame.result import Status
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.whole.evidence import Recording
from handtrack.tracking.whole.recording_estimate import refine
from handtrack.tracking.whole.refinement import Refinement

BODY = load_model("body34")
NAMES = tuple(n for n in BODY.joint_names if not n.endswith("_hand"))
FRAMES, FPS, SIGMA_PX = 16, 15.0, 4.0
OFF_DEG = (0.6, -0.6, 0.0)


def _camera(number: int) -> Camera:
    matrix = np.array([[1500.0, 0, 540], [0, 1500.0, 960], [0, 0, 1]])
    turn = rotation_matrix(np.array([0.0, 1.1 * number, 0.0]))
    rotation = np.diag([1.0, -1.0, -1.0]) @ turn.T
    return Camera(f"cam{number}", (1080, 1920), matrix, np.zeros(5), rotation, np.array([0.0, 0.0, 4.0]))  # fmt: skip


def _said(camera: Camera, off_deg: float) -> Camera:
    off = camera.rotation @ rotation_matrix(np.array([0.0, np.deg2rad(off_deg), 0.0]))
    return replace(camera, rotation=off, translation=-off @ camera.centre)


def test_cameras_that_were_turned_are_put_right_before_a_body(rng):
    cameras = [_camera(k) for k in range(3)]
    said = [_said(camera, off) for camera, off in zip(cameras, OFF_DEG, strict=True)]
    motion = named_motion(BODY, "dance", FRAMES, rng)
    poses = [BODY.clipped(BODY.transform.solver_params(row)) for row in motion]
    rows = [BODY.joint_names.index(name) for name in NAMES]
    places = [BODY.joint_positions(BODY.bones(pose))[rows] for pose in poses]
    noise = SIGMA_PX * rng.normal(size=(3, FRAMES, len(NAMES), 2))

    def observe(frame, _bones):
        seen = (
            ImageKeypoints(c, NAMES, true.project(places[frame]) + off[frame], SIGMA_PX)
            for c, true, off in zip(said, cameras, noise, strict=True)
        )
        return Observation(frame, frame / FPS, keypoints=tuple(seen))

    live = [
        posed_result(BODY, observe(n, None), pose, Judgement(Status.TRACKED)) for n, pose in enumerate(poses)
    ]  # fmt: skip
    told: list[str] = []
    refine(Recording(BODY, TrackerSettings(), observe, Control(on_shared=told.append)), live)
    found = Refinement.read(told[0])

    def off_px(views):
        """Return how far off a true joint is seen in the views, at the worst, all views taken alike."""
        off = [
            c.project(places[0]) - t.project(places[0]) for c, t in zip(views, cameras, strict=True)
        ]
        return np.linalg.norm(np.mean(off, axis=1), axis=1).max()

    assert {one.name for one in found.cameras} == {"cam0", "cam1", "cam2"}
    before, after = off_px(said), off_px([found.corrected(camera) for camera in said])
    assert before > 12.0
    assert after < 0.5 * before
