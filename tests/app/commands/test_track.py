"""`handtrack track` by masks that show more than the hand, by images alone, by raw mosaics; and of the other hand (fault C31)."""

import json

import cv2
import numpy as np
import pytest

from handtrack import Session, Status, bundled_session, evaluate, load_model, read_npz
from handtrack.model.pose_library import named_pose
from handtrack.session.first_pose import FirstPose, write_first_pose
from handtrack.tracking.find_pose import PoseEstimate
from handtrack_app.commands import track
from tests.app.command_line import SIZE
from tests.capture.mosaics import mosaic_of
from tests.session.small_session import edit


def paint(session, cameras, frame, painted):
    for camera in cameras:
        path = str(session / f"masks/{camera}/{frame:06d}.png")
        mask = cv2.imread(path, cv2.IMREAD_UNCHANGED)
        painted(mask)
        cv2.imwrite(path, mask)


def test_c16_c17_other_things_in_masks_are_told_and_cost_one_frame_at_most(handtrack, session):
    cameras = list(Session.open(session).camera_names)
    paint(session, cameras, 2, lambda mask: mask.fill(255))
    for frame in (3, 4):
        paint(
            session,
            ["cam1"],
            frame,
            lambda m: cv2.ellipse(m, (40, 50), (30, 40), 0, 0, 360, 255, -1),
        )
    ended = handtrack.does("track", session)
    assert "lost: frames 2" in ended.err
    found, truth = read_npz(session / "tracks/poses.npz"), Session.open(session).truth
    assert found.status.tolist() == [
        Status.TRACKED, Status.TRACKED, Status.LOST, Status.DOUBTFUL, Status.DOUBTFUL,
    ]  # fmt: skip
    assert "overlap by" in found.reason[3]
    assert "in cam1" in found.reason[3]
    off = np.linalg.norm(found.keypoints21 - truth.keypoints21, axis=2).mean(axis=1)
    assert off[[0, 1, 3, 4]].max() < 1e-3
    told = handtrack("doctor", session).out
    assert "'cam1': 2 of 5 masks" in told
    assert "frames 3-4" in told
    assert "in 1 of 5 masks" in told


DOUBT = "a left hand fits decisively better"


@pytest.fixture
def asked(monkeypatch):
    """The frames of each time that the side is asked for; it is always doubted."""
    times = []

    def doubted(*given):
        times.append(sorted(given[3]))  # type: ignore[call-overload]
        return DOUBT

    for place in ("handtrack.session.track_session", "handtrack.session.doctor.check_hand"):
        monkeypatch.setattr(f"{place}.wrong_side_warning", doubted)
    return times


def pinched(side, session):
    """Write the first pose of a hand; return its model, parameters and joints."""
    model = load_model(side=side)
    pose = named_pose(model, "pinch")
    points = model.keypoints21(model.bones(pose))
    write_first_pose(session / "init.json", FirstPose(0, xyz=points))
    return model, pose, points


def test_c31_track_and_doctor_name_the_other_side(handtrack, done, asked):
    pinched("right", done)
    assert DOUBT not in handtrack("doctor", done).out  # its first pose's joints tell
    poses = read_npz(done / "tracks/poses.npz")
    row = dict(zip(poses.parameter_names, map(float, poses.parameters[0]), strict=True))
    (done / "init.json").write_text(json.dumps({"frame": 0, "parameters": row}))
    ended = handtrack.does("track", done, "--frames", "0:2", "--json", "--restart")
    assert asked == [[0, 1]]
    assert DOUBT in json.loads(ended.out)["warnings"]
    assert f"note: {DOUBT}" in ended.err
    assert f"warning: tracks/poses.npz: {DOUBT}" in handtrack("doctor", done).out


def test_joints_of_the_other_hand_are_asked_about_before_anything_is_tracked(
    handtrack, session, tmp_path, monkeypatch, asked
):
    left, pose, points = pinched("left", session)
    out = tmp_path / "poses.npz"
    tracked = ("track", session, "--frames", "0:1", "--out", out)
    searched = (*tracked, "--init", "auto")
    points[0] = np.nan  # no camera shows the wrist
    found = PoseEstimate(left, pose, 0.0, confidence=1.0, frame=0, points=points)
    monkeypatch.setattr(track, "find_first_poses", lambda *_: [found])
    for command in (tracked, searched, ("size", session)):
        refused = handtrack(*command)
        assert refused.code == 2 and "--yes" in refused.err and not out.exists()
    handtrack.does(*tracked, "--yes")
    assert out.exists() and not asked
    ended = handtrack.does(*searched, "--yes", "--restart")
    assert asked and "a left hand's" in ended.err, (
        "points of a pose that was searched may tell no side"
    )


FRAMES = 2
CAMERAS = ("cam0", "cam1", "cam2")
SKIN = 'masks = { method = "skin_ycrcb", open_px = 0 }'


@pytest.fixture
def mosaics(session):
    """The small recording's first frames as its cameras' sensors would have given them: raw, masks from colour."""
    for camera in CAMERAS:
        (session / camera).mkdir()
        video = cv2.VideoCapture(str(bundled_session("open_fist_open") / f"{camera}.mp4"))
        for frame in range(FRAMES):
            raw = mosaic_of(cv2.resize(video.read()[1], SIZE), "GRBG").astype(np.uint16) * 16
            cv2.imwrite(str(session / camera / f"{frame:06d}.png"), raw)
        raw = f'images = "{camera}/*.png"\nbayer = "grbg"\nwhite_level = 4080\n{SKIN}'
        edit(session / "session.toml", f'masks = "masks/{camera}/*.png"', raw)
    return session


def test_raw_mosaics_are_tracked_like_colour_and_the_doctor_names_a_wrong_pattern(
    handtrack, mosaics
):
    colour = cv2.VideoCapture(str(bundled_session("open_fist_open") / "cam1.mp4")).read()[1]
    image = Session.open(mosaics).image("cam1", 0)
    assert np.abs(image.astype(int) - cv2.resize(colour, SIZE))[8:-8, 8:-8].mean() < 3.0
    handtrack.does("track", mosaics)
    truth = Session.open(mosaics).truth
    error = evaluate(read_npz(mosaics / "tracks/poses.npz"), truth)["mpjpe_tracked_mm"]
    assert error < 2.2  # 1.9 mm
    edit(mosaics / "session.toml", 'bayer = "grbg"', 'bayer = "rggb"')
    wrong = handtrack.does("doctor", mosaics).out
    assert "RGGB" in wrong and "GRBG" in wrong
