"""The pose library: 26 letters and the common poses, all within limits, each its own."""

from __future__ import annotations

import string

import numpy as np
import pytest

from docs.pictures.pose_sheet import pose_sheet
from handtrack.errors import HandtrackError
from handtrack.geometry.rotation import rotation_matrix
from handtrack.model.model_file import load_model
from handtrack.model.pose_library import alphabet, named_pose, pose_names, pose_turn
from handtrack.tracking.frame.terms.contact import contact


@pytest.fixture(scope="module")
def hand():
    return load_model("hand26")


def joints(hand, name):
    return hand.joint_positions(hand.bones(hand.transform.solver_params(named_pose(hand, name))))


def at(hand, name, joint):
    return joints(hand, name)[hand.joint_names.index(joint)]


def test_the_library_has_the_alphabet_and_the_common_poses():
    assert alphabet() == tuple(f"lsf_{letter}" for letter in string.ascii_lowercase)
    assert {"rest", "open", "flat", "fist", "point", "pinch", "curl"} < set(pose_names())


@pytest.mark.parametrize("name", pose_names())
def test_every_pose_is_within_limits(hand, name):
    joint = named_pose(hand, name)
    bounds = hand.limits.bounds(joint)
    outside = (joint < bounds[:, 0] - 1e-9) | (joint > bounds[:, 1] + 1e-9)
    assert not outside.any(), [hand.parameter_names[i] for i in np.flatnonzero(outside)]
    assert not joint[:6].any()  # the root stays at the world's origin


def test_letters_differ_in_fingers_or_in_how_the_hand_is_held(hand):
    seen = {}
    for name in alphabet():
        held = joints(hand, name) @ rotation_matrix(pose_turn(name)).T
        for other, before in seen.items():
            assert np.linalg.norm(held - before, axis=1).max() > 0.012, (name, other)
        seen[name] = held


def test_fingers_touch_where_letters_want_them(hand):
    for name, joint in (("lsf_o", "middle_tip"), ("lsf_d", "middle_tip"), ("pinch", "index_tip")):
        gap = np.linalg.norm(at(hand, name, "thumb_tip") - at(hand, name, joint))
        assert gap < 0.03, name
    # R: index and middle finger cross
    assert at(hand, "lsf_r", "index_tip")[0] > at(hand, "lsf_r", "middle_tip")[0]
    assert at(hand, "lsf_u", "index_tip")[0] < at(hand, "lsf_u", "middle_tip")[0]


@pytest.mark.parametrize(
    ("letter", "straight"),
    [("b", "index middle ring little"), ("h", "index little"), ("i", "little"), ("l", "index"), ("u", "index middle"),
     ("v", "index middle"), ("w", "index middle ring"), ("m", "index middle ring"), ("n", "index middle"), ("y", "little"),
     ("g", "index"), ("s", ""), ("a", ""), ("d", "index"), ("e", ""), ("f", "middle ring little"),
     ("t", "middle ring little"), ("j", "little"), ("r", "index middle"), ("z", "index"), ("x", ""), ("o", "")],
)  # fmt: skip
def test_straight_fingers(hand, letter, straight):
    found = [
        finger
        for finger in ("index", "middle", "ring", "little")
        if at(hand, f"lsf_{letter}", f"{finger}_tip")[1]
        - at(hand, f"lsf_{letter}", f"{finger}_mcp")[1]
        > 0.05
    ]
    assert found == straight.split()


def test_how_hands_are_held():
    palm, fingers = np.array([0, 0, -1.0]), np.array([0, 1.0, 0])  # in the hand's axes
    turn = rotation_matrix(pose_turn("lsf_b"))
    assert np.allclose(turn @ palm, [0, 0, 1])
    assert np.allclose(turn @ fingers, [0, 1, 0])
    turn = rotation_matrix(pose_turn("lsf_n"))
    assert np.allclose(turn @ palm, [0, 0, -1])  # to the signer
    assert np.allclose(turn @ fingers, [1, 0, 0])
    left = rotation_matrix(pose_turn("lsf_n", side="left"))
    assert np.allclose(left @ fingers, [-1, 0, 0])
    assert np.linalg.det(rotation_matrix(pose_turn("lsf_q", "left"))) == pytest.approx(1)


def test_an_unknown_pose_names_the_known_ones(hand):
    with pytest.raises(HandtrackError, match="no pose 'lsf_é'; known: rest, open, flat, fist"):
        named_pose(hand, "lsf_é")
    with pytest.raises(HandtrackError, match="no pose 'x'"):
        pose_turn("x")


