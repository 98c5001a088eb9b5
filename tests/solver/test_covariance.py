"""What is known, and what is not: from the normal matrix to parameters and joints."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from handtrack import Keypoints, load_model
from handtrack.solver.covariance import (
    UNOBSERVABLE_STD,
    covariance,
    inherited_information,
    uncertainty,
    with_lasting_errors,
)
from handtrack.solver.levenberg_marquardt import SolverSettings, solve
from handtrack.solver.problem import Problem
from handtrack.terms.keypoints import KeypointTerm


def seen_joints(model, params, names=None, noise=0.0):
    names = names or model.joint_names
    points = model.joint_positions(model.bones(params))[[model.joint_names.index(n) for n in names]]
    return Problem(model, [KeypointTerm(model, Keypoints(tuple(names), points + noise, 0.002))])


@pytest.fixture(scope="module")
def model():
    return load_model()


@pytest.fixture(scope="module")
def bent(model):
    """A pose away from all limits."""
    bounds = model.bounds(model.rest_params())
    params = model.rest_params()
    params[6:] = bounds[6:, 0] + 0.4 * (bounds[6:, 1] - bounds[6:, 0])
    return params


def test_a_diagonal_matrix_by_hand():
    cov, blind = covariance(np.diag([4.0, 0.0, 100.0]))
    assert_allclose(np.diag(cov), [0.25, UNOBSERVABLE_STD**2, 0.01])
    assert_allclose(np.abs(blind.ravel()), [0.0, 1.0, 0.0])


def test_a_prediction_inherits_what_was_not_known_before():
    motion = np.diag([4.0, 0.0, 100.0])  # standard deviations of a half, any, a tenth
    before = np.diag([0.75, 5.0, 0.0])
    told = inherited_information(motion, before)
    assert_allclose(told, np.diag([1.0, 0.0, 100.0]), atol=1e-12)  # 1 / (1/4 + 3/4)
    assert inherited_information(motion, None) is motion
    assert inherited_information(motion, np.eye(2)) is motion


def test_noisy_points_scatter_the_pose_as_it_is_stated(rng, model, bent):
    """Many noisy views of one pose: the spread of joint positions is the stated one."""
    _, stated_std, stated = uncertainty(
        model, bent, seen_joints(model, bent).linearize(bent).hessian
    )
    settings = SolverSettings(iterations=6, damping=1e-6)
    noises = rng.normal(scale=0.002, size=(150, len(model.joint_names), 3))
    views = (seen_joints(model, bent, noise=noise) for noise in noises)
    found = np.array([solve(view, bent, settings).params for view in views])
    assert np.isfinite(stated_std).all()
    ratio = found.std(axis=0) / stated_std
    assert 0.8 < ratio.min()  # measured 0.88 … 1.11; 150 draws tell a deviation to 6 %
    assert ratio.max() < 1.25
    tips = np.array([model.joint_positions(model.bones(x)) for x in found])
    off = tips - tips.mean(axis=0)
    spread = np.einsum("nji,njk->jik", off, off) / len(off)
    total = np.trace(spread, axis1=1, axis2=2) / np.trace(stated, axis1=1, axis2=2)
    assert 0.75 < total.min()
    assert total.max() < 1.3


def test_what_is_not_seen_is_stated_as_infinite(model, bent):
    """Without its own points beyond the knuckle, a finger's bend is anyone's guess."""
    names = [n for n in model.joint_names if n not in ("index_pip", "index_dip", "index_tip")]
    problem = seen_joints(model, bent, names=names)
    _, parameter_std, spread = uncertainty(model, bent, problem.linearize(bent).hessian)
    std = dict(zip(model.parameter_names, parameter_std, strict=True))
    assert {n for n, s in std.items() if np.isinf(s)} == {
        "index_mcp_flex", "index_mcp_abd", "index_pip_flex", "index_dip_flex"
    }  # fmt: skip
    assert np.isfinite(spread).all()
    tip = model.joint_names.index("index_tip")
    wrist = model.joint_names.index("wrist")
    assert np.trace(spread[tip]) > 100 * np.trace(spread[wrist])


def test_a_coupling_carries_what_is_known_to_the_follower(bent, model):
    """With the distal joint coupled, the middle joint's point tells both."""
    coupled = load_model(coupling="21")
    params = coupled.transform.solver_params(model.joint_params(bent))
    names = [n for n in coupled.joint_names if not n.endswith("_tip")]
    problem = seen_joints(coupled, params, names=names)
    _, parameter_std, _ = uncertainty(coupled, params, problem.linearize(params).hessian)
    std = dict(zip(coupled.parameter_names, parameter_std, strict=True))
    assert std["index_dip_flex"] == pytest.approx(2 / 3 * std["index_pip_flex"])
    assert np.isfinite(list(std.values())).all()


@pytest.mark.parametrize(("noise", "lasting"), [(4.0, 0.8), (4.0, 0.0), (0.2, 0.95)])
def test_errors_that_last_are_not_counted_twice(rng, noise, lasting):
    """Against a filter run on a random walk that is measured with lasting errors."""
    step, count = 1.0, 200_000
    stated = 1.0
    for _ in range(1000):  # the filter's own variance, as if errors were new
        stated = 1.0 / (1.0 / (stated + step) + 1.0 / noise)
    memory, gain = 1.0 / (1.0 / stated - 1.0 / noise), stated / noise
    error, wrong, square = 0.0, 0.0, 0.0
    for walk, fresh in rng.normal(size=(count, 2)):
        wrong = lasting * wrong + np.sqrt((1 - lasting**2) * noise) * fresh
        error = (1 - gain) * (error - walk) + gain * wrong
        square += error**2
    told = with_lasting_errors(
        np.diag([1 / stated, 1.0]), np.diag([1 / memory, 0.3]), np.diag([1 / noise, 0.0]), lasting
    )
    assert 1.0 / told[0, 0] == pytest.approx(square / count, rel=0.05)
    assert told[1, 1] == pytest.approx(1.0)
