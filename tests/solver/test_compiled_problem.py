"""Compiled descent beside the plain form: every term's tables, the sums, the loop."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from handtrack.model.model_file import load_model
from handtrack.model.surfaces.metaballs import MetaballSurface
from handtrack.model.surfaces.surface_mesh import surface_mesh
from handtrack.observation.observation import ImageKeypoints, Keypoints
from handtrack.observation.pins import ImagePins, Pin
from handtrack.simulation.scenes.simulated_views import mask_views
from handtrack.simulation.simulate import simulated_rig
from handtrack.solver.assembly import assemble
from handtrack.solver.levenberg_marquardt import SolverSettings, solve
from handtrack.solver.problem import FreeProblem, Problem
from handtrack.terms.clouds.cloud_distance import CloudDistanceTerm, prepare_cloud
from handtrack.terms.clouds.cloud_emptiness import CloudEmptinessTerm
from handtrack.terms.clouds.cloud_rays import CloudRaysTerm
from handtrack.terms.collision import CollisionTerm
from handtrack.terms.keypoints import KeypointTerm
from handtrack.terms.loss import GemanMcClure, Huber, UniformOutliers
from handtrack.terms.priors.priors import CorrelatedPrior, GaussianPrior, LinearPrior
from handtrack.terms.silhouettes.conic_field import ConicFieldTerm
from handtrack.terms.silhouettes.coverage import CoverageTerm

CAMERAS = simulated_rig(2, (160, 120)).cameras
CASES = (
    "coverage", "coverage by rows", "conic field", "points", "pixels", "pins", "distance", "emptiness", "rays", "collision", "all",
)  # fmt: skip


@dataclass(frozen=True)
class Plain:
    """A problem without its compiled form."""

    problem: Problem

    def cost(self, params):
        return self.linearize(params).cost

    def linearize(self, params):
        problem = self.problem
        return assemble(problem.model, params, problem.observation_terms, problem.parameter_terms)

    @property
    def limits(self):
        return self.problem.limits


def scene(case, rng):
    """Return a problem of one kind of term with all kinds of priors, and a pose a little beside the true one."""
    model = load_model("body34") if case == "collision" else load_model(coupling="18")
    truth = model.rest_params()
    truth[1] = -0.09
    bones = model.bones(truth)
    start = model.clipped(truth + rng.normal(scale=0.03, size=len(truth)))
    points = model.joint_positions(bones)
    count = len(model.parameter_names)
    half = rng.normal(size=(count, count))
    priors = (
        GaussianPrior(model.rest, np.where(np.arange(count) < 6, np.inf, 0.4)),
        CorrelatedPrior(model.rest, half @ half.T),
        LinearPrior(
            rng.normal(size=(3, count)), GemanMcClure(2.0), 0.7, ratios=rng.normal(size=(3, count))
        ),
    )
    if case == "collision":
        crossed = truth.copy()
        crossed[6:] += rng.normal(scale=0.5, size=len(truth) - 6)
        return Problem(model, [CollisionTerm.of(model)], priors), model.clipped(crossed)
    masks, flesh = mask_views(model, truth, CAMERAS).silhouettes, model.flesh["fine"]
    mesh = surface_mesh(MetaballSurface.of(model), bones)
    cloud = mesh.vertices[::5] + rng.normal(scale=0.002, size=mesh.vertices[::5].shape)
    pixels = CAMERAS[0].project(points)
    pixels[3] = np.nan
    surface = MetaballSurface.of(model)
    emptiness = CloudEmptinessTerm.at_start(cloud, mesh, loss=UniformOutliers())
    terms = {
        "coverage": lambda: CoverageTerm(masks, flesh, 3.0, bones, weight=(0.3, 2.0)),
        "coverage by rows": lambda: CoverageTerm(masks, flesh, 3.0, bones, row_steps=(3, 2)),
        "conic field": lambda: ConicFieldTerm(masks, flesh),
        "points": lambda: KeypointTerm(model, Keypoints(model.joint_names, points, 0.005), 2.0),
        "pixels": lambda: KeypointTerm(
            model, ImageKeypoints(CAMERAS[0], model.joint_names, pixels, 2.0), 1.5, Huber(1.0)
        ),
        "pins": lambda: KeypointTerm(
            model,
            ImagePins(
                CAMERAS[0], (Pin("cam0", (80.0, 60.0), "", "ring_distal", (0.0, 0.01, 0.0)),)
            ),
        ),
        "distance": lambda: CloudDistanceTerm(prepare_cloud(cloud), surface, loss=Huber(2.0)),
        "emptiness": lambda: emptiness,
        "rays": lambda: CloudRaysTerm(cloud, CAMERAS[0].centre, surface),
    }
    chosen = terms.values() if case == "all" else [terms[case]]
    return Problem(model, [make() for make in chosen], priors), start


@pytest.mark.parametrize("case", CASES)
def test_sums_are_those_of_the_plain_form(case, rng):
    problem, params = scene(case, rng)
    assert problem.compiled is not None
    plain = Plain(problem).linearize(params)
    ours = problem.linearize(params)
    assert plain.cost > 0
    np.testing.assert_allclose(ours.cost, plain.cost, rtol=1e-12)
    np.testing.assert_allclose(problem.cost(params), plain.cost, rtol=1e-12)
    for found, known in ((ours.gradient, plain.gradient), (ours.hessian, plain.hessian)):
        np.testing.assert_allclose(found, known, atol=1e-11 * np.abs(known).max(), rtol=1e-9)


@pytest.mark.parametrize("case", ["coverage", "points", "distance"])
def test_the_loop_goes_the_way_of_the_plain_one(case, rng):
    problem, start = scene(case, rng)
    seen = []
    settings = SolverSettings(iterations=8)
    ours = solve(
        problem, start, settings, on_iteration=lambda k, x, cost: seen.append((k, x, cost))
    )
    plain = solve(Plain(problem), start, settings)
    np.testing.assert_allclose(ours.params, plain.params, atol=1e-9)
    assert (ours.why, ours.iterations) == (plain.why, plain.iterations)
    np.testing.assert_allclose(ours.cost_history, plain.cost_history, rtol=1e-9)
    np.testing.assert_allclose(ours.damping_history, plain.damping_history)
    assert [k for k, _, _ in seen] == list(range(1, len(ours.cost_history)))
    np.testing.assert_allclose([cost for _, _, cost in seen], ours.cost_history[1:])
    np.testing.assert_array_equal(seen[-1][1], ours.params)
    # what is given back belongs to the end, not to the place before it
    np.testing.assert_allclose(ours.system.gradient, problem.linearize(ours.params).gradient)


def test_a_descent_that_is_stopped_stays_where_it_is(rng):
    problem, start = scene("points", rng)
    found = solve(problem, start, should_stop=lambda: True)
    assert found.why == "stopped"
    np.testing.assert_allclose(found.params, start)


def test_frozen_parameters_do_not_move(rng):
    problem, start = scene("points", rng)
    free = np.arange(len(start)) % 2 == 0
    found = solve(FreeProblem(problem, free, start), start).params
    np.testing.assert_allclose(found[~free], start[~free], atol=1e-12)
    assert np.abs(found - start)[free].max() > 1e-3


def test_a_term_written_in_numpy_still_works(rng):
    problem, start = scene("points", rng)
    (term,) = problem.observation_terms

    class OnlyNumpy:
        name = "own"
        cost, linearize = term.cost, term.linearize

    own = replace(problem, observation_terms=[OnlyNumpy()])
    assert own.compiled is None
    np.testing.assert_allclose(solve(own, start).params, solve(problem, start).params, atol=1e-6)
