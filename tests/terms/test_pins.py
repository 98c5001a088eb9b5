"""Pins: places of bones on lines of sight, and what becomes of a place that a model lacks."""

import numpy as np
import pytest

from handtrack.model.model_file import load_model
from handtrack.observation.pins import PIN_SIGMA_PX, ImagePins, Pin
from handtrack.simulation.simulate import simulated_rig
from handtrack.terms.keypoints import KeypointTerm
from tests.derivatives import check_observation_term

HAND = load_model()
CAMERA = simulated_rig(1).cameras[0].without_distortion()
ON_BONE = (0.004, 0.02, 0.003)


def _seen(bones, shift=(0.0, 0.0)):
    """Return a joint and a point of a bone, pinned where they lie, or beside that."""
    model = HAND
    bone = model.skeleton.bone_names.index("index_proximal")
    tip = model.joint_positions(bones)[model.joint_names.index("ring_tip")]
    points = np.stack([tip, bones.to_world(np.array([bone]), np.array([ON_BONE]))[0]])
    at = CAMERA.project(points) + shift
    first, second = (tuple(map(float, pixel)) for pixel in at)
    pins = Pin("cam0", first, joint="ring_tip"), Pin("cam0", second, "", "index_proximal", ON_BONE)
    return ImagePins(CAMERA, pins)


def test_pins_that_are_met_cost_nothing_and_a_sigma_beside_a_half_each():
    bones = HAND.bones(HAND.rest_params())
    assert KeypointTerm(HAND, _seen(bones)).cost(bones) == pytest.approx(0.0, abs=1e-18)
    beside = KeypointTerm(HAND, _seen(bones, (0.0, PIN_SIGMA_PX)))
    assert beside.cost(bones) == pytest.approx(1.0)


def test_derivatives_of_pins_at_rest_and_elsewhere(rng):
    for params in (0.0 * HAND.rest_params(), HAND.clipped(rng.normal(scale=0.4, size=26))):
        near = HAND.bones(HAND.clipped(params + rng.normal(scale=0.03, size=26)))
        term = KeypointTerm(HAND, _seen(near))
        check_observation_term(term, HAND.bones(params), HAND.skeleton.bone_names)
