"""The doctor says what is odd without refusing it: files, masks, joints, cameras, before tracking and after it."""

import re
from dataclasses import dataclass, replace

import cv2
import numpy as np
import pytest

from handtrack import Camera, CameraRig, Session, TrackingRun
from handtrack.arrays import Floats
from handtrack.capture.calibration.rig_file import write_rig
from handtrack.session.doctor import check_hand
from handtrack.session.doctor.check_agreement import check_joints
from handtrack.session.doctor.check_hand import check_tracked_cameras, inconsistency_of_cameras
from handtrack.session.doctor.examine import examine, examine_start
from handtrack.session.layout import POSES_FILE
from handtrack.session.session_file import HandSettings
from handtrack.session.tables import write_result
from handtrack.simulation.simulate import Simulation, simulate, simulated_rig
from tests.cameras import turned
from tests.session.small_session import (
    add_joints,
    add_seen,
    edit,
    joints_session,
    keypoints,
    write_init,
    write_truth,
)
from tests.tracking.scenes import QUICK
from tests.tracking.test_shared_cameras import TRUTH

WAVING = TRUTH[::2]
"""joints of a hand that waves and closes"""


def masks(mask, frames=range(4)):
    def write(folder):
        for frame in frames:
            cv2.imwrite(str(folder / f"masks/cam1/{frame:03d}.png"), mask)

    return write


def test_a_sound_session_is_all_ok(folder):
    findings = examine(Session.open(folder))
    assert {finding.severity for finding in findings} == {"ok"}, findings


EMPTY = np.zeros((48, 64), np.uint8)
FULL = ~EMPTY
EDGE = EMPTY.copy()
EDGE[5:43, :30] = 255


def with_a_cloud_in_centimetres(folder):
    (folder / "clouds").mkdir()
    np.savez(folder / "clouds/0.npz", points=100 * keypoints() + (0, 0, 1))
    with (folder / "session.toml").open("a") as file:
        file.write('\n[clouds]\nfiles = "clouds/*.npz"\n')


def with_depth(value):
    def add(folder):
        (folder / "depth").mkdir()
        cv2.imwrite(str(folder / "depth/0.png"), np.full((48, 64), value, np.uint16))
        setting = 'name = "cam1"\ndepth = "depth/*.png"\ndepth_scale_m = 0.001'
        edit(folder / "session.toml", 'name = "cam1"', setting)

    return add


def edited(file, old, new):
    return lambda folder: edit(folder / file, old, new)


def with_masks_far_apart(folder):
    for frame in range(4):
        path = folder / f"masks/cam1/{frame:03d}.png"
        path.rename(path.with_name(f"{3001 * frame}.png"))
    masks(EMPTY, [3001])(folder)


def with_times_of_one_camera(folder):
    (folder / "t.csv").write_text("camera,frame,time_s\ncam0,0,0.0\ncam0,3,0.3")
    edit(folder / "session.toml", "fps = 10.0", 'timestamps = "t.csv"')


