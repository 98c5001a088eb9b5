"""Interpretation trees: leaves look the same from the camera, keep their limits, and come in the number expected."""

import numpy as np
import pytest

from handtrack.geometry.camera import Camera
from handtrack.model.model_file import load_model
from handtrack.sampling.chains import chain_along, chains_of
from handtrack.sampling.interpretation_tree import TreeSettings, interpretation_tree
from handtrack.sampling.limb_ik_kernels import pierce
from tests.sampling.limb_angles import within_limits

ALL = TreeSettings(solutions="all")
NEAREST = TreeSettings(failing="nearest")


@pytest.fixture(scope="module")
def body():
    return load_model("body34")


@pytest.fixture(scope="module")
def camera():
    """Four metres before the body, with a lens."""
    matrix = np.array([[1100.0, 0.0, 640.0], [0.0, 1100.0, 480.0], [0.0, 0.0, 1.0]])
    lens = np.array([-0.1, 0.02, 0.001, -0.001, 0.0])
    return Camera("front", (1280, 960), matrix, lens, np.diag([1.0, -1.0, -1.0]), [0.0, 0.0, 4.0])


def _distant(metres):
    focal = 275.0 * metres
    matrix = np.array([[focal, 0.0, 640.0], [0.0, focal, 480.0], [0.0, 0.0, 1.0]])
    pose = np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, metres])
    return Camera("far", (1280, 960), matrix, np.zeros(5), *pose)


def _bent(body, rng):
    return body.clipped(body.rest_params() + np.r_[np.zeros(6), 0.4 * rng.normal(size=28)])


def _pixels(model, camera, params, joints):
    index = [model.joint_names.index(name) for name in joints]
    return camera.project(model.joint_positions(model.bones(params)))[index]


def test_ray_and_sphere_by_hand():
    points, missed = np.zeros((3, 2, 3)), np.zeros((3, 2), dtype=np.int8)
    starts = np.array([[0.0, 0.0, 5.0], [0.0, 0.6, 5.0], [0.0, 3.0, 5.0]])
    pierce(starts, np.zeros(3), np.array([0.0, 0.0, 1.0]), 1.0, points, missed, True)
    np.testing.assert_allclose(points[0], [[0, 0, 4], [0, 0, 6]])
    np.testing.assert_allclose(points[1], [[0, 0, 4.2], [0, 0, 5.8]])
    # missed: the sphere's point nearest to the ray
    np.testing.assert_allclose(points[2, 0], [0, 2, 5])
    assert missed.tolist() == [[0, 0], [0, 0], [1, 2]]
    pierce(starts, np.zeros(3), np.array([0.0, 0.0, 1.0]), 1.0, points, missed, False)
    assert missed[2].tolist() == [2, 2]
    pierce(starts[:1], np.array([0, 0, 4.5]), np.array([0.0, 0.0, 1.0]), 1.0, points, missed, False)
    assert missed[0].tolist() == [2, 0]  # the nearer one lies behind the camera


def test_one_flipped_link_by_hand(body):
    """A thigh lifted 30° to the camera flips to 30° away from it, as seen from far off."""
    far = _distant(3600.0)
    params = np.zeros(34)
    flex = body.parameter_names.index("left_hip_flex")
    params[flex] = np.deg2rad(30.0)
    thigh = chain_along(body, "thigh", ("left_hip", "left_knee"))
    leaves = interpretation_tree(body, params, [thigh], far)
    assert len(leaves) == 2
    np.testing.assert_allclose(np.rad2deg(leaves.params[:, flex]), [30.0, -30.0], atol=0.02)
    assert leaves.far.tolist() == [[False], [True]]


def test_every_leaf_is_seen_where_the_pose_is(body, camera, rng):
    chains = chains_of(body)
    joints = [joint for chain in chains for joint in chain.joints]
    for _ in range(5):
        params = _bent(body, rng)
        tree = interpretation_tree(body, params, chains, camera)
        assert tree.exact.all()
        assert within_limits(body.limits, tree.params).all()
        seen = _pixels(body, camera, params, joints)
        for leaf in tree.params:
            np.testing.assert_allclose(_pixels(body, camera, leaf, joints), seen, atol=1e-6)
        assert np.abs(tree.params - params).max(axis=1).min() < 1e-7  # the pose itself is a leaf
        assert len(np.unique(tree.far, axis=0)) == len(tree)


