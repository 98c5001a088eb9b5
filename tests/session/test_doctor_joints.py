"""The doctor on joints seen by several cameras: each usual mistake of a calibration is named, and nothing where there is none."""

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from handtrack.arrays import Floats
from handtrack.capture.calibration.rig_file import write_rig
from handtrack.geometry.camera import Camera, CameraRig
from handtrack.geometry.rotation import rotation_matrix
from handtrack.model.model_file import load_model
from handtrack.session.doctor.check_joints import check_joints
from handtrack.session.session import Session

FRAMES, NOISE_PX = 60, 1.5
SIZE = (640, 480)
DISTORTION = [-0.25, 0.12, 0.0, 0.0, 0.4]


def camera(name: str, degrees: float, tilt: float = 15.0) -> Camera:
    """A camera that looks at the hand, 50 cm away, from the side by so many degrees."""
    turn = rotation_matrix(np.deg2rad([tilt, 0.0, 0.0])) @ rotation_matrix(
        np.deg2rad([0.0, degrees, 0.0])
    )
    matrix = [[600.0, 0.0, 320.0], [0.0, 600.0, 240.0], [0.0, 0.0, 1.0]]
    return Camera(name, SIZE, matrix, DISTORTION, turn, [0.0, 0.0, 0.5])


def moving_hand(side: str = "right") -> Floats:
    """(F, 21, 3) keypoints of a hand that sweeps through the images, bends and turns, world [m]."""
    model = load_model("hand26", side)
    frames = []
    for phase in np.linspace(0.0, 2 * np.pi, FRAMES):
        params = model.rest_params()
        params[: len(params)] += 0.25 * np.sin(phase + np.arange(len(params)))
        joints = model.keypoints21(model.bones(model.clipped(params)))
        joints = joints - joints.mean(axis=0)
        frames.append(
            joints + [0.13 * np.sin(phase), 0.09 * np.sin(2 * phase), 0.06 * np.cos(phase)]
        )
    return np.array(frames)


@dataclass
class Recording:
    """What the cameras saw, and what the session says of them."""

    cameras: dict[str, Camera]
    pixels: dict[str, Floats]
    unit: float = 1.0
    side: str = "right"

    def write(self, folder: Path) -> Path:
        lines = [
            "[session]",
            "format = 1",
            'name = "joints"',
            "fps = 30.0",
            f"world_unit_m = {self.unit}",
        ]
        lines += ["[hand]", 'model = "hand26"', f'side = "{self.side}"']
        for name, pixels in self.pixels.items():
            (folder / name).mkdir(parents=True)
            for frame, rows in enumerate(pixels):
                points = np.concatenate([rows, np.full((21, 1), 0.9)], axis=1).ravel().tolist()
                person = {f"hand_{self.side}_keypoints_2d": points}
                (folder / name / f"{frame:04d}.json").write_text(json.dumps({"people": [person]}))
            lines += ["[[camera]]", f'name = "{name}"', f'keypoints = "{name}/*.json"']
            lines += [f'keypoint_layout = "hand_{self.side}"']
        (folder / "session.toml").write_text("\n".join(lines) + "\n")
        write_rig(folder / "calibration.toml", CameraRig(tuple(self.cameras.values())))
        return folder


def recorded(degrees: tuple[float, ...] = (-35.0, 10.0, 50.0), seed: int = 5) -> Recording:
    rng = np.random.default_rng(seed)
    tilts = (15.0, 25.0, -10.0)
    cameras = {f"cam{i}": camera(f"cam{i}", d, tilts[i]) for i, d in enumerate(degrees)}
    hand = moving_hand()
    pixels = {
        name: one.project(hand) + rng.normal(0, NOISE_PX, (*hand.shape[:2], 2))
        for name, one in cameras.items()
    }
    return Recording(cameras, pixels)


def turned_round(it: Recording) -> None:
    for name, one in it.cameras.items():
        turn = one.rotation.T
        it.cameras[name] = replace(one, rotation=turn, translation=-turn @ one.translation)


def exchanged(it: Recording) -> None:
    it.pixels["cam0"], it.pixels["cam2"] = it.pixels["cam2"], it.pixels["cam0"]


def mirrored(it: Recording) -> None:
    it.pixels["cam1"] = it.pixels["cam1"] * (-1, 1) + (SIZE[0] - 1, 0)


def late(it: Recording) -> None:
    it.pixels["cam1"] = np.concatenate([it.pixels["cam1"][:1], it.pixels["cam1"][:-1]])


def of_another_size(it: Recording) -> None:
    one = it.cameras["cam2"]
    it.cameras["cam2"] = replace(one, matrix=one.matrix * [[1.5], [1.5], [1.0]])


def in_millimetres(it: Recording) -> None:
    for name, one in it.cameras.items():
        it.cameras[name] = replace(one, translation=1000 * one.translation)


def of_the_other_side(it: Recording) -> None:
    it.side = "left"


MISTAKES: dict[str, tuple[Callable[[Recording], None], str]] = {
    "C27 inverse": (turned_round, "led from the camera to the world"),
    "C28 exchanged": (exchanged, "if cameras 'cam0' and 'cam2' were exchanged"),
    "C29 mirrored": (mirrored, "if the images of camera 'cam1' were mirrored"),
    "late by one": (late, "with camera 'cam1' 1 frame late"),
    "another size": (of_another_size, "if the matrix of camera 'cam2' were 0.667 times what it is"),
    "millimetres": (in_millimetres, "With world_unit_m = 0.001 (millimetres) it were"),
    "other side": (of_the_other_side, "its joints are a right hand's"),
}  # fmt: skip


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_named_and_no_other(tmp_path, mistake):
    make, words = MISTAKES[mistake]
    it = recorded()
    make(it)
    said = [
        f.text for f in check_joints(Session.open(it.write(tmp_path))) if f.severity == "warning"
    ]
    assert len(said) == 1 and words in said[0], said


def test_a_camera_that_sees_one_finger_elsewhere_is_named(tmp_path):
    """In most frames the detector takes something else for the ring finger, in one camera."""
    it = recorded()
    ring = slice(13, 17)
    it.pixels["cam1"][: FRAMES * 3 // 4, ring] += (30.0, -25.0)
    said = [f for f in check_joints(Session.open(it.write(tmp_path))) if f.severity == "warning"]
    assert len(said) == 1
    assert "'cam1'" in said[0].text and "ring" in said[0].text and "'cam0'" not in said[0].text


@pytest.mark.parametrize("degrees", [(-35.0, 10.0, 50.0), (-20.0, 20.0), (0.0, 90.0)])
def test_a_sound_calibration_is_left_alone(tmp_path, degrees):
    found = list(check_joints(Session.open(recorded(degrees).write(tmp_path))))
    assert [f.severity for f in found] == ["ok"] and "meet in space to" in found[0].text, found
