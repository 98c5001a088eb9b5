"""What sums are made of: rows, bone systems, losses and priors."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from handtrack import load_model
from handtrack.terms.bone_kernels import pull_back
from handtrack.terms.bone_system import JointSystem, Sums
from handtrack.terms.loss import geman_mcclure, huber
from handtrack.terms.priors.priors import CorrelatedPrior, GaussianPrior
from handtrack.terms.rows import Rows, motion_row
from handtrack.tracking.frame.terms.posture import posture_prior
from tests.derivatives import check_parameter_term
from tests.terms.plain_rows import system_of


def test_a_point_row_times_a_twist_is_the_points_speed(rng):
    points, normals = rng.normal(size=(2, 5, 3))
    reference, v, w = rng.normal(size=(3, 3))
    speed = ((v + np.cross(w, points - reference)) * normals).sum(axis=1)
    row = motion_row(points, normals, reference)
    assert_allclose(row @ np.concatenate([v, w]), speed)


def test_the_system_is_that_of_the_dense_jacobian(rng):
    """Rows that touch no, one and two bones; one bone twice."""
    twist = rng.normal(size=(5, 6))
    row, bone = np.array([0, 2, 2, 3, 3]), np.array([1, 0, 2, 2, 2])
    residual, weight = rng.normal(size=4), rng.uniform(0.1, 1.0, 4)
    dense = np.zeros((4, 18))
    for r, b, t in zip(row, bone, twist, strict=True):
        dense[r, 6 * b : 6 * b + 6] += t
    system = system_of(Rows(residual, row, bone, twist, 1.25, weight), 3)
    assert system.cost == 1.25
    assert_allclose(system.gradient, dense.T @ (weight * residual))
    assert_allclose(system.hessian, dense.T @ (weight[:, None] * dense), atol=1e-12)


def random_sums(rng, width, bones=4):
    """Return sums in which bone 3 has no residual, and bones 0 and 1 none in common."""
    rows = rng.normal(size=(40, width * bones))
    rows[:, 3 * width :] = 0.0
    rows[:20, :width], rows[20:, width : 2 * width] = 0.0, 0.0
    residual = rng.normal(size=40)
    return Sums(width, rows.T @ residual, rows.T @ rows), rows, residual


def test_pull_back_is_the_system_of_the_chained_jacobian(rng):
    for width in (3, 6, 12):
        sums, rows, residual = random_sums(rng, width)
        motion, matrix = rng.normal(size=(4, width, 7)), rng.normal(size=(7, 4))
        motion[0, :, :2], motion[1, :, 5], motion[2, :, 1:4] = 0.0, 0.0, 0.0  # what leaves a bone
        system = JointSystem(2.0, *pull_back(sums, motion)).pull_back(matrix)
        jacobian = rows @ motion.reshape(-1, 7) @ matrix
        assert system.cost == 2.0
        assert_allclose(system.gradient, jacobian.T @ residual, atol=1e-10)
        assert_allclose(system.hessian, jacobian.T @ jacobian, atol=1e-10)


def test_geman_mcclure_saturates():
    loss = geman_mcclure(3.0)
    assert loss.value(np.array([9.0]))[0] == pytest.approx(4.5)  # half of it at one scale
    assert loss.value(np.array([1e8]))[0] == pytest.approx(9.0, rel=1e-6)
    assert loss.weight(np.array([1e8]))[0] < 1e-12


def test_huber_goes_on_straight():
    loss = huber(1.0)
    assert_allclose(loss.value(np.array([1.0, 4.0, 9.0])), [1.0, 3.0, 5.0])
    assert_allclose(loss.weight(np.array([0.0, 4.0])), [1.0, 0.5])


def test_a_standard_deviation_costs_a_half():
    prior = GaussianPrior(np.zeros(3), np.array([0.5, np.inf, 2.0]))
    assert prior.cost(np.array([0.5, 99.0, 0.0])) == pytest.approx(0.5)
    system = prior.linearize(np.array([0.5, 99.0, 4.0]))
    assert system.cost == pytest.approx(2.5)
    assert_allclose(system.gradient, [2.0, 0.0, 1.0])
    assert_allclose(system.hessian, np.diag([4.0, 0.0, 0.25]))


def test_a_bell_without_correlations_is_the_plain_prior(rng):
    sigma, x = np.array([0.5, 0.1, 2.0]), rng.normal(size=3)
    correlated, plain = (
        CorrelatedPrior(np.ones(3), np.diag(1 / sigma**2)),
        GaussianPrior(np.ones(3), sigma),
    )
    assert correlated.cost(x) == pytest.approx(plain.cost(x))
    assert_allclose(correlated.linearize(x).gradient, plain.linearize(x).gradient)
    assert_allclose(correlated.linearize(x).hessian, plain.linearize(x).hessian)


@pytest.mark.parametrize("strength", [0.25, 1.0])
def test_the_posture_prior_at_random_angles(rng, strength):
    model = load_model()
    prior = posture_prior(model, strength)
    check_parameter_term(prior, rng.normal(size=26), model.parameter_names)
    one = posture_prior(model, 1.0)
    x = rng.normal(size=26)
    assert prior.cost(x) == pytest.approx(strength * one.cost(x))


def test_the_last_joint_is_tied_to_the_middle_one_the_less_the_more_that_bends():
    """A finger's last joint 20° beside two thirds of the middle one, all fingers alike: the more these bend, the less it costs."""
    model = load_model()
    prior = posture_prior(model, 1.0)

    def costs(bent_deg, off_deg):
        evenly = np.zeros(len(model.parameter_names))
        for finger in ("index", "middle", "ring", "little"):
            for joint, deg in (
                ("mcp", bent_deg),
                ("pip", bent_deg),
                ("dip", 2 / 3 * bent_deg + off_deg),
            ):
                evenly[model.parameter_names.index(f"{finger}_{joint}_flex")] = np.deg2rad(deg)
        return prior.cost(evenly)

    assert costs(0.0, -20.0) == pytest.approx(4 * 0.5 * (20 / 14) ** 2)
    assert (
        costs(0.0, -20.0)
        > costs(45.0, -20.0)
        > costs(90.0, -20.0)
        == pytest.approx(4 * 0.5 * 20**2 / (14**2 + 18**2))
    )
