"""E1 equals its plain form; derivatives; odd clouds; it pulls a hand into place."""

import numpy as np
import pytest

from handtrack.model.flesh import Ellipsoids
from handtrack.model.kinematics import BonePoses
from handtrack.model.model_file import load_model
from handtrack.model.surfaces.metaballs import FORMS, MetaballSurface
from handtrack.model.surfaces.surface_mesh import sample_surface
from handtrack.solver.levenberg_marquardt import SolverSettings, solve
from handtrack.solver.problem import Problem
from handtrack.terms.clouds.cloud_distance import CloudDistanceTerm, prepare_cloud
from handtrack.terms.loss import geman_mcclure, huber, quadratic, uniform_outliers
from tests.derivatives import check_observation_term
from tests.model.metaballs_reference import cloud_rows
from tests.terms.plain_rows import system_of

LOSSES = [quadratic(), geman_mcclure(2.0), huber(1.5), uniform_outliers(0.2, 20.0)]


@pytest.fixture(scope="module")
def model():
    return load_model()


def hand_cloud(rng, model, count, noise=0.002, off=0.08):
    """Return points near a hand's surface, and bones some millimetres and degrees away."""
    truth = model.clipped(model.rest_params() + 0.2 * rng.normal(size=len(model.rest_params())))
    points, _ = sample_surface(MetaballSurface.of(model), model.bones(truth), count, rng)
    away = truth + off * rng.normal(size=len(truth))
    away[:3] = truth[:3] + 0.1 * off * rng.normal(size=3)
    return points + noise * rng.normal(size=points.shape), model.bones(model.clipped(away))


def assert_same(system, expected, cost=None):
    assert system.cost == pytest.approx(expected.cost, rel=1e-9)
    for mine, plain in ((system.gradient, expected.gradient), (system.hessian, expected.hessian)):
        np.testing.assert_allclose(mine, plain, rtol=1e-9, atol=1e-9 * np.abs(plain).max())


@pytest.mark.parametrize(("loss", "form"), [*zip(LOSSES, (*FORMS, "d3"), strict=True)])
def test_kernel_equals_the_plain_form(rng, model, form, loss):
    points, bones = hand_cloud(rng, model, 1501)
    points = np.concatenate([points, rng.uniform(-0.3, 0.3, size=(200, 3))])
    surface = MetaballSurface.of(model, form=form, sharpness=700.0)
    term = CloudDistanceTerm(prepare_cloud(points), surface, 0.003, loss, weight=0.4)
    plain = system_of(cloud_rows(surface, bones, points, 0.003, loss, 0.4), len(bones.position))
    assert_same(term.linearize(bones), plain)
    assert term.cost(bones) == pytest.approx(plain.cost, rel=1e-9)


@pytest.mark.parametrize(("sharpness", "flesh"), [(50.0, "metaballs"), (3000.0, "fine")])
def test_soft_and_hard_surfaces_of_many_ellipsoids(rng, model, flesh, sharpness):
    """Several ellipsoids on one bone, and weights of many at once."""
    points, bones = hand_cloud(rng, model, 700)
    surface = MetaballSurface.of(model, sharpness, flesh=flesh)
    term = CloudDistanceTerm(prepare_cloud(points), surface)
    plain = cloud_rows(surface, bones, points, term.sigma_m, quadratic())
    assert_same(term.linearize(bones), system_of(plain, len(bones.position)))


@pytest.mark.parametrize(("loss", "form"), [*zip(LOSSES, (*FORMS, "d3"), strict=True)])
def test_derivatives_by_every_bone(rng, model, form, loss):
    points, bones = hand_cloud(rng, model, 300)
    surface = MetaballSurface.of(model, form=form)
    term = CloudDistanceTerm(prepare_cloud(points), surface, 0.004, loss)
    check_observation_term(term, bones, model.skeleton.bone_names, step=1e-8, rtol=1e-4)


def test_one_ball_by_hand():
    """A point 1 mm outside along x pulls the ball that way, and turns it where its arm says."""
    flesh = Ellipsoids(
        ("b",), np.zeros(1, int), np.zeros((1, 3)), np.eye(3)[None], np.full((1, 3), 0.01)
    )
    bones = BonePoses(np.zeros(3), np.eye(3)[None], np.array([[0.0, 0.1, 0.0]]))
    term = CloudDistanceTerm(
        prepare_cloud(np.array([[0.011, 0.1, 0.0]])),
        MetaballSurface(flesh, np.ones((1, 1), bool)),
        0.002,
    )
    system = term.linearize(bones)
    assert system.cost == pytest.approx(0.5 * 0.5**2)
    row = -np.array([1, 0, 0, 0, 0, -0.1]) / 0.002
    np.testing.assert_allclose(system.gradient, 0.5 * row, atol=1e-12)
    np.testing.assert_allclose(system.hessian, np.outer(row, row), atol=1e-9)


def test_an_empty_cloud_asks_for_nothing(rng, model):
    _, bones = hand_cloud(rng, model, 1)
    for points in (np.zeros((0, 3)), np.full((4, 3), np.nan)):
        cloud = prepare_cloud(points)
        term = CloudDistanceTerm(cloud, MetaballSurface.of(model))
        system = term.linearize(bones)
        assert system.cost == term.cost(bones) == 0.0
        assert not system.gradient.any() and not system.hessian.any()
        assert (cloud.count, cloud.dropped) == (0, len(points))


@pytest.mark.parametrize("loss", LOSSES)
def test_a_losses_weight_is_the_slope_of_its_value(loss):
    squared = np.array([0.01, 0.5, 1.7, 9.0, 50.0])
    slope = (loss.value(squared + 1e-6) - loss.value(squared - 1e-6)) / 2e-6
    np.testing.assert_allclose(loss.weight(squared), slope, rtol=1e-6, atol=1e-9)
    assert loss.value(np.zeros(1))[0] == pytest.approx(0.0, abs=1e-15)


def test_a_cloud_of_the_model_pulls_it_into_place(rng, model):
    truth = model.clipped(model.rest_params() + 0.1 * rng.normal(size=len(model.rest_params())))
    surface = MetaballSurface.of(model)
    points, _ = sample_surface(surface, model.bones(truth), 5000, rng)
    points += 0.0003 * rng.normal(size=points.shape)
    start = truth.copy()
    start[:3] += [0.003, -0.003, 0.003]
    start[3:] += np.deg2rad(3) * rng.normal(size=len(truth) - 3)
    problem = Problem(model, [CloudDistanceTerm(prepare_cloud(points), surface, 0.0005)])
    found = solve(problem, model.clipped(start), SolverSettings(iterations=20)).params
    error = model.keypoints21(model.bones(found)) - model.keypoints21(model.bones(truth))
    assert np.linalg.norm(error, axis=1).mean() < 1.5e-4
