"""Each paper's method by name: each trait does what the paper's equation says."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from handtrack import (
    Observation,
    PointCloud,
    Status,
    Tracker,
    TrackerSettings,
    TrackerState,
    load_model,
)
from handtrack.model.metaballs import MetaballSurface, relaxed_mesh
from handtrack.sampling.diffusion import long_tailed
from handtrack.terms.priors import CorrelatedPrior
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.descent import descend
from handtrack.tracking.frame.frame_terms import frame_terms
from handtrack.tracking.frame.terms.cloud_terms import cloud_terms, see_cloud
from tests.experiments.scenes.closing_fist import scene
from tests.model.metaballs_reference import merged
from tests.terms.conic_field_reference import dense_field
from tests.tracking.scenes import Told, off_mm, on_surface

HAND, BALL = load_model(), load_model("ball6")


def settings(method, **values):
    return TrackerSettings().with_values({"method": method} | values)


# ---- 2007


@pytest.fixture(scope="module")
def fist():
    return scene(3, 100, (160, 120), range(0, 5))


def test_silhouettes_cost_half_the_sum_of_all_pixels_squares(fist):
    """Eq. 2, pixel by pixel."""
    seen, params = fist.observations[0], fist.model.rest_params()
    params[:6] = fist.joint_params[1][:6] + 0.01
    bones = fist.model.bones(params)
    terms = frame_terms(fist.model, settings("paper2007"), seen, bones, None)
    assert (terms.priors, terms.parts, terms.stages) == ((), (), 1)
    kept = [
        replace(s, valid=p.mask.valid)  # without what lies behind the wrist
        for s, p in zip(seen.silhouettes, terms.prepared, strict=True)
    ]
    plain = dense_field(kept, fist.model.ellipsoids["fine"], bones)
    for inside in (settings("paper2007").traits.inside, -1.0):
        chosen = settings("paper2007")
        chosen = replace(chosen, traits=replace(chosen.traits, inside=inside))
        (term,) = frame_terms(fist.model, chosen, seen, bones).stage(bones, 0)
        expected = 0.5 * float(((plain.predicted + inside * plain.observed) ** 2).sum())
        assert term.cost(bones) == pytest.approx(expected, rel=1e-5)


def test_without_limits_a_joint_bends_where_it_never_could(fist):
    names = fist.model.transform.names
    column = names.index("index_pip_flex")
    low = fist.model.bounds(fist.model.rest_params())[column, 0]
    beyond = fist.model.transform.solver_params(fist.joint_params[0])
    beyond[column] = low - 0.3
    seen = Observation(0, 0.0, silhouettes=())
    likely = CorrelatedPrior(beyond, np.eye(len(beyond)))
    for method, ends in (("paper2007", low - 0.3), ("default", low)):
        chosen = settings(method)
        terms = frame_terms(fist.model, chosen, seen, fist.model.bones(beyond), None)
        terms = replace(terms, priors=(likely,))
        start = fist.model.transform.solver_params(fist.joint_params[0])
        found = descend(terms, start)[0].params
        assert found[column] == pytest.approx(ends, abs=1e-3)


# ---- 2004


@pytest.fixture(scope="module")
def ball_cloud():
    rng = np.random.default_rng(0)
    points, _ = on_surface(BALL, np.zeros(6), 400, rng)
    return points[points[:, 2] > 0.0]  # seen from one side


@pytest.mark.parametrize(("distance", "beta"), [("d1", 1.0), ("d2", 1.0), ("d3", 0.4)])
def test_a_cloud_costs_what_the_papers_sums_say(ball_cloud, distance, beta):
    """F = K Σ d(X)² + (1 − K) Σ D(Y)² in square millimetres, halved: each point 1, no matter how far, on the whole surface."""
    chosen = settings(
        "paper2004",
        **{"cloud.balance": 0.3, "cloud.distance": distance, "cloud.sharpness_per_mm": beta},
    )
    behind = np.array([[0.0, -2.0, 0.0]])  # a view that sees none of what was measured
    points = np.concatenate([ball_cloud, ball_cloud[:5] + [0.0, 0.0, 0.05]])
    seen = Observation(0, 0.0, cloud=PointCloud(points), cloud_views=(behind,))
    bones = BALL.bones(np.array([0.003, -0.004, 0.002, 0.0, 0.1, 0.0]))
    found = see_cloud(seen, BALL, bones, chosen)
    assert found.prepared.count == len(points)  # 10 cm around
    cloud_side, model_side = cloud_terms(found, 1.2)
    surface = MetaballSurface.of(BALL, 1e3 * beta, distance)
    e1 = float((merged(surface, bones, points)[0] ** 2).sum())
    assert cloud_side.cost(bones) == pytest.approx(0.5 * 0.3 * 1e6 * e1, rel=1e-6)
    vertices, _ = relaxed_mesh(BALL, 1e3 * beta, distance).carried(bones)
    e2 = float((cdist(vertices, points).min(axis=1) ** 2).sum())
    # far from the cloud the nearest of some near points, so within some percent
    assert model_side.cost(bones) == pytest.approx(0.5 * 0.7 * 1e6 * e2, rel=0.04)
    assert found.sharpened(bones) is found


def test_fingers_are_shifted_to_both_sides_and_the_least_energy_wins():
    joint = HAND.rest_params()
    points, _ = on_surface(HAND, joint, 1500, np.random.default_rng(0))
    seen = Observation(0, 0.0, cloud=PointCloud(points))
    told = Told()
    tracker = Tracker(load_model(coupling="21"), settings("paper2004", **{"solver.iterations": 25}))
    begun = TrackerState.beginning_at(tracker.model.transform.solver_params(joint))
    _, result = tracker.step(begun, seen, Control(observer=told))
    (report,) = told
    ((proposed, trials),) = report.rounds
    assert proposed == len(trials) == 2
    assert (min(cost for _, cost in trials) < report.standing) == (report.winner is not None)
    assert off_mm(result, HAND, joint).mean() < 1.0
    assert result.status == Status.TRACKED


# ---- 2003


def test_the_long_tailed_bell_is_cauchys_along_each_axis(rng):
    root = rng.normal(size=(3, 3))
    spread, mean = root @ root.T + 0.1 * np.eye(3), rng.normal(size=3)
    samples = rng.normal(scale=4.0, size=(6, 3))
    height, distance = long_tailed(mean, spread, samples)
    values, vectors = np.linalg.eigh(spread)
    z = (samples - mean) @ vectors / np.sqrt(values)
    np.testing.assert_allclose(height, -np.log(np.sqrt(values) * (1 + z**2)).sum(axis=1))
    inverse = np.linalg.inv(spread)
    expected = [(x - mean) @ inverse @ (x - mean) for x in samples]
    np.testing.assert_allclose(distance, expected)
