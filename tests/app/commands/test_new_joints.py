"""`handtrack new` with 2D joints of others, of hands and bodies, and Pose2Sim's projects as its versions lay them out: in a session
as its own, or refused in one sentence before anything is written."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from handtrack import CameraRig, Session, bundled_session
from handtrack.capture.calibration.rig_file import write_rig
from handtrack.capture.joints.given_joints import write_joints
from handtrack.capture.masks.seeded import Seeded
from handtrack.capture.masks.segmentation import SkinYCrCb
from tests.app.command_line import refused
from tests.app.commands.test_new import pictures
from tests.capture.calibration_forms.hostile import HOSTILE as CALIBRATIONS
from tests.capture.joints import people
from tests.capture.joints.hostile import HDF5, HOSTILE
from tests.capture.joints.people import in_order, openpose, pixels
from tests.capture.sample_files import hand, rig_of_two, sample
from tests.session.small_session import keypoints

RIG = ["--calibration", bundled_session() / "calibration.toml", "--fps", 30]


@pytest.fixture
def new(handtrack, tmp_path):
    """Make a session of joints by camera, which must go well; return it, and what was told."""

    def made(*words, out="made", **joints):
        ended = handtrack.does("new", "--out", tmp_path / out, *words, *given(joints))
        return Session.open(tmp_path / out), ended.err

    return made


def given(joints):
    return [word for name, path in joints.items() for word in ("--keypoints", f"{name}={path}")]


def pixels_of(session, camera, frame, name):
    """Return where a joint is seen, without the lens."""
    seen = session.view(camera).keypoints(frame, 1.0)[0]
    return seen.pixels[seen.names.index(name)]


def test_a_session_of_joints_alone(new, tmp_path):
    (left,), (right,) = (sample(f"hands/{n}", tmp_path / n) for n in ("openpose", "deeplabcut_csv"))
    session, told = new(*RIG, cam0=left, cam1=right)
    assert "elbow" in told
    assert session.frame_count == 3
    assert [c.keypoint_layout for c in session.file.cameras] == ["hand_right"] * 2
    first, second = (session.view(name).keypoints(2, 1.0)[0] for name in ("cam0", "cam1"))
    assert first.names == second.names and first.pixels.shape == (21, 2)


def test_masks_are_made_by_the_joints_of_most_images(new, tmp_path):
    (joints,) = sample("hands/openpose", tmp_path / "joints")
    words = [*RIG]
    for number, count in enumerate((6, 7)):  # joints are in 3
        words += ["--images", f"cam{number}={pictures(tmp_path / str(count), count)}"]
    session, told = new(*words, cam0=joints, cam1=joints)
    assert "masks of cam0: " in told
    assert [type(camera.masks) for camera in session.file.cameras] == [Seeded, SkinYCrCb]
    session, _ = new(*words, "--masks", "skin_ycrcb", out="named", cam0=joints, cam1=joints)
    assert [type(camera.masks) for camera in session.file.cameras] == [SkinYCrCb] * 2


def test_shares_are_of_the_camera_s_image(new, tmp_path):
    (path,) = sample("hands/mediapipe", tmp_path)
    session, _ = new(*RIG, "--side", "left", cam0=path)
    assert session.file.hand.side == "left"
    assert session.file.cameras[0].keypoint_layout == "mediapipe21"
    camera, seen = session.rig["cam0"], session.view("cam0").keypoints(0, 1.0)[0]
    assert camera.size == (640, 480)
    assert abs(seen.pixels - camera.undistort_points(hand()[0, :, :2])).max() < 1e-3


@pytest.mark.parametrize("kind", [*HOSTILE, *HDF5])
def test_joints_that_cannot_be_taken_are_refused_in_a_sentence(
    kind, handtrack, tmp_path, monkeypatch
):
    if kind in HDF5:
        for library in ("h5py", "pandas", "tables"):
            pytest.importorskip(library)
    write, expected = (HOSTILE | HDF5)[kind]
    for folder in ("given", "out"):
        (tmp_path / folder).mkdir()
    path = write(tmp_path / "given")
    monkeypatch.chdir(tmp_path)
    words = ["new", "--out", tmp_path / "out", *RIG, "--keypoints", f"cam0={path}"]
    refused(handtrack, tmp_path / "out", words, expected)
    assert not (tmp_path / "harmed").exists()


@pytest.mark.parametrize(("kind", "said", "off"), [
    ("centimetres", "unit: in its unit, the joints make a hand 1", 1e-9),
    ("COLMAP's unit", "unit: 1 m.", 0.25),
])  # fmt: skip
def test_joints_tell_the_unit(kind, said, off, handtrack, new, tmp_path):
    """Of a rig in centimetres, which cameras alone leave open; and of one that has no unit, a proposal that `--yes` takes."""
    rig = rig_of_two()
    hand_m = keypoints() - keypoints().mean(axis=0) + [0.0, 0.0, 0.5]
    write, _ = CALIBRATIONS[kind]
    path = write(tmp_path)
    words, joints = ["--fps", 30, "--calibration", path], {}
    for camera in rig:
        points = np.column_stack([camera.project(hand_m), np.ones(21)])
        joints[camera.name] = tmp_path / camera.name
        write_joints({0: points, 1: points}, "hand_right", joints[camera.name])
    session, told = new(*words, "--yes", **joints)
    assert said in told
    found = session.rig["cam1"].translation / rig["cam1"].translation
    assert found == pytest.approx(1.0, abs=off)
    wrong = [*words, *given(joints), "--out", tmp_path / "wrong", "--world-unit-m", 3]
    assert "expected 6 to 25 cm" in handtrack("new", *wrong).err


def test_own_markers_are_refused_with_a_table_that_then_names_them(handtrack, new, tmp_path):
    path, table = tmp_path / "own.csv", tmp_path / "made-names.toml"
    path.write_text(
        "frame,palm_x,palm_y,D2_base_x,D2_base_y,D2_tip_x,D2_tip_y\n0,10,20,30,40,50,60\n"
    )
    words = [*RIG, "--side", "right"]
    asked = ["new", "--out", tmp_path / "made", *words, *given({"cam0": path})]
    assert handtrack(*asked).code == 2
    assert not (tmp_path / "made").exists()
    text = table.read_text()
    for ours, theirs in {"wrist": "palm", "index_mcp": "D2_base", "index_tip": "D2_tip"}.items():
        text = text.replace(f'{ours} = ""', f'{ours} = "{theirs}"')
    table.write_text(text)
    session, _ = new(*words, "--names", table, cam0=path)
    expected = session.rig["cam0"].undistort_points(np.array([50.0, 60.0]))
    assert_allclose(pixels_of(session, "cam0", 0, "index_tip"), expected)


# ---- bodies


@pytest.fixture
def bodies(tmp_path):
    """Two cameras' joints of a person and of a smaller one behind, and their calibration."""
    write_rig(tmp_path / "rig.toml", people.rig())
    joints = {}
    for i, camera in enumerate(people.rig()):
        seen = {f: in_order("body_25b", p) for f, p in enumerate(pixels(i))}
        both = {f: [p * (0.4, 0.4, 1.0), p] for f, p in seen.items() if f != 3 or i}
        joints[camera.name] = openpose(tmp_path / camera.name, both)
    return ["--calibration", tmp_path / "rig.toml", "--fps", 25], joints


