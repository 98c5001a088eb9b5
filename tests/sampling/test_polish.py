"""Polishing: the minima of the plain solver, true minima within limits, and what is none."""

import numpy as np
import pytest

from handtrack.geometry.camera import Camera
from handtrack.model.model_file import load_model
from handtrack.observation.observation import ImageKeypoints, Keypoints
from handtrack.sampling.chains import chains_of
from handtrack.sampling.interpretation_tree import interpretation_tree
from handtrack.sampling.polish import PolishSettings, polish
from handtrack.solver.levenberg_marquardt import SolverSettings, solve
from handtrack.solver.problem import Problem
from handtrack.terms.keypoints import KeypointTerm
from handtrack.terms.loss import geman_mcclure, huber
from handtrack.terms.priors.body_priors import body_priors
from handtrack.terms.priors.priors import GaussianPrior

FAR = SolverSettings(
    iterations=300, damping=1e-3, least_damping=1e-12, cost_tolerance=1e-15, step_tolerance=1e-11
)


def front_camera(distance=0.9, focal=600.0):
    turn = np.diag([1.0, -1.0, -1.0])
    matrix = np.array([[focal, 0, 320], [0, focal, 240], [0, 0, 1]])
    return Camera("front", (640, 480), matrix, np.zeros(5), turn, np.array([0.0, 0.1, distance]))


def rest_prior(model, sigma=0.8):
    widths = np.full(len(model.rest), sigma)
    widths[:6] = np.inf
    return GaussianPrior(model.rest, widths)


def hand_problem(rng, coupling="26", narrowing=False, where="space"):
    model = load_model("hand26", coupling=coupling, narrowing=narrowing)
    size = len(model.rest_params())
    truth = model.clipped(model.rest_params() + 0.3 * rng.normal(size=size))
    points = model.joint_positions(model.bones(truth))
    if where == "space":
        seen = Keypoints(model.joint_names, points + 0.003 * rng.normal(size=points.shape), 0.003)
    else:
        camera = front_camera()
        pixels = camera.project(points) + rng.normal(size=(len(points), 2))
        seen = ImageKeypoints(camera, model.joint_names, pixels, 1.0)
    starts = truth + 0.05 * rng.normal(size=(6, size)) * np.r_[np.full(3, 0.1), np.ones(size - 3)]
    return model, [seen], [rest_prior(model)], starts


@pytest.mark.parametrize(("coupling", "where"), [("26", "space"), ("21", "image"), ("18", "space")])
def test_ends_where_the_plain_solver_ends(rng, coupling, where):
    model, seen, priors, starts = hand_problem(rng, coupling, where=where)
    ends = polish(model, starts, seen, priors)
    assert ends.is_minimum.all()
    plain = Problem(model, [KeypointTerm(model, each) for each in seen], priors)
    for start, params, cost, normal in zip(
        starts, ends.params, ends.cost, ends.normal, strict=True
    ):
        known = solve(plain, start, FAR)
        np.testing.assert_allclose(cost, known.cost, rtol=1e-6)
        np.testing.assert_allclose(params, known.params, atol=1e-3)
        np.testing.assert_allclose(cost, plain.cost(params), rtol=1e-10)
        known_normal = plain.linearize(params).hessian
        np.testing.assert_allclose(normal, known_normal, atol=1e-8 * np.abs(known_normal).max())


@pytest.mark.parametrize("loss, share", [(geman_mcclure(3.0), 0.1), (huber(2.0), 0.6)])
def test_robust_losses(rng, loss, share):
    """Two joints that are 10 cm off move a robust minimum by far less than that of least squares."""
    model, (seen,), priors, starts = hand_problem(rng)
    clean = polish(model, starts[:1], [seen], priors).params
    wrong = seen.positions.copy()
    wrong[[8, 15]] += 0.1
    off = Keypoints(seen.names, wrong, seen.sigma_m)
    ends = polish(model, clean, [off], priors, loss)
    assert ends.is_minimum.all()
    plain = Problem(model, [KeypointTerm(model, off, loss=loss)], priors)
    np.testing.assert_allclose(ends.cost[0], plain.cost(ends.params[0]), rtol=1e-10)
    squares = polish(model, clean, [off], priors)
    moved, dragged = (np.abs(each.params - clean)[0, 3:].max() for each in (ends, squares))
    assert moved < share * dragged


