"""A detector's points lie beside our joints: constant offsets, found together with the size."""

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
OFFSETS = {
    "thumb_cmc": (6.0, 9.0, -4.0),
    "index_mcp": (-2.0, -9.0, 6.0),
    "ring_pip": (0.0, 5.0, 0.0),
}
CAMERAS = [camera.without_distortion() for camera in simulated_rig(3, (640, 480)).cameras]


def frames(rng, side="right", count=6, noise_px=0.5, lasts=False, offsets=OFFSETS):
    """Problems of the mean hand around what a detector with offsets sees of a larger one; the poses they are from."""
    filmed = load_model("hand26", side, HandScale(1.06, {}, {}, offsets))
    noise = rng.normal(scale=noise_px, size=(count, len(CAMERAS), len(NAMES), 2))
    noise = np.broadcast_to(noise[0], noise.shape) if lasts else noise
    model, sigma = load_model("hand26", side), np.full(26, 0.7)
    sigma[:6] = np.inf
    problems, poses = [], []
    for errors in noise:
        joint = filmed.rest + rng.normal(scale=0.4, size=26)
        joint[:3] = rng.normal(scale=0.02, size=3)
        pose = filmed.clipped(filmed.transform.solver_params(joint))
        points = filmed.bones(pose).to_world(filmed.joint_bone, filmed.observed_point)
        rows = [filmed.joint_names.index(name) for name in NAMES]
        terms = [
            KeypointTerm(model, ImageKeypoints(c, NAMES, pixels + error, max(noise_px, 1.0)))
            for c, error in zip(CAMERAS, errors, strict=True)
            for pixels in [c.project(points[rows])]
        ]  # fmt: skip
        problems.append(Problem(model, terms, [GaussianPrior(model.rest, sigma)]))
        poses.append(pose)
    return problems, poses


@pytest.mark.parametrize("lasts", [False, True], ids=["new in each frame", "the same in all"])
def test_the_stated_doubt_of_a_length_is_the_true_one(lasts):
    """With errors of its sigma, new in each of six frames, and with one error in all of them, which counts once."""
    off, repeated = [], 6.0 if lasts else 1.0
    for seed in range(6):
        rng = np.random.default_rng(seed)
        problems, poses = frames(rng, noise_px=4.0, lasts=lasts, offsets={})
        scale, _ = fit_size(problems, poses, repeated=repeated)
        true = hand_length_mm(load_model(scale=HandScale(1.06)))
        off.append((hand_length_mm(load_model(scale=scale)) - true) / scale.std["length_mm"])
    assert 0.5 < np.sqrt(np.mean(np.square(off))) < 1.5
