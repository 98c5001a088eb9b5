"""Silhouettes by a person's shape: derivatives by pose, size and proportions."""

import numpy as np
import pytest

from handtrack.model.articulated import HandScale
from handtrack.model.kinematics import BoneFields
from handtrack.model.model_file import load_model
from handtrack.model.size import SizeParameters
from handtrack.observation.observation import Silhouette
from handtrack.simulation.render import render_mask
from handtrack.simulation.simulate import simulated_rig
from handtrack.terms.silhouettes.coverage import CoverageTerm
from tests.derivatives import check_gradient


@pytest.mark.parametrize("side", ["right", "left"])
def test_coverage_by_pose_shape_and_outline(rng, side):
    """Pixels change hands between ellipsoids: steps are short, as for twists."""
    size = SizeParameters(load_model("hand26", side, HandScale(1.04, {}, {"thenar": 0.5})))
    pose = size.model.rest_params()
    cameras = simulated_rig(3, size=(160, 120)).cameras
    bones = size.model.bones(pose)
    masks = [render_mask(camera, size.model.flesh["fine"].posed(bones)) for camera in cameras]
    seen = [Silhouette(camera, mask) for camera, mask in zip(cameras, masks, strict=True)]
    term = CoverageTerm(seen, size.model.flesh["fine"], 4.0, bones, True)
    deviations = size.deviations(size.model.scale) + rng.normal(scale=0.7, size=len(size.names))
    moved = pose + rng.normal(scale=0.01, size=len(pose))

    wider = 0.0015

    def cost(both):
        model = size.rescaled(both[len(pose) : -1])
        return term.wider(both[-1]).cost(model.bones(both[: len(pose)]))

    model = size.rescaled(deviations)
    placed, twists, _ = model.linearize(moved)
    fields = BoneFields.of_twists(twists @ model.transform.matrix, len(model.joint_names))
    fields = fields.beside(size.fields(placed)).with_outline()
    term = term.wider(wider)
    system = term.linearize(placed, fields)
    both = np.concatenate([moved, deviations, [wider]])
    assert system.cost == pytest.approx(cost(both), rel=1e-10)
    names = (*model.transform.names, *size.names, "outline")
    check_gradient(cost, system.gradient, both, names, step=1e-8, rtol=2e-3)
    moves = (twists @ model.transform.matrix).reshape(-1, len(pose))
    by_pose = term.linearize(placed).pull_back(moves)
    count, largest = len(pose), np.abs(by_pose.hessian).max()
    np.testing.assert_allclose(system.hessian[:count, :count], by_pose.hessian, atol=1e-9 * largest)
    np.testing.assert_allclose(system.gradient[:count], by_pose.gradient, rtol=1e-7)