ODD = {
    "masks far apart": (with_masks_far_apart, "warning", "camera 'cam1': 1 of 4 masks are empty"),
    "times of one camera": (
        with_times_of_one_camera,
        "warning",
        "camera 'cam1' has no times in t.csv",
    ),
    "all masks empty": (
        masks(EMPTY),
        "error",
        "camera 'cam1': all masks looked at (4) are empty.",
    ),
    "inverted": (
        masks(FULL, range(1, 3)),
        "warning",
        "in 2 of 4 masks more than half of the image is hand, frames 1-2. Are they inverted?",
    ),
    "region of interest": (
        edited("session.toml", 'name = "cam1"', 'name = "cam1"\nroi = [0, 0, 1, 48]'),
        "warning",
        "camera 'cam1': in 4 of 4 masks most of the hand lies outside of roi = [0, 0, 1, 48], frames 0-3",
    ),
    "touching": (
        masks(EDGE),
        "note",
        "camera 'cam1': in 4 of 4 masks the hand reaches the image's border, frames 0-3",
    ),
    "gap": (
        lambda f: (f / "masks/cam1/001.png").unlink(),
        "warning",
        "camera 'cam1': 3 masks of 64 x 48; 1 frames are missing: 1.",
    ),
    "C14: an empty file": (
        lambda f: (f / "masks/cam1/002.png").write_bytes(b""),
        "warning",
        "frame 2 counts as missing",
    ),
    "calibration in mm": (
        edited("calibration.toml", "[0.0, 0.0, 0.5]", "[0.0, 0.0, 500.0]"),
        "warning",
        "with world_unit_m = 1. Is calibration.toml in millimetres? Then world_unit_m = 0.001.",
    ),
    "matrix of another size": (
        edited("calibration.toml", "0.0, 31.5]", "0.0, 310.0]"),
        "warning",
        "camera 'cam0': the principal point (310, 24) is far from the middle of 64 x 48.",
    ),
    "focal length": (
        edited("calibration.toml", "[80.0, 0.0", "[8000.0, 0.0"),
        "warning",
        "camera 'cam0': a focal length of 8000 px is unusual for an image 64 px wide",
    ),
    "folding lens": (
        edited("calibration.toml", "[0.0, 0.0, 0.0, 0.0, 0.0]", "[-1.5, 0.0, 0.0, 0.0, 0.0]"),
        "note",
        "camera 'cam0': the distortion folds back before the image's corners",
    ),
    "no first pose": (lambda f: (f / "init.json").unlink(), "note", "no init.json: tracking needs"),
    "small hand": (
        lambda f: write_init(f, xyz=(0.5 * keypoints()).tolist()),
        "warning",
        "init.json: from the wrist to the middle finger's knuckle it is 45 mm; expected 50 to "
        "130 mm.",
    ),
    "behind a camera": (
        lambda f: write_init(f, xyz=(keypoints() - (0, 0, 2)).tolist()),
        "warning",
        "init.json, frame 0: 21 of 21 keypoints lie behind camera 'cam0'.",
    ),
    "outside the image": (
        lambda f: write_init(f, xyz=(keypoints() + (1, 0, 0)).tolist()),
        "warning",
        "init.json, frame 0: 21 of 21 keypoints lie outside the image of camera 'cam0'.",
    ),
    "beside the mask": (
        lambda f: write_truth(
            f, keypoints21=np.repeat(keypoints()[None] + (0.15, 0, 0), 4, axis=0)
        ),
        "warning",
        "of the keypoints lie on the mask of camera 'cam0'. Do calibration, side, unit and",
    ),
    "a cloud elsewhere": (
        with_a_cloud_in_centimetres,
        "warning",
        "m away from the nearest points of the cloud (median). Is the unit right",
    ),
    "the same images twice": (
        edited("session.toml", 'name = "cam1"', 'name = "cam1"\nimages = "cam0/*.png"'),
        "warning",
        "cameras 'cam0' and 'cam1' are given the same images, \"cam0/*.png\".",
    ),
    "images shorter than masks": (
        lambda f: (f / "cam0/003.png").unlink(),
        "warning",
        "Lengths differ: camera 'cam0', images 3, camera 'cam0', masks 4, camera 'cam1' 4 frames.",
    ),
    "no saved hand": (
        edited("session.toml", 'scale = "fit"', 'scale = "init.json"'),
        "error",
        "init.json: a saved hand is a TOML or JSON file",
    ),
    "a lens of another size": (
        edited(
            "calibration.toml",
            "[[80.0, 0.0, 31.5], [0.0, 80.0",
            "[[40.0, 0.0, 31.5], [0.0, 40.0",
        ),
        "warning",
        "silhouettes do not fit together by this calibration: those of cameras 'cam0' and 'cam1' by ",
    ),
    "truth too long": (
        lambda f: write_truth(f, frame=np.array([2, 3, 4, 5]), time_s=None),
        "warning",
        "truth.npz: the session has no frames 4-5.",
    ),
    "truth at another rate": (
        lambda f: write_truth(f, time_s=np.arange(4) / 5),
        "warning",
        "truth.npz: its times run differently from the session's",
    ),
    "no depth": (
        with_depth(0),
        "error",
        "camera 'cam1': no depth is measured in the frames looked at; all is 0.",
    ),
    "depth in another unit": (
        with_depth(50),
        "warning",
        "camera 'cam1': the median depth is 0.05 m, with depth_scale_m = 0.001. Is the scale",
    ),
}