def test_a_body_by_joints_alone(new, bodies):
    words, joints = bodies
    session, told = new(*words, **joints)
    assert "--person" in told, "others are there"
    file = session.file
    assert (file.hand.model, file.hand.scale) == ("body34", "fit")
    assert session.frame_count == people.FRAMES
    assert [(c.keypoint_layout, c.masks) for c in file.cameras] == [("body_25b", None)] * 2
    assert file.tracking["silhouettes"]["bands_mm"] == [60.0, 30.0, 10.0]
    focal_px, distance_m = 608.0, 3.5
    expected = 0.025 * focal_px / distance_m
    assert file.tracking["keypoints"]["sigma_px"] == pytest.approx(expected, rel=0.1)
    assert pixels_of(session, "cam0", 5, "nose") == pytest.approx(pixels()[5][4], abs=0.01)
    assert not session.view("cam0").keypoints(3, 1.0)


def test_a_codec_s_padding_is_no_other_size(handtrack, new, bodies, tmp_path):
    """Calibrated for 640 × 480, recorded as 632 × 480: eight columns are filling. 624 columns are another image."""
    words, joints = bodies
    wide, narrow = (pictures(tmp_path / str(width), 1, (width, 480)) for width in (632, 624))
    session, _ = new(*words, "--images", f"cam0={wide}", **joints)
    assert session.rig["cam0"].size == (632, 480)
    assert_array_equal(session.rig["cam0"].matrix, people.rig()["cam0"].matrix)
    words += ["--images", f"cam0={narrow}", *given(joints)]
    assert handtrack("new", "--out", tmp_path / "no", *words).code == 2


