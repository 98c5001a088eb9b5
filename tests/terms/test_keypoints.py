"""Keypoints and pins: known costs by hand, unknown points, robust loss, derivatives."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from handtrack import ImageKeypoints, Keypoints, load_model
from handtrack.observation.pins import PIN_SIGMA_PX, ImagePins, Pin
from handtrack.simulation.simulate import simulated_rig
from handtrack.terms.keypoints import JointPositionTerm, KeypointTerm
from handtrack.terms.loss import huber
from handtrack.terms.term import Sums
from tests.derivatives import check_observation_term

SIGMA_M, SIGMA_PX = 0.004, 2.0


HAND = load_model()
BONES = HAND.bones(HAND.rest_params())


def in_space(bones, shift=(0.0, 0.0, 0.0)):
    return Keypoints(HAND.joint_names, HAND.joint_positions(bones) + shift, SIGMA_M)


def in_image(bones, shift=(0.0, 0.0)):
    camera = simulated_rig(1).cameras[0]
    pixels = camera.project(HAND.joint_positions(bones)) + shift
    return ImageKeypoints(camera, HAND.joint_names, pixels, SIGMA_PX)


def test_points_one_sigma_off_cost_a_half_each():
    count = len(HAND.joint_names)
    assert KeypointTerm(HAND, in_space(BONES)).cost(BONES) == 0.0
    term = KeypointTerm(HAND, in_space(BONES, (0.0, SIGMA_M, 0.0)))
    assert term.cost(BONES) == pytest.approx(0.5 * count)
    gradient = term.linearize(BONES).gradient.reshape(-1, 6).sum(axis=0)
    assert_allclose(gradient[:3], [0, -count / SIGMA_M, 0], atol=1e-6)
    term = KeypointTerm(HAND, in_image(BONES, (SIGMA_PX, 0.0)), weight=3.0)
    assert term.cost(BONES) == pytest.approx(1.5 * count)


@pytest.mark.parametrize("view", [in_space, in_image])
def test_unknown_points_do_not_pull(view):
    observed = view(BONES)
    points = observed.positions if view is in_space else observed.pixels
    points[[2, 7]] = np.nan
    points[9, 0] = np.nan  # half known is unknown
    points[5] += 1.0
    term = KeypointTerm(HAND, observed)
    pull = np.abs(term.linearize(BONES).gradient.reshape(-1, 6)).max(axis=1)
    moved = set(np.flatnonzero(pull > 1e-9 * pull.max()))
    assert np.isfinite(term.cost(BONES))
    assert moved == {HAND.joint_bone[5]}


@pytest.mark.parametrize("view", [in_space, in_image])
def test_the_compiled_sums_are_those_of_the_plain_residuals(rng, view):
    """By twists and by fields; the weights of a robust loss are those at the place."""
    seen, loss = view(HAND.bones(HAND.clipped(rng.normal(scale=0.3, size=26)))), huber(2.0)

    def misses(at):
        if view is in_space:
            return (at - seen.positions) / SIGMA_M
        return (seen.camera.project(at) - seen.pixels) / SIGMA_PX

    square = (misses(HAND.joint_positions(BONES)) ** 2).sum(axis=1)
    root = np.sqrt(0.7 * loss.weight(square))[:, None]
    plain = JointPositionTerm(HAND, HAND.joint_names, lambda at: root * misses(at))
    term, cost = KeypointTerm(HAND, seen, 0.7, loss), 0.35 * loss.value(square).sum()
    for width in (6, 12):
        ours, theirs = (Sums.zero(len(BONES.position), width) for _ in range(2))
        plain.add_to(BONES, theirs)
        assert term.add_to(BONES, ours) == pytest.approx(cost)
        for own, other in zip(ours[1:], theirs[1:]):
            assert_allclose(own, other, atol=1e-8 * np.abs(other).max())


def test_points_in_a_distorted_image_are_undistorted():
    camera = replace(simulated_rig(1).cameras[0], distortions=[-0.1, 0.02, 0, 0])
    seen = ImageKeypoints(camera, ("wrist",), [[100, 80]], SIGMA_PX)
    assert not seen.camera.is_distorted
    assert_allclose(camera.distort_points(seen.pixels), [[100, 80]], atol=1e-6)


def test_pins_that_are_met_cost_nothing_and_a_sigma_beside_a_half_each():
    """A joint and a point of a bone, pinned where they lie, or beside that."""
    camera, on_bone = simulated_rig(1).cameras[0].without_distortion(), (0.004, 0.02, 0.003)
    tip = HAND.joint_positions(BONES)[HAND.joint_names.index("ring_tip")]
    other = BONES.to_world(HAND.skeleton.bone("index_proximal"), np.array(on_bone))
    for beside_px, cost in ((0.0, 0.0), (PIN_SIGMA_PX, 1.0)):
        first, second = camera.project(np.stack([tip, other])) + [0.0, beside_px]
        pins = Pin("cam0", first, "ring_tip"), Pin("cam0", second, "", "index_proximal", on_bone)
        term = KeypointTerm(HAND, ImagePins(camera, pins))
        assert term.cost(BONES) == pytest.approx(cost, rel=1e-6, abs=1e-18)
    check_observation_term(term, BONES, HAND.skeleton.bone_names)
