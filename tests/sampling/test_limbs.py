"""Limbs: inverse kinematics, interpretation trees, chains, and which of them jump."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from handtrack import load_model
from handtrack.sampling.chains import chain_along, chain_votes, chains_of
from handtrack.sampling.interpretation_tree import interpretation_tree
from tests.cameras import FACING, pinhole

BODY = load_model("body34")
LENS = (-0.1, 0.02, 0.001, -0.001, 0)
FRONT = pinhole("front", (1280, 960), 1100, FACING, (0, 0, 4), LENS)


def _random_pose(model, rng):
    low, high = model.bounds(model.rest_params()).T
    params = np.where(np.isfinite(low), rng.uniform(np.maximum(low, -9), np.minimum(high, 9)), 0.0)
    params[:3] = rng.normal(size=3)
    params[3:6] = rng.normal(size=3)
    return model.clipped(params)


def within_limits(limits, joint_params):
    """Return (N,) whether joint parameters (N, S) are within limits, also those that narrow with another."""
    low, high = np.moveaxis(limits.bounds(joint_params), -1, 0)
    return ((joint_params >= low - 1e-9) & (joint_params <= high + 1e-9)).all(axis=1)


def _distant(metres):
    return pinhole("far", (1280, 960), 275.0 * metres, FACING, (0, 0, metres))


def _pixels(params, joints):
    index = [BODY.joint_names.index(name) for name in joints]
    return FRONT.project(BODY.joint_positions(BODY.bones(params)))[index]


def test_one_flipped_link_by_hand():
    """A thigh lifted 30° to the camera flips to 30° away from it, as seen from far off."""
    far = _distant(3600.0)
    params = np.zeros(34)
    flex = BODY.parameter_names.index("left_hip_flex")
    params[flex] = np.deg2rad(30.0)
    thigh = chain_along(BODY, "thigh", ("left_hip", "left_knee"))
    leaves = interpretation_tree(BODY, params, [thigh], far)
    assert len(leaves) == 2
    assert_allclose(np.rad2deg(leaves[:, flex]), [30.0, -30.0], atol=0.02)


@pytest.mark.parametrize(
    ("name", "coupling"),
    [("hand26", "26"), ("hand26", "21"), ("hand26", "18"), ("body34", "26"), ("body38", "26")],
)
def test_all_leaves_are_seen_where_the_pose_is_and_one_is_the_pose(name, coupling, rng):
    """Random poses within limits, each limb looked for from the resting one."""
    model = load_model(name, coupling=coupling)
    rest = model.rest_params()
    for chain in chains_of(model):
        own = [model.transform.names.index(p) for p in chain.parameters if p != "neck_twist"]
        joints = [model.joint_names.index(joint) for joint in chain.joints]
        for _ in range(20):
            params = _random_pose(model, rng)
            places = model.joint_positions(model.bones(params))
            elsewhere, seen = params.copy(), FRONT.project(places)
            elsewhere[own] = rest[own]
            tree = interpretation_tree(model, elsewhere, [chain], FRONT, seen)
            assert within_limits(model.limits, tree @ model.transform.matrix.T).all()
            assert len(np.unique(tree.round(6), axis=0)) == len(tree)
            found = [model.joint_positions(model.bones(leaf))[joints] for leaf in tree]
            for leaf in found:
                assert_allclose(FRONT.project(leaf), seen[joints], atol=1e-6)
            assert np.abs(found - places[joints]).max(axis=(1, 2)).min() < 1e-8


def test_no_joint_is_put_behind_the_camera():
    """Ten centimetres before a shoulder, the line of sight to the elbow goes on behind."""
    arm = chain_along(BODY, "arm", ("left_shoulder", "left_elbow"))
    places = [BODY.joint_names.index(name) for name in arm.joints]
    rest = BODY.rest_params()
    shoulder, _ = BODY.joint_positions(BODY.bones(rest))[places]
    near = replace(_distant(1.0), translation=[0, 0, 0.1] - FACING @ shoulder)
    leaves = interpretation_tree(BODY, rest, [arm], near)
    found = [BODY.joint_positions(BODY.bones(leaf))[places] for leaf in leaves]
    assert near.to_camera(np.array(found))[..., 2].min() > 0.0


def test_a_stretched_limb_keeps_its_twist_or_has_one_drawn(rng):
    arm = chains_of(BODY)[1]
    params = BODY.rest_params()
    twist, flex = (
        BODY.parameter_names.index(f"left_{n}") for n in ("shoulder_twist", "elbow_flex")
    )
    params[[twist, flex]] = 0.4, 0.0
    kept, drawn = (interpretation_tree(BODY, params, [arm], FRONT, rng=by) for by in (None, rng))
    assert np.abs(kept - params).max(axis=1).min() < 1e-6
    own = drawn[np.abs(np.delete(drawn - params, twist, axis=1)).max(axis=1).argmin()]
    assert abs(own[twist] - 0.4) > 0.01
    seen = _pixels(params, arm.joints)
    assert_allclose(_pixels(own, arm.joints), seen, atol=1e-6)


def test_without_limits_the_tree_is_complete_and_limits_leave_what_they_allow(rng):
    camera = _distant(400.0)  # nearer by, some flipped thighs leave the knees out of reach
    free = load_model("body34")
    params = BODY.clipped(BODY.rest_params() + np.r_[np.zeros(6), 0.4 * rng.normal(size=28)])
    free.limits.interval[6:] = (-np.pi, np.pi)
    everything, kept = (
        interpretation_tree(
            model, params, [c for c in chains_of(model) if c.name != "neck"], camera
        )
        for model in (free, BODY)
    )
    assert len(everything) == 4**4
    assert 0 < len(kept) < len(everything)
    assert within_limits(BODY.limits, kept).all()
    # each that is allowed, and perhaps others whose nearest angles are not
    for leaf in everything[within_limits(BODY.limits, everything)]:
        assert np.abs(kept - leaf).max(axis=1).min() < 1e-7


def test_a_missed_ray_prunes_or_goes_on_with_the_nearest():
    params = BODY.rest_params()
    arm = chains_of(BODY)[1]
    targets = np.full((len(BODY.joint_names), 2), np.nan)
    wrist = BODY.joint_names.index("left_wrist")
    targets[wrist] = _pixels(params, ["left_wrist"])[0] + (0.0, 300.0)
    assert len(interpretation_tree(BODY, params, [arm], FRONT, targets)) == 0
    near = interpretation_tree(BODY, params, [arm], FRONT, targets, take_nearest=True)
    assert 1 <= len(near) <= 4
    assert within_limits(BODY.limits, near).all()
    reached = [_pixels(leaf, ["left_wrist"])[0, 1] for leaf in near]
    # it stretches towards it
    assert _pixels(params, ["left_wrist"])[0, 1] < max(reached) < targets[wrist, 1] - 1.0


def test_fingers_follow_as_far_as_their_hinges_let_them(rng):
    model = load_model("hand26")
    camera = pinhole("hand", (640, 480), 600)
    params = model.rest_params()
    params[2] = 0.5
    index = chains_of(model)[1]
    strict = interpretation_tree(model, params, [index], camera)
    assert_allclose(strict, params[None], atol=1e-7)  # hinges alone cannot flip
    near = interpretation_tree(model, params, [index], camera, take_nearest=True)
    assert len(near) > 2
    seen = [camera.project(model.joint_positions(model.bones(leaf))) for leaf in (*strict, *near)]
    assert sum(np.allclose(pixels, seen[0], atol=1e-6) for pixels in seen[1:]) == 1
    assert within_limits(model.limits, near).all()


def _votes(*gaussians):
    """Return votes by chain for a covariance of Gaussians: (variance, direction by name, in units of parameters' ranges) each."""
    ranges = np.ptp(BODY.bounds(BODY.rest_params()), axis=1)
    whole = np.zeros((len(ranges), len(ranges)))
    for variance, direction in gaussians:
        way = np.zeros(len(ranges))
        for name, share in direction.items():
            way[BODY.transform.names.index(name)] = share
        way *= np.where(np.isfinite(ranges), ranges, 1.0) / np.linalg.norm(way)
        whole += variance * np.outer(way, way)
    chains = chains_of(BODY)
    votes = chain_votes(BODY, BODY.rest_params(), whole, chains)
    return {chain.name: vote for chain, vote in zip(chains, votes, strict=True)}


def test_what_errs_together_votes_by_the_squares_of_its_shares():
    """One direction, 3 parts elbow and 4 parts knee, that are wrong together: 9 votes to 16."""
    together = _votes((1e-2, {"right_elbow_flex": 3.0, "left_knee_flex": -4.0}))
    assert together["right_arm"] == pytest.approx(9.0 / 25.0)
    assert together["left_leg"] == pytest.approx(16.0 / 25.0)


@pytest.mark.parametrize(("small", "has_say"), [(0.04, False), (0.06, True)])
def test_directions_vote_until_they_make_up_95_percent_of_the_variance(small, has_say):
    votes = _votes(
        (1.0 - small, {"right_elbow_flex": 1.0, "left_elbow_flex": 1.0}),
        (small, {"left_knee_flex": 2.0, "neck_flex": 1.0}),
    )
    assert votes["right_arm"] == pytest.approx(0.5 * (1.0 - small * has_say))
    assert votes["left_leg"] == pytest.approx(0.8 * small * has_say)
    assert votes["neck"] == pytest.approx(0.2 * small * has_say)
    assert votes["right_leg"] == pytest.approx(0.0, abs=1e-9)


def test_what_is_known_and_where_the_root_is_have_no_say():
    for nothing in ((), [(1.0, {"root_tz": 1.0})], [(1.0, {"spine_flex": 1.0})]):
        assert set(_votes(*nothing).values()) == {0.2}
    assert _votes((9.0, {"root_tz": 1.0}), (0.01, {"neck_flex": 1.0}))["neck"] > 0.99
