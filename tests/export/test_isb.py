"""Angles by the ISB's convention: what each sign means, on both hands, told by where the fingertip goes."""

import numpy as np
import pytest

from handtrack import load_model
from handtrack.export.isb import isb_angles, isb_std
from handtrack.geometry.rotation import rotation_matrix
from handtrack.model.articulated import FINGERS

SIDES = ("right", "left")


def angles(side, turned=None):
    """Return all angles [°] of a hand with a forearm, somewhere in the world, with some parameters [°] set."""
    model = load_model("hand26", side=side, forearm=True)
    values = {"root_tx": 0.3, "root_rx": 0.4, "root_ry": -1.1, "root_rz": 2.0}
    values |= {name: float(np.deg2rad(value)) for name, value in (turned or {}).items()}
    bones = model.bones(model.params_from(values))
    found = isb_angles(model, bones.T_world_bone[None])
    return {name: float(np.rad2deg(value[0])) for name, value in found.items()}


TURNS = [
    *((f"{f}_{j}_flex", f"{f}_{j}_flexion", 20, 1.1) for f in FINGERS[1:] for j in ("mcp", "pip", "dip")),
    *((f"thumb_{j}_flex", f"thumb_{j}_flexion", 20, 1e-6) for j in ("mcp", "ip")),
    *((f"{f}_mcp_abd", f"{f}_mcp_ulnar_deviation", -10, 0.2) for f in ("index", "middle")),
    *((f"{f}_mcp_abd", f"{f}_mcp_ulnar_deviation", 10, 0.2) for f in ("ring", "little")),
    ("thumb_cmc_flex", "thumb_cmc_flexion", 20, 1.5), ("thumb_cmc_abd", "thumb_cmc_adduction", -20, 0.5),
    ("wrist_flex", "wrist_flexion", 15, 0.1), ("wrist_abd", "wrist_ulnar_deviation", -15, 0.1),
]  # fmt: skip
"""a parameter that is turned, the angle that follows, by how much and within what [°]; where parameters lead: tests/model/test_definitions.py"""


@pytest.mark.parametrize(("parameter", "angle", "change", "within"), TURNS)
def test_an_angle_follows_its_parameter_to_the_palm_and_to_the_ulna(
    parameter, angle, change, within
):
    turned = angles("right", {parameter: abs(change)})
    assert turned[angle] - angles("right")[angle] == pytest.approx(change, abs=within)


@pytest.mark.parametrize("side", SIDES)
def test_pronation_turns_the_thumbs_side_to_the_palm(side):
    """No freedom of the model turns a finger about its own length, so its pose is turned here."""
    model = load_model("hand26", side=side)
    poses = model.bones(model.params_from({})).T_world_bone
    bone = model.skeleton.bone("index_intermediate")
    radial = -1.0 if side == "right" else 1.0
    for angle in (-0.2, 0.2):
        turned = poses.copy()
        turned[bone, :3, :3] @= rotation_matrix(np.array([0.0, angle, 0.0]))
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
    """Each parameter's alone is the slope, by central differences; together their squares add."""
    model = load_model("hand26", side=side, forearm=True)
    values = rng.uniform(*model.limits.interval.clip(-1.0, 1.0).T)

    def isb(rows):
        poses = [model.bones(model.transform.solver_params(row)).T_world_bone for row in rows]
        return isb_angles(model, np.stack(poses))

    count, step = len(values), 1e-5
    alone = isb_std(model, np.tile(values, (count, 1)), np.eye(count))
    up, down = isb(values + step * np.eye(count)), isb(values - step * np.eye(count))
    for name, std in alone.items():
        np.testing.assert_allclose(std, np.abs(up[name] - down[name]) / (2 * step), atol=1e-7)
    std = rng.uniform(0.5, 1.5, count)
    together = isb_std(model, values[None], std[None])
    for name, each in alone.items():
        np.testing.assert_allclose(together[name][0], np.linalg.norm(each * std), rtol=1e-9)
