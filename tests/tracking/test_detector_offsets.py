"""A person's size from joints in images: as sure as it is right."""

import numpy as np
import pytest

from handtrack import HandScale, ImageKeypoints, load_model
from handtrack.model.articulated import keypoint_names
from handtrack.model.size import hand_length_mm
from handtrack.simulation.simulate import simulated_rig
from handtrack.solver.problem import Problem
from handtrack.terms.keypoints import KeypointTerm
from handtrack.terms.priors.priors import GaussianPrior
from handtrack.tracking.size.estimate import fit_size

NAMES = keypoint_names()
CAMERAS = [camera.without_distortion() for camera in simulated_rig(3, (640, 480)).cameras]
SIGMA_PX = 4.0


def problems_of(filmed, model, rng, lasts):
    """Return problems of a model around what a detector sees of six poses of a hand, and these; lasts: whether its errors are the same in all."""
    noise = rng.normal(scale=SIGMA_PX, size=(6, len(CAMERAS), len(NAMES), 2))
    prior = GaussianPrior(model.rest, np.r_[np.full(6, np.inf), np.full(20, 0.7)])
    problems, poses = [], []
    for errors in noise:
        joint = filmed.rest + rng.normal(scale=0.4, size=26)
        joint[:3] = rng.normal(scale=0.02, size=3)
        pose = filmed.clipped(filmed.transform.solver_params(joint))
        points = filmed.keypoints21(filmed.bones(pose))
        seen = [
            ImageKeypoints(c, NAMES, c.project(points) + error, SIGMA_PX)
            for c, error in zip(CAMERAS, noise[0] if lasts else errors, strict=True)
        ]
        problems.append(Problem(model, [KeypointTerm(model, each) for each in seen], [prior]))
        poses.append(pose)
    return problems, poses


@pytest.mark.parametrize("lasts", [False, True], ids=["new in each frame", "the same in all"])
def test_the_stated_doubt_of_a_length_is_the_true_one(lasts):
    """With errors of its sigma, new in each of six frames, and with one error in all of them, which counts once."""
    off, filmed, model = [], load_model(scale=HandScale(1.06)), load_model()
    for seed in range(6):
        problems, poses = problems_of(filmed, model, np.random.default_rng(seed), lasts)
        scale, _ = fit_size(problems, poses, repeated=6.0 if lasts else 1.0)
        missed = hand_length_mm(load_model(scale=scale)) - hand_length_mm(filmed)
        off.append(missed / scale.std["length_mm"])
    assert 0.5 < np.sqrt(np.mean(np.square(off))) < 1.5
