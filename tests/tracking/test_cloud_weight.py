"""How much a cloud counts: by the surface it measures, by how a hand's own shape errs, and K between its side and the model's."""

from dataclasses import replace

import numpy as np
import pytest

from handtrack import (
    HandScale,
    Observation,
    PointCloud,
    Tracker,
    TrackerSettings,
    TrackerState,
    load_model,
)
from handtrack.model.pose_library import named_pose
from handtrack.model.surfaces.metaballs import MetaballSurface
from handtrack.model.surfaces.surface_mesh import surface_mesh
from handtrack.tracking.frame.constants import CLOUD_PATCH_MM
from handtrack.tracking.frame.terms.cloud_terms import see_cloud
from tests.experiments.scenes.simulated_clouds import FINE, depth_views
from tests.tracking.scenes import on_surface

CHI2_90 = 6.251
"""squared length within which nine tenths of three standard normal numbers lie"""


@pytest.mark.parametrize(("scale", "count"), [(1.0, 15_000), (1.2, 30_000)])
def test_points_count_by_the_surface_they_measure(rng, scale, count):
    """Not by how many there are, nor by how large the hand is: a larger hand's parts are broader."""
    model = load_model(scale=HandScale(scale))
    bones = model.bones(model.rest_params())
    points, _ = on_surface(model, model.rest_params(), count, rng)
    seen = see_cloud(Observation(0, 0.0, cloud=PointCloud(points)), model, bones, TrackerSettings())
    mesh = surface_mesh(MetaballSurface.of(model), bones)
    vertices, _ = mesh.carried(bones)
    a, b, c = (vertices[mesh.faces[:, i]] for i in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    patch = scale * 1e-3 * CLOUD_PATCH_MM
    assert seen.share * count == pytest.approx(area / patch**2, rel=0.2)


def test_it_does_not_take_another_hands_flesh_for_another_pose():
    """Thicker and thinner flesh before one depth camera: the joints lie where the stated uncertainty says."""
    model, inside = load_model(), []
    for seed, pose in enumerate(("open", "curl", "rest")):
        rng = np.random.default_rng(seed)
        flesh = model.flesh["metaballs"]
        radii = flesh.radii * np.exp(0.12 * rng.normal(size=(len(flesh), 1)))
        other = replace(model, flesh=model.flesh | {"metaballs": replace(flesh, radii=radii)})
        joint = named_pose(model, pose)
        joint[1] = -0.09
        seen = next(depth_views(other, joint[None], replace(FINE, size=(320, 240)), rng))
        _, found = Tracker(model).step(
            TrackerState.beginning_at(model.transform.solver_params(joint)), seen
        )
        off = found.joint_positions - model.joint_positions(model.bones(joint))
        inside.append(np.einsum("ji,jik,jk->j", off, np.linalg.inv(found.joint_covariance), off))
    assert np.mean(np.concatenate(inside) < CHI2_90) > 0.7