def test_before_tracking_only_what_would_make_it_vain_is_said(folder):
    (folder / "truth.npz").unlink()
    assert examine_start(Session.open(folder)) == []
    edit(folder / "calibration.toml", "[0.0, 0.7, 0.0]", "[0.0, 0.0, 0.0]")
    assert any("'cam0' and 'cam1'" in text for text in examine_start(Session.open(folder)))


@pytest.mark.parametrize("case", ODD)
def test_odd_things_are_found(case, folder, monkeypatch):
    # whose hand it is has tests of its own, and takes longer than all the rest
    """Faults C6, C16, C22."""
    monkeypatch.setattr(check_hand, "misfits_m", lambda xyz: {})
    damage, severity, text = ODD[case]
    damage(folder)
    findings = examine(Session.open(folder))
    assert any(f.severity == severity and text in f.text for f in findings), findings


NOISE_PX = 1.5
SIZE = (640, 480)


@dataclass
class Recording:
    """What the cameras saw, and what the session says of them."""

    cameras: dict[str, Camera]
    pixels: dict[str, Floats]
    side: str = "right"

    def warnings(self, folder):
        """Return what the doctor warns of in the session."""
        return [f.text for f in self.found(folder) if f.severity == "warning"]

    def found(self, folder):
        rig = CameraRig(tuple(self.cameras.values()))
        joints_session(folder, rig, HandSettings(side=self.side))
        add_joints(folder, {name: dict(enumerate(rows)) for name, rows in self.pixels.items()})
        return list(check_joints(Session.open(folder)))


def recorded(cameras=3):
    rng, rig = np.random.default_rng(5), simulated_rig(cameras, SIZE, 0.5, True)
    hand = WAVING - WAVING.mean(axis=(0, 1))  # in the middle of the images
    pixels = {c.name: c.project(hand) + rng.normal(0, NOISE_PX, (*hand.shape[:2], 2)) for c in rig}
    return Recording({camera.name: camera for camera in rig}, pixels)


def changed(change, *names):
    """Return what says something else of some cameras, or of all."""

    def say(it):
        for name in names or it.cameras:
            it.cameras[name] = replace(it.cameras[name], **change(it.cameras[name]))

    return say


def seen(name, change):
    """Return what lets a camera see something else."""
    return lambda it: it.pixels.update({name: change(it.pixels[name])})


MISTAKES = {
    "C27 inverse": (changed(lambda c: {"rotation": c.rotation.T, "translation": -c.rotation.T @ c.translation}), "led from the camera to the world"),
    "C28 exchanged": (lambda it: it.pixels.update(cam0=it.pixels["cam2"], cam2=it.pixels["cam0"]), "if cameras 'cam0' and 'cam2' were exchanged"),
    "C29 mirrored": (seen("cam1", lambda at: at * (-1, 1) + (SIZE[0] - 1, 0)), "if the images of camera 'cam1' were mirrored"),
    "late by one": (seen("cam1", lambda at: np.roll(at, 1, axis=0)), "with camera 'cam1' 1 frame late"),
    "another size": (changed(lambda c: {"matrix": c.matrix * [[1.5], [1.5], [1.0]]}, "cam2"), "if the matrix of camera 'cam2' were 0.667 times what it is"),
    "millimetres": (changed(lambda c: {"translation": 1000 * c.translation}), "With world_unit_m = 0.001 (millimetres) it were"),
    "other side": (lambda it: setattr(it, "side", "left"), "its joints are a right hand's"),
}  # fmt: skip


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_named_and_no_other(tmp_path, mistake):
    make, words = MISTAKES[mistake]
    it = recorded()
    make(it)
    (said,) = it.warnings(tmp_path)
    assert words in said
    assert "frame late" in said or said in examine_start(Session.open(tmp_path))