def test_no_way_within_narrowing_limits_leads_down(rng):
    """Fingers forced apart and bent: abductions at limits that move with the flexion. The plain solver ends there too."""
    model, seen, priors, starts = hand_problem(rng, narrowing=True)
    spread = seen[0].positions.copy()
    apart = [model.joint_names.index(f"{finger}_tip") for finger in ("index", "little")]
    spread[apart] += [[-0.05, -0.02, 0.0], [0.05, -0.02, 0.0]]
    seen = [Keypoints(seen[0].names, spread, 0.003)]
    ends = polish(model, starts, seen, priors)
    assert ends.is_minimum.all()
    plain = Problem(model, [KeypointTerm(model, seen[0])], priors)
    best = ends.params[np.argmin(ends.cost)]
    low, high = model.bounds(best).T
    narrowed = model.limits.narrowed[:, 0]
    at_limit = np.minimum(best - low, high - best)[narrowed] < 1e-9
    bends = best[model.limits.narrowed[:, 1]]
    assert (
        at_limit & (bends > 0.0) & (bends < model.limits.narrow_at)
    ).any()  # else it tests nothing
    for step in 1e-4 * rng.normal(size=(300, len(best))):
        moved = model.clipped(model.clipped(best + step))
        assert plain.cost(moved) > ends.cost.min() - 1e-9
    known = [solve(plain, start, FAR).cost for start in starts]
    np.testing.assert_allclose(ends.cost, known, rtol=1e-6)


def test_the_flips_of_an_arm_are_its_minima(rng):
    """All leaves of an arm's tree are minima of their own, each with its joints where they are seen."""
    model = load_model("body34")
    held = {
        "shoulder_abd": 65.0,
        "shoulder_flex": 6.0,
        "shoulder_twist": -97.0,
        "elbow_flex": 26.0,
    }
    truth = model.params_from({f"left_{name}": np.deg2rad(value) for name, value in held.items()})
    camera = front_camera(4.0, 1100.0)
    names = [n for n in model.joint_names if "toe" not in n and "hand" not in n and n != "nose"]
    points = model.joint_positions(model.bones(truth))[[model.joint_names.index(n) for n in names]]
    seen = [ImageKeypoints(camera, tuple(names), camera.project(points), 1.0)]
    priors = body_priors(model).joints
    arm = [chain for chain in chains_of(model) if chain.name == "left_arm"]
    leaves = interpretation_tree(model, truth, arm, camera).params
    assert len(leaves) == 3  # the fourth is beyond a limit
    ends = polish(model, leaves, seen, priors)
    assert ends.is_minimum.all()
    for n, params in enumerate(ends.params):
        others = np.delete(ends.params, n, axis=0)
        assert np.linalg.norm(others - params, axis=1).min() > 1.0
        found = model.joint_positions(model.bones(params))
        off = camera.project(found[[model.joint_names.index(n) for n in names]]) - seen[0].pixels
        assert np.abs(off).max() < 1.0


def test_what_is_no_minimum_is_not_called_one(rng):
    model, seen, priors, starts = hand_problem(rng, where="image")
    few = polish(model, starts, seen, priors, settings=PolishSettings(iterations=1))
    assert not few.is_minimum.any()
    assert (few.iterations == 1).all()
    behind = starts.copy()
    behind[:, 2] += 5.0  # beyond the camera
    lost = polish(model, behind, seen, priors)
    assert np.isinf(lost.cost).all() and not lost.is_minimum.any()


@pytest.mark.parametrize("factor, stable", [(1.1, True), (0.9, False)])
def test_a_crest_between_two_flips_is_no_minimum(factor, stable):
    """A straight finger in the image plane. Seen too long, it stays; seen too short, it wants out, to either side."""
    model, camera = load_model("hand26"), front_camera()
    flat = model.params_from({})
    names = ("index_mcp", "index_pip", "index_dip", "index_tip")
    points = model.joint_positions(model.bones(flat))[[model.joint_names.index(n) for n in names]]
    pixels = camera.project(points)
    seen = [ImageKeypoints(camera, names, pixels[0] + factor * (pixels - pixels[0]), 1.0)]
    held = GaussianPrior(np.zeros(26), np.r_[np.full(6, 1e-4), np.full(20, 3.0)])
    start = polish(model, flat[None], seen, [held], settings=PolishSettings(iterations=0))
    assert start.is_stable[0] == stable
