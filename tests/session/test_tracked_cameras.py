"""After tracking: a camera that the others contradict is named, with figures, and none where they agree."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from handtrack.capture.calibration.rig_file import write_rig
from handtrack.geometry.camera import CameraRig
from handtrack.geometry.rotation import rotation_matrix
from handtrack.session.doctor.check_tracked import check_tracked_cameras, inconsistency_of_cameras
from handtrack.session.formats.tables import write_result
from handtrack.session.layout import POSES_FILE
from handtrack.session.run import TrackingRun
from handtrack.session.session import Session
from handtrack.simulation.motion import MOTIONS
from handtrack.simulation.simulate import Simulation, simulate
from tests.session.small_session import add_joints


def recorded(folder: Path, seed: int, cameras: int = 3, joints_px: float = 0.0) -> Path:
    """A hand before small cameras: its masks, or joints with so much noise."""
    what = Simulation(
        cameras=cameras, frames=5, size=(320, 240), images=False, seed=seed, motion=sorted(MOTIONS["hand"])[seed % len(MOTIONS["hand"])],
        init_noise_m=0.0, distance_m=0.4,
    )  # fmt: skip
    simulate(folder, what)
    return with_joints(folder, seed, joints_px) if joints_px else folder


def with_joints(folder: Path, seed: int, noise_px: float) -> Path:
    rng, points = np.random.default_rng(seed), np.load(folder / "truth.npz")["keypoints21"]
    return add_joints(folder, {
        camera.name: {
            frame: camera.project(hand) + rng.normal(scale=noise_px, size=(21, 2))
            for frame, hand in enumerate(points)
        }
        for camera in Session.open(folder).rig
    })  # fmt: skip


def turned(folder: Path, number: int, degrees: tuple[float, float, float]) -> None:
    cameras = list(Session.open(folder).rig.cameras)
    one, turn = cameras[number], rotation_matrix(np.deg2rad(degrees))
    cameras[number] = replace(one, rotation=turn @ one.rotation, translation=turn @ one.translation)
    write_rig(folder / "calibration.toml", CameraRig(tuple(cameras)))


def tracked(folder: Path, use: dict[str, object]) -> tuple[str, TrackingRun]:
    """Return what is said after tracking, and the run."""
    run = TrackingRun.open(Session.open(folder), QUICK | use)
    tracked = {r.frame: r for r in run.track(run.session.frame_range, *run.initial())}
    results = [tracked[frame] for frame in sorted(tracked)]
    (folder / POSES_FILE).parent.mkdir(exist_ok=True)
    write_result(folder / POSES_FILE, run.result(results))
    return inconsistency_of_cameras(run, results), run


LENS = [-0.014, 1.42, 0.0, 0.0, -6.39]  # a real camera's
QUICK: dict[str, object] = {"model.fit_size": "false", "tracker.escape": False}
JOINTS_ALONE: dict[str, object] = {"silhouettes.weight": 0}


@pytest.mark.parametrize("seed", [1, 2])
def test_cameras_that_agree_are_not_questioned(tmp_path, seed):
    joints = seed % 2 == 1
    folder = recorded(tmp_path / "session", seed, 2 + seed % 3 // 2, 1.0 if joints else 0.0)
    said, _ = tracked(folder, JOINTS_ALONE if joints else {})
    assert said == ""


@pytest.mark.parametrize(("number", "degrees"), [(2, (0.7, -0.7, 0.0))])
def test_a_camera_turned_by_a_degree_is_named(tmp_path, number, degrees):
    folder = recorded(tmp_path / "session", number)
    turned(folder, number, degrees)
    said, run = tracked(folder, {})
    assert said.startswith(f"camera 'cam{number}' "), said
    angle = re.search(r"turned by about (\d\.\d)°", said)
    assert angle and float(angle[1]) == pytest.approx(1.0, abs=0.45), said
    (found,) = check_tracked_cameras(run.session)
    assert (found.severity, found.text) == ("warning", f"{POSES_FILE}: {said}")


@pytest.mark.parametrize(("cameras", "lost"), [(3, [1])])
def test_a_lens_that_lost_its_k3_is_named(tmp_path, cameras, lost):
    """The hand is seen beside the middle, where the coefficient counts; the same with the whole lens is no fault."""
    folder = recorded(tmp_path / "session", 1, cameras)
    rig = []
    for number, one in enumerate(Session.open(folder).rig.cameras):
        turn = rotation_matrix(np.deg2rad([0.0, 14.0 * (-1) ** number, 0.0]))
        pose = turn @ one.rotation, turn @ one.translation
        rig.append(replace(one, rotation=pose[0], translation=pose[1], distortions=np.array(LENS)))
    write_rig(folder / "calibration.toml", CameraRig(tuple(rig)))
    with_joints(folder, 1, 1.0)
    assert tracked(folder, JOINTS_ALONE)[0] == ""
    for number in lost:
        rig[number] = replace(rig[number], distortions=np.array([*LENS[:4], 0.0]))
    write_rig(folder / "calibration.toml", CameraRig(tuple(rig)))
    said, _ = tracked(folder, JOINTS_ALONE)
    assert "camera 'cam1'" in said and "with another lens" in said, said
