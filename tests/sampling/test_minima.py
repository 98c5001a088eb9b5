"""Minima: drawn, polished by the compiled keypoint problem, and told apart."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from handtrack import ImageKeypoints, Keypoints, load_model
from handtrack.geometry.rotation import left_jacobian, rotation_matrix, rotation_vector
from handtrack.model.kinematics_kernels import turn_root
from handtrack.sampling.diffusion import covariance_scaled, projected
from handtrack.sampling.keypoint_kernels import keypoint_cost, keypoint_system
from handtrack.sampling.keypoint_problem import keypoint_problem
from handtrack.sampling.polish import polish
from handtrack.sampling.suppression import angle_distance, distinct
from handtrack.solver.levenberg_marquardt import SolverSettings, solve
from handtrack.solver.problem import Problem
from handtrack.terms.keypoints import KeypointTerm
from handtrack.terms.loss import geman_mcclure, huber, quadratic, uniform_outliers
from handtrack.terms.priors import GaussianPrior, LinearPrior
from tests.cameras import FACING, pinhole
from tests.derivatives import check_jacobian

FAR = SolverSettings(iterations=300, damping=1e-3, cost_tolerance=1e-15, step_tolerance=1e-11)


FRONT = pinhole("front", (640, 480), 600, FACING, (0, 0.1, 0.9), at=(320, 240))


def rest_prior(model, sigma=0.8):
    widths = np.full(len(model.rest), sigma)
    widths[:6] = np.inf
    return GaussianPrior(model.rest, widths)


def somewhere(rng, model):
    """Return how many parameters a model has, some of them, and its joints there."""
    size = len(model.rest_params())
    truth = model.clipped(model.rest_params() + 0.3 * rng.normal(size=size))
    points = model.joint_positions(model.bones(truth))
    return size, truth, points


def hand_problem(rng, coupling="26", narrowing=False):
    """Return a model, what is seen of it in space and in an image, priors and starts near by."""
    model = load_model("hand26", coupling=coupling, narrowing=narrowing)
    size, truth, points = somewhere(rng, model)
    places = points + 0.003 * rng.normal(size=points.shape)
    pixels = FRONT.project(points) + rng.normal(size=(len(points), 2))
    seen = [
        Keypoints(model.joint_names, places, 0.003),
        ImageKeypoints(FRONT, model.joint_names, pixels, 1.0),
    ]
    starts = truth + 0.05 * rng.normal(size=(6, size)) * np.r_[np.full(3, 0.1), np.ones(size - 3)]
    return model, seen, [rest_prior(model)], starts


@pytest.mark.parametrize("coupling", ["26", "21", "18"])
def test_ends_where_the_plain_solver_ends(rng, coupling):
    model, seen, priors, starts = hand_problem(rng, coupling)
    ends = polish(model, starts, seen, priors)
    assert ends.is_minimum.all()
    plain = Problem(model, [KeypointTerm(model, each) for each in seen], priors)
    for start, params, cost, normal in zip(
        starts, ends.params, ends.cost, ends.normal, strict=True
    ):
        known = solve(plain, start, FAR)
        assert_allclose(cost, known.cost, rtol=1e-6)
        assert_allclose(params, known.params, atol=1e-3)
        assert_allclose(cost, plain.cost(params), rtol=1e-10)
        known_normal = plain.linearize(params).hessian
        assert_allclose(normal, known_normal, atol=1e-8 * np.abs(known_normal).max())


def test_it_ends_at_limits_that_narrow_where_the_plain_solver_does(rng):
    """Fingers forced apart and bent: abductions at limits that move with the flexion."""
    model, seen, priors, starts = hand_problem(rng, narrowing=True)
    spread = seen[0].positions.copy()
    apart = [model.joint_names.index(f"{finger}_tip") for finger in ("index", "little")]
    spread[apart] += [[-0.05, -0.02, 0.0], [0.05, -0.02, 0.0]]
    seen = [Keypoints(seen[0].names, spread, 0.003)]
    ends = polish(model, starts, seen, priors)
    assert ends.is_minimum.all()
    plain = Problem(model, [KeypointTerm(model, seen[0])], priors)
    best = ends.params[np.argmin(ends.cost)]
    room = np.abs(model.bounds(best) - best[:, None]).min(axis=1)
    narrowed, by = model.limits.narrowed.T
    moving = (best[by] > 0.0) & (best[by] < model.limits.narrow_at)
    assert (moving & (room[narrowed] < 1e-9)).any()  # else it tests nothing
    assert_allclose(ends.cost, [solve(plain, start, FAR).cost for start in starts], rtol=1e-6)


def test_what_is_no_minimum_is_not_called_one(rng):
    model, seen, priors, starts = hand_problem(rng)
    few = polish(model, starts, seen, priors, iterations=1)
    assert not few.is_minimum.any()
    behind = starts.copy()
    behind[:, 2] += 5.0  # beyond the camera
    lost = polish(model, behind, seen, priors)
    assert np.isinf(lost.cost).all() and not lost.is_minimum.any()


@pytest.mark.parametrize("factor, stable", [(1.1, True), (0.9, False)])
def test_a_crest_between_two_flips_is_no_minimum(factor, stable):
    """A straight finger in the image plane. Seen too long, it stays; seen too short, it wants out, to either side."""
    model = load_model("hand26")
    flat = model.params_from({})
    names = ("index_mcp", "index_pip", "index_dip", "index_tip")
    points = model.joint_positions(model.bones(flat))[[model.joint_names.index(n) for n in names]]
    pixels = FRONT.project(points)
    seen = [ImageKeypoints(FRONT, names, pixels[0] + factor * (pixels - pixels[0]), 1.0)]
    held = GaussianPrior(np.zeros(26), np.r_[np.full(6, 1e-4), np.full(20, 3.0)])
    start = polish(model, flat[None], seen, [held], iterations=0)
    assert start.is_stable[0] == stable


CAMERAS = (
    pinhole("first", (640, 480), (500, 510), translation=(0.1, 0, 3), at=(310, 250)),
    pinhole("second", (1280, 720), (900, 880), rotation_matrix(np.array([0.1, 0.9, -0.1])), (0, 0.1, 4), at=(620, 350)),
)  # fmt: skip


def problem_of(rng, model, loss):
    """Return terms of two cameras and space with noise and unknown joints, and parameters near by."""
    size, truth, points = somewhere(rng, model)
    seen = []
    for number, camera in enumerate(CAMERAS):
        pixels = camera.project(points) + 3.0 * rng.normal(size=(len(points), 2))
        pixels[number :: 4 + number] = np.nan
        seen.append(ImageKeypoints(camera, model.joint_names, pixels, 1.5 + number))
    where = points + 0.01 * rng.normal(size=points.shape)
    seen.append(Keypoints(model.joint_names[2:7], where[2:7], 0.01))
    priors = (rest_prior(model, 0.6), LinearPrior(rng.normal(size=(3, len(model.rest)))))
    terms = [KeypointTerm(model, each, loss=loss) for each in seen]
    packed = keypoint_problem(model, seen, priors, loss)
    return Problem(model, terms, priors), packed, truth + 0.03 * rng.normal(size=size)


def system(packed, params):
    cost, gradient, normal, curvature = keypoint_system(packed, params)
    return cost, gradient, normal, normal + curvature


@pytest.mark.parametrize(
    ("name", "coupling", "loss"),
    [
        ("hand26", "26", quadratic()),
        ("hand26", "18", geman_mcclure(3.0)),
        ("hand26", "18", uniform_outliers()),
        ("body34", "26", huber(2.0)),
    ],
)
def test_is_what_the_terms_say_and_its_exact_hessian_the_gradients_slope(rng, name, coupling, loss):
    model = load_model(name, coupling=coupling)
    plain, packed, params = problem_of(rng, model, loss)
    cost, gradient, normal, hessian = system(packed, params)
    known, names = plain.linearize(params), model.transform.names
    assert_allclose(cost, known.cost, rtol=1e-11)
    assert_allclose(keypoint_cost(packed, params), known.cost, rtol=1e-11)
    assert_allclose(gradient, known.gradient, atol=1e-10 * np.abs(known.gradient).max())
    assert_allclose(normal, known.hessian, atol=1e-10 * np.abs(known.hessian).max())
    check_jacobian(lambda x: system(packed, x)[1], hessian, params, names, names, rtol=1e-6)
    assert np.abs(hessian - normal).max() > 1e-3 * np.abs(normal).max()  # the test sees the rest


@pytest.mark.parametrize("angle", [0.0, 1e-5, 0.03, 0.0499999, 0.0500001, 0.4, 3.0, 5.0])
def test_turn_of_the_root(rng, angle):
    axis = rng.normal(size=3)
    r = angle * axis / np.linalg.norm(axis)
    rotation, jacobian, slope = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3, 3))
    turn_root(r, rotation, jacobian, slope)
    assert_allclose(rotation, rotation_matrix(r), atol=1e-12)
    assert_allclose(jacobian, left_jacobian(r), atol=1e-12)
    by_differences = slope.reshape(3, 9).T
    # steps of 1e-4: the plain form changes to its series below that angle
    check_jacobian(
        lambda x: left_jacobian(x).ravel(), by_differences, r, step=1e-4, rtol=1e-6, atol=1e-8
    )


def test_the_distance_is_the_root_mean_square_of_angles(rng):
    """Metres do not count; rotation vectors 2π apart are the same, and a turn counts by its angle, wherever it starts from."""
    start = np.r_[np.zeros(3), rng.normal(size=3), np.zeros(4)]
    again, turned, bent = start.copy(), start.copy(), start + np.r_[np.full(3, 5.0), np.zeros(7)]
    again[3:6] *= 1 - 2 * np.pi / np.linalg.norm(start[3:6])
    turn = rotation_matrix(np.array([0.0, 0.02, 0.0]))
    turned[3:6] = rotation_vector(turn @ rotation_matrix(start[3:6]))
    bent[6:] += [0.3, -0.4, 0.0, 0.0]
    found = angle_distance(start, np.stack([again, turned, bent]))
    assert_allclose(found, np.array([0.0, 0.02, 0.5]) / np.sqrt(7), atol=1e-9)


@pytest.mark.parametrize("threshold", [0.05, 0.1, 0.3])
def test_distinct_ones_are_apart_and_stand_for_all(rng, threshold):
    params, costs = rng.normal(scale=0.2, size=(80, 12)), rng.normal(size=80)
    kept = distinct(params, costs, threshold)
    for k in kept:
        others = params[kept[kept != k]]
        assert (angle_distance(params[k], others) > threshold).all()
    for n in set(range(80)) - set(kept.tolist()):
        near = kept[angle_distance(params[n], params[kept]) <= threshold]
        assert len(near) and costs[near].min() <= costs[n]


@pytest.mark.parametrize("scale", [1.0, 4.0])
def test_gaussian_samples_have_the_covariance(rng, scale):
    """With standard deviations from 0.01 to 1 along skew axes."""
    axes, _ = np.linalg.qr(rng.normal(size=(5, 5)))
    spread = axes @ np.diag(np.array([0.01, 0.03, 0.1, 0.3, 1.0]) ** 2) @ axes.T
    mean = rng.normal(size=5)
    drawn = covariance_scaled(mean, spread, scale, 40_000, rng.standard_normal)
    assert_allclose(drawn.mean(axis=0), mean, atol=0.03 * scale)
    # in units of the wanted one, so that the narrow directions count as much as the wide
    root = np.linalg.inv(np.linalg.cholesky(spread))
    assert_allclose(root @ np.cov(drawn.T) @ root.T, scale**2 * np.eye(5), atol=0.05 * scale**2)


@pytest.mark.parametrize("coupling", ["26", "18"])
def test_projection_onto_limits_that_narrow(rng, coupling):
    model = load_model("hand26", coupling=coupling)
    size = len(model.rest_params())
    drawn = model.rest_params() + 2.0 * rng.normal(size=(200, size))
    inside = projected(model, drawn)
    for row in inside:
        bounds = model.bounds(row)
        assert (row >= bounds[:, 0] - 1e-12).all() and (row <= bounds[:, 1] + 1e-12).all()
        assert_array_equal(model.clipped(row), row)
    assert (inside != drawn).any(axis=1).all()
    free = model.bounds(model.rest_params())[:, 1] == np.inf
    assert_array_equal(inside[:, free], drawn[:, free])
    assert_array_equal(projected(model, inside), inside)
    assert projected(model, drawn[:0]).shape == (0, size)