def test_the_contact_sheet_shows_every_pose(hand):
    sheet = pose_sheet(hand, ["lsf_a", "lsf_b", "fist"], columns=2, size=60)
    assert sheet.shape == (120, 120, 3)
    for row, column in ((0, 0), (0, 1), (1, 0)):
        tile = sheet[60 * row : 60 * row + 60, 60 * column : 60 * column + 60]
        assert (tile[25:] < 230).any(axis=-1).mean() > 0.05
    assert (sheet[60:, 60:] == 255).all()


def test_no_finger_lies_inside_another_part():
    """Flesh gives way by about 3 mm where pads press on each other; they had lain up to 14.7 mm deep (S)."""
    hand = load_model()
    for name in pose_names():
        pose = hand.transform.solver_params(named_pose(hand, name))
        depths = contact(hand).depths(hand.bones(pose))
        assert depths.max() < 3.2e-3, name


@pytest.mark.parametrize("side", ["right", "left"])
def test_where_letters_put_the_thumb(side):
    """By their descriptions: across the palm (B), before the bent fingers (S), along the index finger's side (A), away (L, Y)."""
    hand = load_model(side=side)
    towards_little = 1.0 if side == "right" else -1.0
    for letter in "bsaly":
        where = dict(zip(hand.joint_names, joints(hand, f"lsf_{letter}"), strict=True))
        tip, index, little = where["thumb_tip"], where["index_mcp"], where["little_mcp"]
        across = (tip - index)[0] / (little - index)[
            0
        ]  # 0 at the index finger's knuckle, 1 at the little's
        before_the_palm = index[2] - tip[2]
        if letter == "b":
            assert 0.5 < across < 1.2
            assert 0.02 < before_the_palm < 0.09
            assert where["wrist"][1] < tip[1] < index[1], "below the knuckles"
        elif letter == "s":
            assert 0.2 < across < 0.8
            assert tip[2] < where["middle_pip"][2] - 0.01, (
                "before the fingers that are bent into the palm"
            )
        else:
            assert towards_little * (tip - index)[0] < -0.03, "beside the hand, on its own side"
            reach = np.linalg.norm(tip - index)
            assert (reach > 0.075) == (letter in "ly"), letter


@pytest.mark.parametrize("letter", ["s", "i"])
def test_a_fist_is_closed_beneath_its_thumb(hand, letter):
    """The index was left half open where the thumb passes: it lies in the fist as its neighbour does."""
    index, middle = (at(hand, f"lsf_{letter}", f"{finger}_pip") for finger in ("index", "middle"))
    assert abs((index - middle)[1]) < 0.012
    thumb, before = (at(hand, f"lsf_{letter}", name) for name in ("thumb_tip", "middle_pip"))
    assert thumb[2] < before[2] - 0.01


def test_q_points_down():
    hand = load_model()
    joint = named_pose(hand, "lsf_q")
    joint[3:6] = pose_turn("lsf_q")
    places = dict(zip(hand.joint_names, hand.joint_positions(hand.bones(joint)), strict=True))
    for finger, knuckle in (("index", "mcp"), ("thumb", "cmc")):
        along = places[f"{finger}_tip"] - places[f"{finger}_{knuckle}"]
        assert along[1] < -0.8 * np.linalg.norm(along), finger


def test_letters_that_look_alike_differ_as_they_are_described(hand):
    """French manual alphabet: F has the thumb outside of the bent index, at its middle joint, T inside; others are splayed. A has
    the thumb out, S before the fingers (above). J is I with the thumb out. X bends two fingers. E's thumb touches none."""
    for letter, side in (("f", -1.0), ("t", 1.0)):
        tip, joint = (at(hand, f"lsf_{letter}", name) for name in ("thumb_tip", "index_pip"))
        assert side * (tip - joint)[0] > 0.01, letter
        assert abs((tip - joint)[1]) < 0.015, "at the middle joint"
        fan = (
            at(hand, f"lsf_{letter}", "little_tip")[0] - at(hand, f"lsf_{letter}", "middle_tip")[0]
        )
        together = at(hand, "lsf_b", "little_tip")[0] - at(hand, "lsf_b", "middle_tip")[0]
        assert fan > together + 0.03
    out = [at(hand, f"lsf_{x}", "thumb_tip") - at(hand, f"lsf_{x}", "index_mcp") for x in "ij"]
    assert out[1][0] < -0.05 < 0.0 < out[0][0]
    heights = {f: at(hand, "lsf_x", f"{f}_pip")[1] for f in ("index", "middle", "ring", "little")}
    assert min(heights["index"], heights["middle"]) > max(heights["ring"], heights["little"]) + 0.01
    tips = [at(hand, "lsf_e", f"{f}_tip") for f in ("index", "middle", "ring", "little")]
    assert min(np.linalg.norm(at(hand, "lsf_e", "thumb_tip") - tip) for tip in tips) > 0.02