def test_a_camera_that_sees_one_finger_elsewhere_is_named(tmp_path):
    """In most frames the detector takes something else for the ring finger, in one camera."""
    it = recorded()
    it.pixels["cam1"][: len(WAVING) * 3 // 4, 13:17] += (-30.0, -25.0)
    (said,) = it.warnings(tmp_path)
    assert "'cam1'" in said and "ring" in said and "'cam0'" not in said


@pytest.mark.parametrize(("cameras", "every"), [(2, 99), (3, 2), (4, 99)])
def test_a_sound_calibration_is_left_alone(tmp_path, cameras, every):
    """Where joints were marked in every other frame, a camera shares none with the others a frame later: they then agree without it."""
    it = recorded(cameras)
    for pixels in it.pixels.values():
        pixels[1::every] = np.nan
    (found,) = it.found(tmp_path)
    assert found.severity == "ok"


def tracked(folder, use):
    """Return what is said after tracking, and the run."""
    run = TrackingRun.open(Session.open(folder), QUICK | {"model.fit_size": "false"} | use)
    tracked = {r.frame: r for r in run.track(run.session.frame_range, *run.initial())}
    results = [tracked[frame] for frame in sorted(tracked)]
    (folder / POSES_FILE).parent.mkdir(exist_ok=True)
    write_result(folder / POSES_FILE, run.result(results))
    return inconsistency_of_cameras(run, results), run


LENS = [-0.014, 1.42, 0.0, 0.0, -6.39]  # a real camera's
JOINTS_ALONE = {"silhouettes.weight": 0}


def simulated(folder, motion):
    """Return a recording of a hand's masks by small cameras, and those."""
    what = Simulation(frames=5, size=(320, 240), images=False, motion=motion, seed=1, init_noise_m=0.0, distance_m=0.4)  # fmt: skip
    return simulate(folder, what), list(Session.open(folder).rig)


def calibrate(folder, cameras):
    write_rig(folder / "calibration.toml", CameraRig(tuple(cameras)))


def test_a_camera_turned_by_a_degree_is_named(tmp_path):
    folder, cameras = simulated(tmp_path / "session", "open_fist_open")
    assert tracked(folder, {})[0] == ""
    cameras[2] = turned(cameras[2], 0.7, -0.7, 0.0)
    calibrate(folder, cameras)
    said, run = tracked(folder, {"tracker.recovery": True})
    assert said.startswith("camera 'cam2' "), said
    angle = re.search(r"turned by about (\d\.\d)°", said)
    assert angle and float(angle[1]) == pytest.approx(1.0, abs=0.45), said
    (found,) = check_tracked_cameras(run.session)
    assert (found.severity, found.text) == ("warning", f"{POSES_FILE}: {said}")


def test_a_lens_that_lost_its_k3_is_named(tmp_path):
    """The hand is seen beside the middle, where the coefficient counts; the same with the whole lens is no fault."""
    folder, cameras = simulated(tmp_path / "session", "gestures")
    cameras = [
        replace(turned(one, 0.0, 14.0 * (-1) ** number, 0.0), distortions=np.array(LENS))
        for number, one in enumerate(cameras)
    ]
    calibrate(folder, cameras)
    add_seen(folder, np.load(folder / "truth.npz")["keypoints21"], 1.0)
    assert tracked(folder, JOINTS_ALONE)[0] == ""
    cameras[1] = replace(cameras[1], distortions=np.array([*LENS[:4], 0.0]))
    calibrate(folder, cameras)
    said, _ = tracked(folder, JOINTS_ALONE)
    assert "camera 'cam1'" in said and "with another lens" in said, said
