"""OpenPose files: whose joints are taken, what is missing, and what is refused."""

import json

import numpy as np
import pytest

from handtrack.capture.images.openpose import LAYOUTS, read_openpose, write_hand, written_by
from handtrack.errors import HandtrackError

BODY = LAYOUTS["body_25"]


def _person(height, key="pose_keypoints_2d", count=25):
    points = np.column_stack([np.arange(count), np.linspace(0, height, count), np.full(count, 0.9)])
    return {key: points.ravel().tolist()}


def _write(path, people):
    path.write_text(json.dumps({"version": 1.3, "people": people}))
    return path


def test_the_tallest_person_is_taken(tmp_path):
    file = _write(tmp_path / "a_0.json", [_person(100), _person(700), _person(300)])
    found = read_openpose(file, BODY)
    assert found is not None
    assert found.shape == (25, 3)
    assert found[-1].tolist() == [24.0, 700.0, 0.9]


def test_points_that_were_not_found_are_missing(tmp_path):
    person = _person(500)
    person["pose_keypoints_2d"][3:6] = [0.0, 0.0, 0.0]
    found = read_openpose(_write(tmp_path / "a_0.json", [person]), BODY)
    assert found is not None
    assert np.isnan(found[1, :2]).all()
    assert found[1, 2] == 0.0
    assert np.isfinite(found[[0, *range(2, 25)]]).all()


def test_nobody_is_nobody(tmp_path):
    assert read_openpose(_write(tmp_path / "a_0.json", []), BODY) is None
    empty = {"pose_keypoints_2d": [0.0] * 75}
    assert read_openpose(_write(tmp_path / "a_1.json", [empty]), BODY) is None


def test_layouts_name_each_point_once():
    for name, layout in LAYOUTS.items():
        rows = list(layout.points.values())
        assert len(set(rows)) == len(rows), name
        assert max(rows) < layout.count, name
    assert LAYOUTS["body_25"].points["left_shoulder"] == 5
    assert LAYOUTS["body_25b"].points["left_shoulder"] == 5
    assert LAYOUTS["body_25b"].points["right_toe"] == 22
    assert LAYOUTS["hand_right"].points["index_tip"] == 8


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
    write_hand(file, points, side, "a test")
    points[4] = (np.nan, np.nan, 0.0)
    for layout in (HAND, LAYOUTS[f"hand_{side}"]):
        assert np.array_equal(read_openpose(file, layout), points, equal_nan=True)
    assert written_by(file) == "a test"


def test_no_hand_is_nobody(tmp_path):
    write_hand(tmp_path / "0.json", None, "right", "a test")
    assert read_openpose(tmp_path / "0.json", HAND) is None


def test_of_two_hands_none_is_guessed(tmp_path):
    person = _person(10, "hand_left_keypoints_2d", 21) | _person(10, "hand_right_keypoints_2d", 21)
    file = _write(tmp_path / "a_0.json", [person])
    with pytest.raises(HandtrackError, match="has two hands.*hand_left or hand_right"):
        read_openpose(file, HAND)
    person["hand_left_keypoints_2d"] = []
    found = read_openpose(_write(tmp_path / "a_1.json", [person]), HAND)
    assert found is not None
    assert found.shape == (21, 3)


def test_who_wrote_other_files_is_unknown(tmp_path):
    assert written_by(_write(tmp_path / "a_0.json", [])) is None
    (tmp_path / "b").write_text("no json")
    assert written_by(tmp_path / "b") is None