def test_leaves_meet_the_image_positions_given(body, camera, rng):
    params = _bent(body, rng)
    arm = chains_of(body)[1]
    targets = np.full((len(body.joint_names), 2), np.nan)
    shown = _pixels(body, camera, params, arm.joints[1:]) + (3.0, -4.0)
    for name, place in zip(arm.joints[1:], shown, strict=True):
        targets[body.joint_names.index(name)] = place
    tree = interpretation_tree(body, params, [arm], camera, targets)
    assert len(tree) > 0
    for leaf in tree.params:
        np.testing.assert_allclose(_pixels(body, camera, leaf, arm.joints[1:]), shown, atol=1e-6)


def test_without_limits_the_tree_is_complete_and_a_product(body, rng):
    camera = _distant(400.0)  # nearer by, some flipped thighs leave the knees out of reach
    free = load_model("body34")
    free.limits.interval[6:] = (-np.pi, np.pi)
    chains = [c for c in chains_of(free) if c.name != "neck"]
    params = _bent(body, rng)
    tree = interpretation_tree(free, params, chains, camera)
    assert len(tree) == tree.complete == 4**4
    sizes = [len(interpretation_tree(free, params, [chain], camera)) for chain in chains]
    assert np.prod(sizes) == len(tree)
    both = interpretation_tree(free, params, chains[:2], camera, settings=ALL)
    assert len(both) == 16 * 16  # four solutions for each set of joint positions


def test_limits_prune(body, camera, rng):
    params = _bent(body, rng)
    wide = load_model("body34")
    wide.limits.interval[6:] = (-np.pi, np.pi)
    legs = [c for c in chains_of(body) if c.name.endswith("leg")]
    everything = interpretation_tree(wide, params, legs, camera, settings=ALL).params
    kept = interpretation_tree(body, params, legs, camera, settings=ALL).params
    allowed = everything[within_limits(body.limits, everything)]
    assert 0 < len(kept) < len(everything)
    np.testing.assert_allclose(_in_order(kept), _in_order(allowed), atol=1e-7)


def _in_order(rows):
    return rows[np.lexsort(np.round(rows, 5).T)]


def test_a_missed_ray_prunes_or_goes_on_with_the_nearest(body, camera):
    params = body.rest_params()
    arm = chains_of(body)[1]
    targets = np.full((len(body.joint_names), 2), np.nan)
    wrist = body.joint_names.index("left_wrist")
    targets[wrist] = _pixels(body, camera, params, ["left_wrist"])[0] + (0.0, 300.0)
    assert len(interpretation_tree(body, params, [arm], camera, targets)) == 0
    near = interpretation_tree(body, params, [arm], camera, targets, NEAREST)
    assert 1 <= len(near) <= 4
    assert not near.exact.any()
    assert within_limits(body.limits, near.params).all()
    reached = [_pixels(body, camera, leaf, ["left_wrist"])[0, 1] for leaf in near.params]
    # it stretches towards it
    assert max(reached) > _pixels(body, camera, params, ["left_wrist"])[0, 1]


def test_fingers_follow_as_far_as_their_hinges_let_them(rng):
    model = load_model("hand26")
    matrix = np.array([[600.0, 0.0, 320.0], [0.0, 600.0, 240.0], [0.0, 0.0, 1.0]])
    camera = Camera("hand", (640, 480), matrix, np.zeros(5), np.eye(3), np.zeros(3))
    params = model.rest_params()
    params[2] = 0.5
    index = chains_of(model)[1]
    strict = interpretation_tree(model, params, [index], camera)
    np.testing.assert_allclose(strict.params, params[None], atol=1e-7)  # hinges alone cannot flip
    near = interpretation_tree(model, params, [index], camera, settings=NEAREST)
    assert len(near) > 2
    assert near.exact.sum() == 1
    assert within_limits(model.limits, near.params).all()
