"""Angles by the ISB's convention: what each sign means, on both hands, told by where the fingertip goes."""

from __future__ import annotations

import numpy as np
import pytest

from handtrack.export.isb import isb_angles, isb_std
from handtrack.model.articulated import FINGERS
from handtrack.model.model_file import load_model

SIDES = ("right", "left")


def angles(side: str, turned: dict[str, float] | None = None) -> dict[str, float]:
    """Return all angles [°] of a hand with a forearm, somewhere in the world, with some parameters [°] set."""
    model = load_model("hand26", side=side, forearm=True)
    values = {"root_tx": 0.3, "root_rx": 0.4, "root_ry": -1.1, "root_rz": 2.0}
    values |= {name: float(np.deg2rad(value)) for name, value in (turned or {}).items()}
    bones = model.bones(model.params_from(values))
    found = isb_angles(model, bones.T_world_bone[None])
    return {name: float(np.rad2deg(value[0])) for name, value in found.items()}


def tip(side: str, finger: str, turned: dict[str, float]) -> np.ndarray:
    """Return where a fingertip is in the hand's frame [m]."""
    model = load_model("hand26", side=side)
    values = {name: float(np.deg2rad(value)) for name, value in turned.items()}
    bones = model.bones(model.params_from(values))
    return model.joint_positions(bones)[model.joint_names.index(f"{finger}_tip")]


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("finger", FINGERS[1:])
@pytest.mark.parametrize("joint", ["mcp", "pip", "dip"])
def test_flexion_is_towards_the_palm(side, finger, joint):
    name = f"{finger}_{joint}_flex"
    moved = tip(side, finger, {name: 20}) - tip(side, finger, {})
    assert moved[2] < -0.002  # +z is the back of the hand
    change = angles(side, {name: 20})[f"{finger}_{joint}_flexion"] - angles(side)[f"{finger}_{joint}_flexion"]  # fmt: skip
    assert change == pytest.approx(20, abs=2.0)  # about an axis square to the bone


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("finger", FINGERS[1:])
def test_deviation_is_towards_the_little_finger(side, finger):
    """Our abduction leads away from the middle finger, the ISB's deviation to the ulna, whichever finger it is."""
    ulnar = 1.0 if side == "right" else -1.0  # x of the little finger's side
    name = f"{finger}_mcp_abd"
    moved = tip(side, finger, {name: 10}) - tip(side, finger, {})
    change = angles(side, {name: 10})[f"{finger}_mcp_ulnar_deviation"] - angles(side)[f"{finger}_mcp_ulnar_deviation"]  # fmt: skip
    assert np.sign(change) == np.sign(ulnar * moved[0])
    assert abs(change) == pytest.approx(10, abs=0.5)


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("joint", ["mcp", "ip"])
def test_the_thumb_bends_positively(side, joint):
    change = angles(side, {f"thumb_{joint}_flex": 20})[f"thumb_{joint}_flexion"] - angles(side)[f"thumb_{joint}_flexion"]  # fmt: skip
    assert change == pytest.approx(20, abs=1e-6)


