"""Lines of sight of a cloud: against the plain form, their derivatives, and what they believe of a point."""

import numpy as np
import pytest

from handtrack.model.model_file import load_model
from handtrack.model.surfaces.metaballs import MetaballSurface
from handtrack.model.surfaces.surface_mesh import sample_surface
from handtrack.terms.clouds.cloud_rays import CloudRaysTerm
from tests.derivatives import check_observation_term
from tests.terms.cloud_rays_reference import ray_costs

CENTRE = np.array([0.02, 0.05, 0.6])


@pytest.fixture(scope="module")
def model():
    return load_model()


@pytest.fixture
def bones(model):
    return model.bones(model.rest_params())


@pytest.fixture
def term(rng, model, bones):
    """Points on the hand, each off along its ray; a third of them beside it as well."""
    surface = MetaballSurface.of(model)
    points = sample_surface(surface, bones, 300, rng)[0]
    points = CENTRE + (points - CENTRE) * rng.uniform(0.93, 1.07, size=(300, 1))
    points[::3] += rng.normal(scale=0.008, size=points[::3].shape)
    return CloudRaysTerm(points, CENTRE, surface, along_m=0.02, weight=0.7)


def test_as_in_the_plain_form(term, bones):
    costs = ray_costs(term, bones)
    assert term.cost(bones) == pytest.approx(0.7 * costs.sum(), rel=1e-10)


def test_derivatives(term, model):
    moved = model.bones(model.rest_params() + 0.03)
    check_observation_term(term, moved, model.skeleton.bone_names, step=1e-8, rtol=1e-4)


def one(model, point, **kw):
    return CloudRaysTerm(np.array([point]), CENTRE, MetaballSurface.of(model), **kw)


def test_a_wrong_depth_costs_the_same_wherever_and_pulls_nothing(model, bones):
    """Even where the hand's far side is: no camera sees that."""
    palm = bones.position[model.skeleton.bone("middle_proximal")]
    sight = palm - CENTRE
    costs = [one(model, CENTRE + share * sight).cost(bones) for share in (0.85, 0.93, 1.03, 1.2)]
    np.testing.assert_allclose(costs, costs[0], rtol=1e-3)
    pull = one(model, CENTRE + 0.85 * sight).linearize(bones).gradient
    assert np.abs(pull).max() < 1e-6


def test_a_ray_that_passes_by_pulls_the_hand_across_and_not_along(model, bones):
    tip = model.joint_positions(bones)[model.joint_names.index("middle_tip")]
    beside = tip + np.array([0.0, 0.02, 0.0])
    near, far = (one(model, CENTRE + share * (beside - CENTRE)) for share in (0.9, 1.1))
    assert near.cost(bones) == pytest.approx(far.cost(bones), rel=1e-12)
    pull = near.linearize(bones).gradient.reshape(-1, 6)[:, :3].sum(axis=0)
    ray = (beside - CENTRE) / np.linalg.norm(beside - CENTRE)
    assert np.linalg.norm(pull) > 1.0
    assert abs(pull @ ray) < 0.2 * np.linalg.norm(pull)
