"""Clouds in the tracker: simplified models, where the hand is expected, and how much a cloud counts."""

from dataclasses import replace

import numpy as np
import pytest

from handtrack import (
    HandScale,
    Observation,
    PointCloud,
    Status,
    Tracker,
    TrackerSettings,
    TrackerState,
    load_model,
)
from handtrack.model.metaballs import MetaballSurface, surface_mesh
from handtrack.model.pose_library import named_pose
from handtrack.tracking.frame.constants import CLOUD_PATCH_MM
from handtrack.tracking.frame.terms.cloud_terms import see_cloud
from handtrack.tracking.search.keypoint_start import carried_over
from handtrack.tracking.sequence import track_frames
from tests.experiments.scenes.simulated_clouds import FINE, depth_views
from tests.tracking.scenes import inside_stated, off_mm, on_surface, posed

HAND = load_model()


def seen(pose, rng, count=3000, noise=3e-4):
    """Return parameters and an observation of points all over the hand's surface."""
    joint = named_pose(HAND, pose)
    joint[:6] = rng.normal(scale=0.3, size=6)
    points, _ = on_surface(HAND, joint, count, rng)
    cloud = PointCloud(points + rng.normal(scale=noise, size=points.shape))
    return joint, Observation(0, 0.0, cloud=cloud)


@pytest.mark.parametrize("pose", ["open", "curl", "pinch"])
def test_a_cloud_alone_gives_the_pose(rng, pose):
    joint, observation = seen(pose, rng)
    start = joint + rng.normal(size=26) * ([0.006] * 3 + [np.deg2rad(4)] * 23)
    _, result = Tracker(HAND).step(TrackerState.beginning_at(HAND.clipped(start)), observation)
    assert result.status == Status.TRACKED
    assert off_mm(result, HAND, joint).mean() < 0.25  # measured 0.04 to 0.11 mm


@pytest.mark.parametrize(
    ("name", "count", "within_m"), [("glove9", 9, 0.007), ("ball6", 6, 0.016)]
)  # of 12 draws: medians 3.5 and 14.9 mm, worst 4.1 and 15.2
def test_simpler_models_hold_the_palm(rng, name, count, within_m):
    """A cloud of the whole hand, followed by three ellipsoids or one: where the wrist is, roughly."""
    simple = load_model(name)
    joint, observation = seen("rest", rng)
    assert len(simple.transform.names) == count
    start = carried_over(HAND, joint, simple)
    np.testing.assert_allclose(start[:6], joint[:6])
    _, result = Tracker(simple).step(TrackerState.beginning_at(start), observation)
    assert result.keypoints21 is None
    assert np.linalg.norm(result.joint_positions[0] - joint[:3]) < within_m


def test_tracking_tells_where_the_hand_is_expected_unless_it_was_lost(rng):
    """A hand that moves on by 12 mm a frame; one frame sees nothing, the next one is seen again."""
    handed, first = [], named_pose(HAND, "open")
    first[:3] = [0.0, 0.1, 0.4]

    def observe(frame, bones):
        handed.append(bones)
        if frame == 3:
            return Observation(frame, frame / 30)
        points, _ = on_surface(HAND, first + 0.012 * frame * np.eye(26)[0], 800, rng)
        return Observation(frame, frame / 30, cloud=PointCloud(points))

    results = list(track_frames(Tracker(HAND), observe, 0, first, range(5)))
    assert [r.status for r in results] == [Status.TRACKED] * 3 + [Status.LOST, Status.TRACKED]
    assert results[3].reason.kind == "unseen"
    expected = [None if bones is None else bones.position[0, 0] for bones in handed]
    np.testing.assert_allclose(expected[:4], [0.0, 0.0, 0.024, 0.036], atol=0.005)
    assert expected[4] is None


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
    inside = []
    for seed, pose in enumerate(("open", "curl", "rest")):
        rng = np.random.default_rng(seed)
        flesh = HAND.ellipsoids["metaballs"]
        radii = flesh.radii * np.exp(0.12 * rng.normal(size=(len(flesh), 1)))
        other = replace(
            HAND, ellipsoids=HAND.ellipsoids | {"metaballs": replace(flesh, radii=radii)}
        )
        joint = posed(HAND, pose)
        seen = next(depth_views(other, joint[None], replace(FINE, size=(320, 240)), rng))
        _, found = Tracker(HAND).step(TrackerState.beginning_at(joint), seen)
        inside.append(inside_stated(found, HAND, joint))
    assert np.mean(inside) > 0.7
