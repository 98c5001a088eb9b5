"""Size and poses of chosen frames in one estimate."""

import numpy as np
import pytest

from handtrack import HandScale, load_model
from handtrack.model.size import SizeParameters
from handtrack.model.surfaces.metaballs import MetaballSurface
from handtrack.model.surfaces.surface_mesh import surface_mesh
from handtrack.simulation.scenes.simulated_views import mask_views
from handtrack.simulation.simulate import simulated_rig
from handtrack.solver.problem import Problem
from handtrack.terms.clouds.cloud_distance import CloudDistanceTerm, prepare_cloud
from handtrack.terms.clouds.cloud_emptiness import CloudEmptinessTerm
from handtrack.terms.clouds.cloud_rays import CloudRaysTerm
from handtrack.terms.clouds.distance_map import distance_map
from handtrack.terms.collision import CollisionTerm
from handtrack.terms.loss import geman_mcclure
from handtrack.terms.silhouettes.silhouette_terms import CoverageTerm
from handtrack.tracking.size.frame_systems import linearize_sized
from handtrack.tracking.size.person import PersonChange
from tests.derivatives import check_gradient
from tests.tracking.scenes import on_surface


@pytest.mark.parametrize("side", ["right", "left"])
def test_derivatives_by_pose_and_shape(rng, side):
    """Of a hand that is scaled and whose flesh has shifted: cloud's distances, rays and places without a cloud, overlaps, outlines."""
    size = SizeParameters(load_model("hand26", side, HandScale(1.04, {}, {"thenar": 0.5})))
    hand, surface = size.model, MetaballSurface.of(size.model)
    fist = {name: 1.3 for name in hand.skeleton.parameter_names if name.endswith("_flex")}
    pose = hand.clipped(hand.params_from(fist) + rng.normal(scale=0.1, size=26))
    bones = hand.bones(pose)
    points, _ = on_surface(hand, pose, 300, rng)
    points = points + rng.normal(scale=0.003, size=points.shape)
    masks = mask_views(hand, pose, simulated_rig(3, (160, 120)).cameras).silhouettes
    mesh = surface_mesh(surface, bones, 0.008)
    vertices, _ = mesh.carried(bones)
    low, high = vertices.min(axis=0) - 0.04, vertices.max(axis=0) + 0.04
    distances = distance_map(points[::3], low, high)
    both = np.concatenate([pose, size.deviations(hand.scale)])
    both += np.r_[rng.normal(scale=0.01, size=26), rng.normal(scale=0.7, size=len(size.names))]
    person = PersonChange(size, np.ones(len(size.names), bool), both[26:])
    for term, rtol in (
        (CloudDistanceTerm(prepare_cloud(points), surface, 0.004, geman_mcclure(3.0)), 1e-4),
        (CloudRaysTerm(points, pose[:3] + [0.05, -0.1, 0.6], surface, along_m=0.02), 1e-4),
        (CloudEmptinessTerm(distances, mesh.bone, mesh.local), 1e-4),
        (CollisionTerm.of(hand, slack_m=0.0), 1e-4),
        (CoverageTerm(masks, hand.flesh["fine"], 4.0, bones, True), 2e-3),  # pixels change hands
    ):

        def cost(x, term=term):
            return term.cost(size.rescaled(x[26:]).bones(x[:26]))

        system = linearize_sized(Problem(hand, [term]), person, both[:26], np.eye(26))
        assert system.cost == pytest.approx(cost(both))
        assert np.abs(system.gradient[26:]).max() > 0
        names = (*hand.transform.names, *size.names)
        check_gradient(cost, system.gradient, both, names, step=1e-8, rtol=rtol)
