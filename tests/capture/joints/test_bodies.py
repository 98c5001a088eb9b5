"""2D joints of bodies in the forms that detectors write: recognised, the same points in a session, the same person throughout."""

import numpy as np
import pytest

from handtrack.capture.calibration.formats.read_calibration import BODY, subject_length
from handtrack.capture.images.openpose import LAYOUTS, read_openpose
from handtrack.capture.joints.given_joints import (
    checked_bodies,
    in_pixels,
    known_body_joint,
    layout_of,
    people,
    write_joints,
)
from handtrack.capture.joints.read_joints import read_joints
from tests.capture.joints.people import (
    FRAMES,
    LAYOUTS_OF,
    OPENPOSE,
    SIZE,
    in_order,
    names,
    person_in,
    pixels,
    places,
    rig,
)

SQUARES = {
    "body_25": 1860, "body_25b": 2924, "coco18": 819, "coco17": 1466, "halpe26": 3281, "coco133": 53365, "mediapipe33": 8389,
    "body22": 3311,
}  # fmt: skip


@pytest.mark.parametrize("form", [*OPENPOSE.split(), *LAYOUTS_OF])
def test_the_layout_is_recognised_and_points_are_kept(form, tmp_path):
    path, expected = person_in(form, tmp_path)
    given = read_joints(str(path), "it")
    assert layout_of(given.bodies, None, "it") == expected
    write_joints(in_pixels(people(given.bodies.frames)[0], SIZE), expected, tmp_path / "joints")
    rows = LAYOUTS[expected].points
    assert np.square([*rows.values()]).sum() == SQUARES[expected]
    known = rows.keys() - {"chest", "head", "left_hand", "right_hand"}  # which no file has
    for frame, seen in enumerate(pixels()):
        read = read_openpose(tmp_path / f"joints/{frame:06d}.json", LAYOUTS[expected])
        found = read[[rows[name] for name in known]]
        true = seen[[names().index(name) for name in known]]
        np.testing.assert_allclose(found, np.insert(true, 2, 0.8, axis=1), atol=1e-3)


@pytest.mark.parametrize("motion", ["dance", "greet", "still"])
@pytest.mark.parametrize("layout", ["body_25", "body_25b"])
def test_25_points_are_told_apart_by_the_bodies_they_make(layout, motion):
    for camera in (0, 1):
        seen = {f: [in_order(layout, p)] for f, p in enumerate(pixels(camera, motion))}
        bodies = checked_bodies(seen, "it")
        assert bodies is not None
        assert layout_of(bodies, None, "it") == layout


def test_who_stays_is_followed_though_others_are_listed_before_and_stand_taller():
    """The main person in all frames; a smaller one behind, exchanged with them in the list; a taller one who passes in two."""
    main = [in_order("coco17", seen) for seen in pixels()]
    behind = [p * (0.4, 0.4, 1.0) + (30.0, 40.0, 0.0) for p in main]
    passing = main[0] * (1.3, 1.3, 1.0) + (500.0, 0.0, 0.0)
    frames = {
        f: [behind[f], main[f]] if f % 2 else [main[f], behind[f]] for f in range(FRAMES) if f != 4
    }
    frames[6], frames[7] = [passing, *frames[6]], [*frames[7], passing]
    found = people(frames)
    assert [len(person) for person in found] == [FRAMES - 1, FRAMES - 1, 2]
    for f, points in found[0].items():
        np.testing.assert_array_equal(points, main[f])
    for f, points in found[1].items():
        np.testing.assert_array_equal(points, behind[f])


def test_names():
    spelt = {
        "LShoulder": "left_shoulder", "right_big_toe": "right_toe", "RIGHT_FOOT_INDEX": "right_toe", "shoulder.L": "left_shoulder",
        "LeftKnee": "left_knee", "MidHip": "pelvis", "hip": "pelvis", "left_hip": "left_hip", "Head_Top": "head_top", "nose": "nose",
        "knee": None, "tail": None, "left_small_toe": None, "left right knee": None,
    }  # fmt: skip
    assert {name: known_body_joint(name) for name in spelt} == spelt


def test_a_body_s_length_tells_the_unit():
    cameras = rig()
    joints = {
        camera.name: {f: in_order("coco17", p) for f, p in enumerate(pixels(i))}
        for i, camera in enumerate(cameras)
    }
    layouts = dict.fromkeys(joints, LAYOUTS["coco17"])
    found = subject_length(cameras, joints, layouts, BODY)
    rows = [names().index(f"left_{name}") for name in ("ankle", "knee", "hip", "shoulder")]
    true = np.linalg.norm(np.diff(places()[0, rows], axis=0), axis=1).sum()
    assert found == pytest.approx(true, rel=0.02)
    assert BODY.fits(true)
