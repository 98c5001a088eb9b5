"""The definition hand26 keeps what contracts.md §1 promises."""

import numpy as np
import pytest

from handtrack.model.articulated import HandScale, keypoint_names
from handtrack.model.model_file import load_model


def tip(model, name, **angles):
    bones = model.bones(model.params_from(angles))
    return model.joint_positions(bones)[model.joint_names.index(name)]


def test_zero_pose_is_flat_with_fingers_along_y_and_the_thumb_at_minus_x():
    model = load_model()
    points = dict(zip(keypoint_names(), model.keypoints21(model.bones(np.zeros(26))), strict=True))
    for finger in ("index", "middle", "ring", "little"):
        along = points[f"{finger}_tip"] - points[f"{finger}_mcp"]
        np.testing.assert_allclose(along / np.linalg.norm(along), [0, 1, 0], atol=1e-12)
    assert points["thumb_tip"][0] < points["index_tip"][0] < points["little_tip"][0]
    assert np.linalg.norm(points["middle_tip"]) == pytest.approx(0.187, rel=0.02)


@pytest.mark.parametrize("finger", ["index", "middle", "ring", "little"])
def test_flexion_bends_to_the_palm(finger):
    model = load_model()
    for joint in ("mcp", "pip", "dip"):
        bent = tip(model, f"{finger}_tip", **{f"{finger}_{joint}_flex": 0.5})
        assert bent[2] < tip(model, f"{finger}_tip")[2] - 0.005


def test_signs_of_abduction():
    model = load_model()
    for finger, sign in (("index", -1), ("middle", -1), ("ring", 1), ("little", 1)):
        moved = tip(model, f"{finger}_tip", **{f"{finger}_mcp_abd": 0.3}) - tip(
            model, f"{finger}_tip"
        )
        assert np.sign(moved[0]) == sign, finger
    thumb = tip(model, "thumb_tip", thumb_cmc_abd=0.3) - tip(model, "thumb_tip")
    assert thumb[2] < -0.01  # away from the palm: to its side
    crossed = tip(model, "thumb_tip", thumb_cmc_flex=0.5) - tip(model, "thumb_tip")
    assert crossed[0] > 0.01  # flexed: across the palm


def test_wrist_flexion_brings_palm_and_forearm_together():
    model = load_model(forearm=True)
    bone = model.skeleton.bone("forearm")
    for name, axis, sign in (("wrist_flex", 2, -1), ("wrist_abd", 0, -1)):
        bones = model.bones(model.params_from({name: 0.4}))
        elbow = bones.to_world(bone, np.array([0, 0.25, 0]))
        assert sign * elbow[axis] > 0.05, name


def test_the_left_hand_is_the_exact_mirror_image(rng):
    right, left = load_model(forearm=True), load_model(side="left", forearm=True)
    params = rng.normal(scale=0.5, size=28)
    mirrored = params.copy()
    mirrored[0] *= -1  # the root is placed in the world, so it is mirrored like any point …
    mirrored[4:6] *= -1  # … and any rotation; joint angles keep their values
    a, b = right.bones(params), left.bones(mirrored)
    flip = np.array([-1.0, 1.0, 1.0])
    np.testing.assert_allclose(right.joint_positions(a) * flip, left.joint_positions(b), atol=1e-14)
    for key in ("fine", "metaballs"):
        one, other = right.flesh[key].posed(a), left.flesh[key].posed(b)
        np.testing.assert_allclose(one.centre * flip, other.centre, atol=1e-14)
        shape = np.einsum("eij,ej,ekj->eik", one.rotation, one.radii**2, one.rotation)
        mirror = np.einsum("eij,ej,ekj->eik", other.rotation, other.radii**2, other.rotation)
        np.testing.assert_allclose(shape * np.outer(flip, flip), mirror, atol=1e-14)


def test_scale_per_hand_and_per_finger():
    big, plain = load_model(scale=HandScale(1.1, {"thumb": 1.2})), load_model()
    a, b = (
        big.joint_positions(big.bones(np.zeros(26))),
        plain.joint_positions(plain.bones(np.zeros(26))),
    )
    names = plain.joint_names
    i, j = names.index("index_mcp"), names.index("index_tip")
    np.testing.assert_allclose(a[j] - a[i], 1.1 * (b[j] - b[i]))
    i, j = names.index("thumb_cmc"), names.index("thumb_tip")
    np.testing.assert_allclose(a[j] - a[i], 1.1 * 1.2 * (b[j] - b[i]))


def test_spread_shrinks_as_the_knuckle_bends():
    model = load_model()
    flex, abd = (
        model.skeleton.parameter("index_mcp_flex"),
        model.skeleton.parameter("index_mcp_abd"),
    )
    straight, bent = np.zeros(26), np.zeros(26)
    bent[flex] = np.deg2rad(90)
    assert np.ptp(model.limits.bounds(bent)[abd]) < 0.5 * np.ptp(model.limits.bounds(straight)[abd])
