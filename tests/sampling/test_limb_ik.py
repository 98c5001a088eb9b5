"""Inverse kinematics: known answers, the way back from forward kinematics, and what descent does instead."""

import numpy as np
import pytest

from handtrack.geometry.rotation import rotation_matrix
from handtrack.model.model_file import load_model
from handtrack.sampling.chains import chain_along, chains_of, prepare
from handtrack.sampling.limb_ik_kernels import two_hinges
from tests.sampling.limb_angles import limb_angles

X, Y, Z = np.eye(3)


def _random_pose(model, rng):
    low, high = model.bounds(model.rest_params()).T
    params = np.where(np.isfinite(low), rng.uniform(np.maximum(low, -9), np.minimum(high, 9)), 0.0)
    params[:3] = rng.normal(size=3)
    params[3:6] = rng.normal(size=3)
    return model.clipped(params)


def test_two_hinges_by_hand():
    out = np.zeros((2, 2))
    assert two_hinges(Z, X, Y, -X, 0.0, 0.0, out) == 2
    np.testing.assert_allclose(out, [[np.pi / 2, 0.0], [-np.pi / 2, np.pi]], atol=1e-12)
    # the end on the first axis: that turn is free
    assert two_hinges(Z, X, Y, Z, 0.3, 0.0, out) == 1
    np.testing.assert_allclose(out[0], [0.3, np.pi / 2], atol=1e-12)
    assert two_hinges(Z, X, Y, np.array([0.0, 0.6, 0.8]), 0.0, 0.0, out) == 2
    bend = np.arctan2(0.8, 0.6)
    found = sorted(np.round(np.mod(out, 2 * np.pi), 9).tolist())
    np.testing.assert_allclose(found, [[0.0, bend], [np.pi, np.pi - bend]], atol=1e-8)


def test_two_hinges_give_back_random_turns(rng):
    out = np.zeros((2, 2))
    for _ in range(200):
        a, b, v = (u / np.linalg.norm(u) for u in rng.normal(size=(3, 3)))
        alpha, beta = rng.uniform(-np.pi, np.pi, 2)
        goal = rotation_matrix(a * alpha) @ rotation_matrix(b * beta) @ v
        count = two_hinges(a, b, v, goal, 0.0, 0.0, out)
        assert count == 2
        for first, second in out:
            reached = rotation_matrix(a * first) @ rotation_matrix(b * second) @ v
            np.testing.assert_allclose(reached, goal, atol=1e-7)
        assert (
            np.abs(np.exp(1j * out) - np.exp(1j * np.array([alpha, beta]))).max(axis=1).min() < 1e-6
        )


@pytest.mark.parametrize(
    ("name", "coupling"),
    [("hand26", "26"), ("hand26", "21"), ("body34", "26"), ("body38", "26")],
)
def test_every_limb_finds_its_way_back(name, coupling, rng):
    """Random poses within limits → positions → angles: the pose is among the solutions, and all reach the positions."""
    model = load_model(name, coupling=coupling)
    rest = model.rest_params()
    for chain in chains_of(model):
        ready = prepare(model, chain)
        joints = [model.joint_names.index(joint) for joint in chain.joints]
        own = [model.transform.names.index(p) for p in chain.parameters if p != "neck_twist"]
        for _ in range(20):
            params = _random_pose(model, rng)
            goal = model.joint_positions(model.bones(params))[joints]
            elsewhere = params.copy()
            elsewhere[own] = rest[own]
            found, row = limb_angles(model, elsewhere, ready, goal[None, 1:])
            assert len(found)
            assert (row == 0).all()
            off = np.abs(found - model.joint_params(params)).max(axis=1)
            assert off.min() < 1e-6, (chain.name, off)
            for joint in found:
                reached = model.joint_positions(model.bones(model.transform.solver_params(joint)))
                np.testing.assert_allclose(reached[joints], goal, atol=2e-6)


def test_a_ball_and_a_hinge_have_four_solutions_without_limits(rng):
    model = load_model("body34")
    chain = next(c for c in chains_of(model) if c.name == "left_arm")
    ready = prepare(model, chain)
    ready.interval[:] = (-np.pi, np.pi)
    params = _random_pose(model, rng)
    joints = [model.joint_names.index(joint) for joint in chain.joints]
    goal = model.joint_positions(model.bones(params))[joints]
    model.limits.interval[ready.columns] = (-np.pi, np.pi)
    found, _ = limb_angles(model, params, ready, goal[None, 1:])
    assert len(found) == 4
    flex = found[:, model.parameter_names.index("left_elbow_flex")]
    assert sorted(np.sign(flex)) == [-1, -1, 1, 1]
    for joint in found:
        np.testing.assert_allclose(
            model.joint_positions(model.bones(joint))[joints], goal, atol=1e-8
        )


def test_a_stretched_limb_keeps_its_twist_or_takes_the_one_given():
    model = load_model("body34")
    chain = next(c for c in chains_of(model) if c.name == "left_arm")
    params = model.rest_params()
    twist, flex = (
        model.parameter_names.index(f"left_{n}") for n in ("shoulder_twist", "elbow_flex")
    )
    params[[twist, flex]] = 0.4, 0.0
    joints = [model.joint_names.index(joint) for joint in chain.joints[1:]]
    goal = model.joint_positions(model.bones(params))[joints]
    kept, _ = limb_angles(model, params, chain, goal[None])
    np.testing.assert_allclose(kept[0], params, atol=1e-9)
    spare = params.copy()
    spare[twist] = -0.7
    sampled, _ = limb_angles(model, params, chain, goal[None], spare[None])
    assert sampled[0, twist] == pytest.approx(-0.7)
    np.testing.assert_allclose(
        model.joint_positions(model.bones(sampled[0]))[joints], goal, atol=1e-9
    )


def test_positions_out_of_reach_have_no_solution():
    model = load_model("body34")
    chain = chain_along(model, "forearm", ("left_elbow", "left_wrist"))
    params = model.rest_params()
    places = model.joint_positions(model.bones(params))
    away = places[model.joint_names.index("left_wrist")] + (0.0, 0.0, 0.05)
    found, row = limb_angles(model, params, chain, away[None, None])
    assert found.shape == (0, 34)
    assert row.shape == (0,)
