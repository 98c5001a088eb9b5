"""The compiled key-point problem: the same cost, gradient and Hessian as its terms, and exact second derivatives."""

import numpy as np
import pytest

from handtrack.geometry.camera import Camera
from handtrack.geometry.rotation import left_jacobian, rotation_matrix
from handtrack.model.model_file import load_model
from handtrack.model.root_turn_kernels import turn_root
from handtrack.observation.observation import ImageKeypoints, Keypoints
from handtrack.sampling.keypoint_kernels import keypoint_cost, workspace
from handtrack.sampling.keypoint_problem import keypoint_problem
from handtrack.sampling.keypoint_system_kernels import keypoint_system
from handtrack.solver.problem import Problem
from handtrack.terms.collision import CollisionTerm
from handtrack.terms.keypoints import KeypointTerm
from handtrack.terms.loss import geman_mcclure, huber, quadratic
from handtrack.terms.priors.priors import GaussianPrior, LinearPrior
from tests.derivatives import check_gradient, check_jacobian


def cameras():
    turn = rotation_matrix(np.array([0.1, 0.9, -0.1]))
    first = np.array([[500.0, 0, 310], [0, 510, 250], [0, 0, 1]])
    second = np.array([[900.0, 0, 620], [0, 880, 350], [0, 0, 1]])
    return (
        Camera("first", (640, 480), first, np.zeros(5), np.eye(3), np.array([0.1, 0.0, 3.0])),
        Camera("second", (1280, 720), second, np.zeros(5), turn, np.array([0.0, 0.1, 4.0])),
    )


def problem_of(rng, model, loss, collision=None, spread=0.3):
    """Return terms of two cameras and space with noise and unknown joints, and parameters near by."""
    size = len(model.rest_params())
    truth = model.clipped(model.rest_params() + spread * rng.normal(size=size))
    points = model.joint_positions(model.bones(truth))
    seen = []
    for number, camera in enumerate(cameras()):
        pixels = camera.project(points) + 3.0 * rng.normal(size=(len(points), 2))
        pixels[number :: 4 + number] = np.nan
        seen.append(ImageKeypoints(camera, model.joint_names, pixels, 1.5 + number))
    where = points + 0.01 * rng.normal(size=points.shape)
    seen.append(Keypoints(model.joint_names[2:7], where[2:7], 0.01))
    sigma = np.full(len(model.rest), 0.6)
    sigma[:6] = np.inf
    priors = (GaussianPrior(model.rest, sigma), LinearPrior(rng.normal(size=(3, len(model.rest)))))
    terms = [KeypointTerm(model, each, loss=loss) for each in seen]
    plain = Problem(model, terms if collision is None else [*terms, collision], priors)
    packed = keypoint_problem(model, seen, priors, loss, collision)
    return plain, packed, truth + 0.03 * rng.normal(size=size)


def system(packed, params):
    size = len(params)
    gradient, normal, curvature = np.empty(size), np.empty((size, size)), np.empty((size, size))
    cost = keypoint_system(packed, params, workspace(packed), gradient, normal, curvature)
    return cost, gradient, normal, normal + curvature


KINDS = [
    ("hand26", "26", quadratic()),
    ("hand26", "18", geman_mcclure(3.0)),
    ("body34", "26", huber(2.0)),
]


@pytest.mark.parametrize(("name", "coupling", "loss"), KINDS)
def test_is_what_the_terms_say(rng, name, coupling, loss):
    plain, packed, params = problem_of(rng, load_model(name, coupling=coupling), loss)
    cost, gradient, normal, _ = system(packed, params)
    known = plain.linearize(params)
    np.testing.assert_allclose(cost, known.cost, rtol=1e-11)
    np.testing.assert_allclose(
        keypoint_cost(packed, params, workspace(packed)), known.cost, rtol=1e-11
    )
    np.testing.assert_allclose(gradient, known.gradient, atol=1e-10 * np.abs(known.gradient).max())
    np.testing.assert_allclose(normal, known.hessian, atol=1e-10 * np.abs(known.hessian).max())


@pytest.mark.parametrize(("name", "coupling", "loss"), KINDS)
def test_derivatives(rng, name, coupling, loss):
    """The gradient by differences of the cost, the exact Hessian by differences of the gradient."""
    model = load_model(name, coupling=coupling)
    _, packed, params = problem_of(rng, model, loss)
    _, gradient, normal, hessian = system(packed, params)
    names, space = model.transform.names, workspace(packed)
    check_gradient(lambda x: keypoint_cost(packed, x, space), gradient, params, names, rtol=1e-5)
    check_jacobian(lambda x: system(packed, x)[1], hessian, params, names, names, rtol=1e-6)
    assert np.abs(hessian - normal).max() > 1e-3 * np.abs(normal).max()  # the test sees the rest


def test_collisions_are_added(rng):
    """At a pose with an arm through the trunk, and afterwards at one without: nothing of it may stay."""
    model = load_model("body34")
    collision = CollisionTerm.of(model)
    plain, packed, _ = problem_of(rng, model, quadratic(), collision)
    params = model.rest_params()
    through = params.copy()
    through[model.transform.names.index("left_shoulder_abd")] = -0.7
    assert collision.cost(model.bones(through)) > 0.0 == collision.cost(model.bones(params))
    size, space = len(params), workspace(packed)
    gradient, normal, rest = np.empty(size), np.empty((size, size)), np.empty((size, size))
    for where in (through, params, through):
        cost = keypoint_system(packed, where, space, gradient, normal, rest)
        known = plain.linearize(where)
        np.testing.assert_allclose(cost, known.cost, rtol=1e-11)
        np.testing.assert_allclose(keypoint_cost(packed, where, space), known.cost, rtol=1e-11)
        np.testing.assert_allclose(normal, known.hessian, atol=1e-10 * np.abs(known.hessian).max())
        check_gradient(plain.cost, gradient, where, model.transform.names, rtol=1e-5)


@pytest.mark.parametrize("angle", [0.0, 1e-5, 0.03, 0.0499999, 0.0500001, 0.4, 3.0, 5.0])
def test_turn_of_the_root(rng, angle):
    axis = rng.normal(size=3)
    r = angle * axis / np.linalg.norm(axis)
    rotation, jacobian, slope = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3, 3))
    turn_root(r, rotation, jacobian, slope)
    np.testing.assert_allclose(rotation, rotation_matrix(r), atol=1e-12)
    np.testing.assert_allclose(jacobian, left_jacobian(r), atol=1e-12)
    by_differences = slope.reshape(3, 9).T
    # steps of 1e-4: the plain form changes to its series below that angle
    check_jacobian(
        lambda x: left_jacobian(x).ravel(), by_differences, r, step=1e-4, rtol=1e-6, atol=1e-8
    )
