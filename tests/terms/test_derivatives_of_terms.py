"""Every term, every bone, every direction: gradient against finite differences of the cost."""

import numpy as np
import pytest

from handtrack import ImageKeypoints, Keypoints, load_model
from handtrack.terms.collision import CollisionTerm, colliding_pairs
from handtrack.terms.keypoints import KeypointTerm
from handtrack.terms.loss import geman_mcclure, quadratic
from handtrack.terms.priors import CorrelatedPrior, GaussianPrior, LinearPrior
from handtrack.terms.silhouettes import ConicFieldTerm, CoverageTerm
from tests.cameras import pinhole
from tests.derivatives import KINKED, check_observation_term, check_parameter_term
from tests.terms.silhouette_scene import bones_of, ellipsoids_of, silhouettes_of

LOSSES = [quadratic(), geman_mcclure(3.0)]


HAND = load_model(coupling="18")
CAMERA = pinhole("cam0", (640, 480), (500, 510), translation=(0.1, 0.0, 0.9), at=(310, 250))


def seen_by(rng, params, view):
    """Return keypoints 5 mm or 3 pixels off, one of them unknown."""
    points = HAND.joint_positions(HAND.bones(params))
    if view == "space":
        points = points + rng.normal(scale=0.005, size=points.shape)
        points[4] = np.nan
        return Keypoints(HAND.joint_names, points, 0.004)
    pixels = CAMERA.project(points) + rng.normal(scale=3.0, size=(len(points), 2))
    pixels[4] = np.nan
    return ImageKeypoints(CAMERA, HAND.joint_names, pixels, 2.0)


@pytest.mark.parametrize("normalised", [True, False])
def test_conic_field(rng, normalised):
    bones, flesh = bones_of(rng), ellipsoids_of(rng, 10)
    seen = silhouettes_of(rng, focal=300.0, size=(260, 220))
    term = ConicFieldTerm(seen, flesh, normalised=normalised)
    check_observation_term(term, bones, **KINKED)


@pytest.mark.parametrize("unknown", [True, False])
@pytest.mark.parametrize("antisymmetric", [True, False])
def test_coverage(rng, antisymmetric, unknown):
    bones, flesh = bones_of(rng), ellipsoids_of(rng, 10)
    seen = silhouettes_of(rng, unknown=unknown, focal=300.0, size=(260, 220))
    check_observation_term(CoverageTerm(seen, flesh, 4.0, bones, antisymmetric), bones, **KINKED)


@pytest.mark.parametrize(("view", "loss"), zip(("space", "image"), LOSSES, strict=True))
def test_keypoints(rng, view, loss):
    params = HAND.rest_params() + rng.normal(scale=0.2, size=len(HAND.rest_params()))
    params = HAND.clipped(params)
    term = KeypointTerm(HAND, seen_by(rng, params, view), 0.7, loss)
    bones = HAND.bones(HAND.clipped(params + rng.normal(scale=0.02, size=len(params))))
    check_observation_term(term, bones, HAND.skeleton.bone_names)


def test_collision(rng):
    """Arms through the chest, legs crossed; only where a pair begins to overlap has the cost a kink."""
    body = load_model("body34")
    bent = {"left_hip_abd": -20, "right_hip_abd": -10}
    for side in ("left", "right"):
        bent |= {f"{side}_shoulder_flex": 70, f"{side}_elbow_flex": 60, f"{side}_hip_flex": 110}
    joint = body.params_from({name: np.deg2rad(angle) for name, angle in bent.items()})
    joint[6:] += rng.normal(scale=0.05, size=len(joint) - 6)
    flesh = body.ellipsoids["metaballs"]
    term = CollisionTerm(flesh, colliding_pairs(body, flesh), slack_m=0.003)
    bones = body.bones(joint)
    assert (term.depths(bones) > term.slack_m).sum() >= 3
    check_observation_term(term, bones, body.skeleton.bone_names)


def test_priors(rng):
    count = len(HAND.parameter_names)
    sigma, root = rng.uniform(0.05, 0.5, count), rng.normal(size=(count, count))
    sigma[:6] = np.inf
    rows, ratios = rng.normal(size=(2, 5, count))
    for term in (
        GaussianPrior(HAND.rest, sigma),
        CorrelatedPrior(HAND.rest, root @ root.T),
        LinearPrior(rows),
        LinearPrior(rows, geman_mcclure(3.0), weight=0.4),
        LinearPrior(rows, geman_mcclure(3.0), weight=0.4, ratios=ratios),
    ):
        check_parameter_term(term, rng.normal(size=count), HAND.parameter_names)