VERSIONS = {
    "now": ("trial/calibration/Calib_scene.toml", "pose", "videos"),
    "a session's": ("S00_Calibration/Calib.toml", "pose", "videos"),
    "the first versions'": ("trial/calib-2d/Calib_qca.toml", "pose-2d", "raw-2d"),
    "beside the joints": ("trial/Calib.toml", "pose", "videos"),
}
"""of Pose2Sim: where the calibration is, the joints and the videos"""


def project(folder, version="now", names=("cam0", "cam1")):
    """Make a project whose trial is `trial`: two cameras' joints, a video of the first, settings in both levels."""
    calibration, poses, videos = VERSIONS[version]
    (folder / calibration).parent.mkdir(parents=True)
    cameras = (replace(c, name=n) for c, n in zip(people.rig(), names, strict=True))
    write_rig(folder / calibration, CameraRig(tuple(cameras)))
    for i in range(2):
        seen = {f: [in_order("halpe26", p)] for f, p in enumerate(pixels(i))}
        openpose(folder / "trial" / poses / f"cam{i}_json", seen, "cam_{:05d}.json")
    pictures(folder / "trial" / videos / "cam0", 3)
    (folder / "Config.toml").write_text(
        '[project]\nframe_rate = 50\n[pose]\npose_model = "Body_with_feet"\n'
    )
    (folder / "trial" / "Config.toml").write_text("[project]\nframe_rate = 60\n")
    return folder / "trial"


@pytest.mark.parametrize("version", VERSIONS)
def test_a_project_is_found_whole(version, new, tmp_path):
    session, told = new("--project", project(tmp_path / "p", version))
    assert str(tmp_path / "p" / VERSIONS[version][0]) in told
    assert "no video of cam1" in told
    assert (session.file.session.fps, session.file.hand.model) == (60.0, "body34")
    assert [c.images for c in session.file.cameras] == ["cam0/*.png", None]
    assert [c.keypoint_layout for c in session.file.cameras] == ["halpe26"] * 2
    assert session.frame_count == len(pixels())


def test_cameras_of_other_names_are_taken_in_order(new, tmp_path):
    session, told = new("--project", project(tmp_path / "p", names=("int_a_img", "int_b_img")))
    assert "'int_a_img'" in told
    assert pixels_of(session, "int_b_img", 5, "nose") == pytest.approx(pixels(1)[5][4], abs=0.01)


def test_what_pose2sim_synchronised_stays_so(handtrack, new, tmp_path):
    """In `pose-sync` the second camera's files are renumbered: what is frame 5 there is 7 in its video and in `pose`."""
    trial = project(tmp_path / "p")
    shutil.copytree(trial / "pose" / "cam0_json", trial / "pose-sync" / "cam0_json")
    later = trial / "pose-sync" / "cam1_json"
    later.mkdir()
    for f in range(2, len(pixels())):
        shutil.copyfile(trial / f"pose/cam1_json/cam_{f:05d}.json", later / f"cam_{f - 2:05d}.json")
    session, told = new("--project", trial)
    assert "cam1 by 2" in told
    for i, own in enumerate((5, 7)):
        assert pixels_of(session, f"cam{i}", 5, "nose") == pytest.approx(pixels(i)[own][4], abs=0.01)  # fmt: skip
    for path in later.iterdir():
        path.write_text(path.read_text().replace("0.8", "0.7"))
    ended = handtrack("new", trial, "--out", tmp_path / "bare")
    assert ended.code == 2 and f"--project {trial}" in ended.err
    words = ["new", "--out", tmp_path / "other", "--project", trial]
    refused(handtrack, tmp_path, words, ["holds other joints than"])
