"""OpenPose files: whose joints are taken, what is missing, and what is refused."""

import json

import numpy as np
import pytest

from handtrack import HandtrackError
from handtrack.capture.images.openpose import LAYOUTS, read_openpose, write_hand, written_by

BODY = LAYOUTS["body_25"]


def _person(height):
    points = np.column_stack([np.arange(25), np.linspace(0, height, 25), np.full(25, 0.9)])
    return {"pose_keypoints_2d": points.ravel().tolist()}


def _write(path, people):
    path.write_text(json.dumps({"version": 1.3, "people": people}))
    return path


def test_the_tallest_person_is_taken(tmp_path):
    file = _write(tmp_path / "a_0.json", [_person(100), _person(700), _person(300)])
    found = read_openpose(file, BODY)
    assert found.shape == (25, 3)
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
    write_hand(file, points, side, "a test")
    points[4] = (np.nan, np.nan, 0.0)
    for layout in (HAND, LAYOUTS[f"hand_{side}"]):
        assert np.array_equal(read_openpose(file, layout), points, equal_nan=True)
    assert written_by(file) == "a test"