@pytest.mark.parametrize("side", SIDES)
def test_the_thumbs_base_flexes_across_the_palm_and_adducts_into_its_plane(side):
    """Flexion by where the thumb's tip goes: to the little finger's side; adduction by what rises out of the palm's plane."""
    relaxed = {"thumb_cmc_flex": 8, "thumb_cmc_abd": 18}
    bent, raised = relaxed | {"thumb_cmc_flex": 28}, relaxed | {"thumb_cmc_abd": 38}
    ulnar = 1.0 if side == "right" else -1.0
    assert ulnar * (tip(side, "thumb", bent) - tip(side, "thumb", relaxed))[0] > 0.01
    assert (tip(side, "thumb", raised) - tip(side, "thumb", relaxed))[2] < -0.01
    before, after, up = (angles(side, pose) for pose in (relaxed, bent, raised))
    assert after["thumb_cmc_flexion"] - before["thumb_cmc_flexion"] == pytest.approx(20, abs=3)
    assert up["thumb_cmc_adduction"] - before["thumb_cmc_adduction"] == pytest.approx(-20, abs=1)


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("name, rotation", [("wrist_flex", "flexion"), ("wrist_abd", "ulnar_deviation")])  # fmt: skip
def test_the_wrist_bends_to_the_palm_and_to_the_ulna(side, name, rotation):
    """Told by the hand's motion before the forearm: the palm's normal, and the little finger's side."""
    model = load_model("hand26", side=side, forearm=True)

    def fingertips_by_forearm(value: float) -> np.ndarray:
        bones = model.bones(model.params_from({name: float(np.deg2rad(value))}))
        arm = model.skeleton.bone("forearm")
        middle = model.joint_positions(bones)[model.joint_names.index("middle_tip")]
        return bones.rotation[arm].T @ (middle - bones.position[arm])

    moved = fingertips_by_forearm(15) - fingertips_by_forearm(0)
    # the forearm's frame: +y to the elbow, +z dorsal, and so +x to the thumb of a right hand
    volar, ulnar = -moved[2], -moved[0] if side == "right" else moved[0]
    change = angles(side, {name: 15})[f"wrist_{rotation}"] - angles(side)[f"wrist_{rotation}"]
    assert np.sign(change) == np.sign(volar if rotation == "flexion" else ulnar)
    assert abs(change) == pytest.approx(15, abs=0.5)


@pytest.mark.parametrize("side", SIDES)
def test_pronation_turns_the_thumbs_side_to_the_palm(side):
    """No freedom of the model turns a finger about its own length, so its pose is turned here."""
    model = load_model("hand26", side=side)
    poses = model.bones(model.params_from({})).T_world_bone
    bone = model.skeleton.bone("index_intermediate")
    radial = -1.0 if side == "right" else 1.0
    for angle in (-0.2, 0.2):
        turned = poses.copy()
        cosine, sine = np.cos(angle), np.sin(angle)
        turned[bone, :3, :3] @= np.array([[cosine, 0, sine], [0, 1, 0], [-sine, 0, cosine]])
        to_the_thumb = radial * turned[bone, :3, 0]
        towards_the_palm = -float(to_the_thumb @ poses[bone, :3, 2])
        found = isb_angles(model, turned[None])["index_pip_pronation"][0]
        assert found == pytest.approx(np.arcsin(towards_the_palm), abs=1e-9)


def test_both_hands_have_the_same_angles_in_mirrored_poses():
    pose = {"index_mcp_flex": 40, "index_mcp_abd": 12, "thumb_mcp_flex": 20, "wrist_flex": 25}
    right, left = angles("right", pose), angles("left", pose)
    assert right == pytest.approx(left, abs=1e-9)


@pytest.mark.parametrize("side", SIDES)
def test_standard_deviations_are_carried_over(side, rng):
    """Each parameter's alone is the slope, by central differences; together they are what random parameters give."""
    model = load_model("hand26", side=side, forearm=True)
    values = rng.uniform(*model.limits.interval.clip(-1.0, 1.0).T)

    def isb(rows: np.ndarray) -> dict[str, np.ndarray]:
        poses = [model.bones(model.transform.solver_params(row)).T_world_bone for row in rows]
        return isb_angles(model, np.stack(poses))

    count, step = len(values), 1e-5
    alone = isb_std(model, np.tile(values, (count, 1)), np.eye(count))
    up, down = isb(values + step * np.eye(count)), isb(values - step * np.eye(count))
    for name, std in alone.items():
        np.testing.assert_allclose(std, np.abs(up[name] - down[name]) / (2 * step), atol=1e-7)
    std = np.full(count, 1e-3)
    drawn = isb(values + std * rng.normal(size=(2000, count)))
    for name, stated in isb_std(model, values[None], std[None]).items():
        assert stated[0] == pytest.approx(drawn[name].std(), rel=0.08, abs=1e-9)
