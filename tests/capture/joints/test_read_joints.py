"""2D joints in the forms that detectors write: the same points in a session, whatever they came from; and what is refused."""

import json
from pathlib import Path

import numpy as np
import pytest

from handtrack import HandtrackError
from handtrack.arrays import D3, D21, F, Floats
from handtrack.capture.images.openpose import LAYOUTS, read_openpose, write_points, written_by
from handtrack.capture.joints.given_joints import JOINTS, in_pixels, known_joint, write_joints
from handtrack.capture.joints.read_joints import read_joints
from tests.capture.joints.people import SIZE
from tests.capture.sample_files import HAND_FRAMES, forms, hand, sample
from tests.conftest import refused


def written(text: Path, folder: Path) -> Floats[F, D21, D3]:
    """Return what a session reads of a file's joints."""
    given = read_joints(str(text), "it")
    side, frames = given.hand(None, "it")
    points = in_pixels(frames, SIZE)
    write_joints(points, f"hand_{side or 'right'}", folder / "joints")
    layout = LAYOUTS[given.layout or f"hand_{side or 'right'}"]
    read = [read_openpose(folder / f"joints/{i:06d}.json", layout) for i in range(HAND_FRAMES)]
    return np.array(read)


WITH_CONFIDENCE = "openpose mmpose mmpose_from_one coco deeplabcut_csv deeplabcut_h5 sleap_h5"


@pytest.mark.parametrize("form", forms("hands"))
def test_points_and_confidence_are_kept(form, tmp_path):
    (path,), name = sample(form, tmp_path), form.split("/")[1]
    found = written(path, tmp_path)
    expected = hand()
    if name not in WITH_CONFIDENCE.split():
        expected = np.where(np.isnan(expected), 50.0, expected)
        expected[..., 2] = found[..., 2]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-3)


@pytest.mark.parametrize("spelling", [
    ("wrist thumb_cmc thumb_mcp thumb_ip thumb_tip", "{f}_mcp {f}_pip {f}_dip {f}_tip", "index middle ring little"),
    ("WRIST THUMB_CMC THUMB_MCP THUMB_IP THUMB_TIP", "{f}_FINGER_MCP {f}_FINGER_PIP {f}_FINGER_DIP {f}_FINGER_TIP", "INDEX MIDDLE RING PINKY"),
    ("RWrist RThumb1CMC RThumb2Knuckles RThumb3IP RThumb4FingerTip", "R{f}1Knuckles R{f}2PIP R{f}3DIP R{f}4FingerTip", "Index Middle Ring Pinky"),
    ("right_hand_root right_thumb1 right_thumb2 right_thumb3 right_thumb4", "right_{f}1 right_{f}2 right_{f}3 right_{f}4",
     "forefinger middle_finger ring_finger pinky_finger"),
    ("wrist thumb1 thumb2 thumb3 thumbTip", "{f}1 {f}2 {f}3 {f}Tip", "index mid ring small"),
    ("0 1 2 3 4", "", ""),
])  # fmt: skip
def test_usual_names_are_known(spelling):
    first, rest, fingers = spelling
    names = first.split() + [
        name.format(f=finger) for finger in fingers.split() for name in rest.split()
    ]
    assert [(known_joint(name) or ("none", ""))[0] for name in names] == list(JOINTS[: len(names)])


def test_mediapipe_s_sides_are_as_in_a_mirror(tmp_path):
    (path,) = sample("hands/mediapipe", tmp_path)
    table = json.loads(path.read_text())
    for frame in table:
        frame["handedness"].append([{"category_name": "Right", "score": 0.9}])
        frame["hand_landmarks"].append([{"x": 0.5, "y": 0.5, "z": 0} for _ in range(21)])
    path.write_text(json.dumps(table))
    given = read_joints(str(path), "it")
    assert given.hand("left", "it")[1][0][0, 0] == 0.5
    assert "as in a mirror" in given.notes[0]


@pytest.mark.parametrize("heads", ["cam_id,frame_index,keypoint_id", "port,frame_index,point_id"])
def test_caliscope_s_table_gives_the_joints_of_a_camera_by_its_number(heads, tmp_path):
    path = tmp_path / "xy.csv"
    rows = [f"sync_index,{heads},img_loc_x,img_loc_y,obj_loc_x,obj_loc_y"]
    for camera in (1, 4):
        for frame in (7, 8):
            rows += [f"9,{camera},{frame},{i},{100 * camera + i},{frame},," for i in range(21)]
    path.write_text("\n".join(rows))
    _, frames = read_joints(str(path), "it", camera="cam_4").hand(None, "it")
    assert sorted(frames) == [7, 8]
    np.testing.assert_allclose(frames[8][:, 0], 400 + np.arange(21))
    refused("1, 4", read_joints, str(path), "it", camera="cam_2")


BODY = LAYOUTS["body_25"]


def _person(height):
    points = np.column_stack([np.arange(25), np.linspace(0, height, 25), np.full(25, 0.9)])
    return {"pose_keypoints_2d": points.ravel().tolist()}


def test_the_tallest_person_is_taken(tmp_path):
    file, people = tmp_path / "a_0.json", [_person(100), _person(700), _person(300)]
    file.write_text(json.dumps({"version": 1.3, "people": people}))
    found = read_openpose(file, BODY)
    assert found[-1].tolist() == [24.0, 700.0, 0.9]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "not valid JSON"),
        ('{"version": 1.3}', "no list 'people'; expected a file as OpenPose writes it."),
        (
            '{"people": [{"hand_left_keypoints_2d": []}]}',
            "person 0 has no 'pose_keypoints_2d'. Another keypoint_layout may fit: "
            "body_25, body_25b, coco18, coco17, halpe26, coco133, mediapipe33, body22, hand_left, hand_right, mediapipe21.",
        ),
        (
            '{"people": [{"pose_keypoints_2d": [1, 2, 3]}]}',
            "'pose_keypoints_2d' of person 0 has 3 values; expected 25 times x, y, confidence.",
        ),
    ],
)
def test_other_files_are_refused(tmp_path, text, message):
    file = tmp_path / "odd_0.json"
    file.write_text(text)
    with pytest.raises(HandtrackError) as error:
        read_openpose(file, BODY)
    assert message in str(error.value)
    assert str(file) in str(error.value)


HAND = LAYOUTS["mediapipe21"]


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_hand_that_was_written_is_read_by_its_side_and_as_a_detectors(tmp_path, side):
    points = np.column_stack([np.arange(21.0), 2.5 * np.arange(21), np.full(21, 0.75)])
    points[4] = (7.0, 8.0, 0.0)  # not seen
    file = tmp_path / "000003.json"
    write_points(file, points, LAYOUTS[f"hand_{side}"], "a test")
    points[4] = (np.nan, np.nan, 0.0)
    for layout in (HAND, LAYOUTS[f"hand_{side}"]):
        assert np.array_equal(read_openpose(file, layout), points, equal_nan=True)
    assert written_by(file) == "a test"
