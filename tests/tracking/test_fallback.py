"""A poor cloud that alone holds the hand: its depths are doubted, the palm stays where it is, and it is said."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from handtrack import HandScale, Status, Tracker, TrackerSettings, TrackerState, load_model
from handtrack.observation.observation import view_centres
from handtrack.simulation.motion import motion
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.terms.cloud_terms import agreement, cloud_terms, see_cloud
from handtrack.tracking.search.frame_solve import poor_cloud_settings
from tests.experiments.scenes.simulated_clouds import DIGICLOPS, FINE, Sensor, depth_views
from tests.tracking.scenes import QUICK, Told, followed

MODEL = load_model()
FRAMES = 5
TRUTH = motion(MODEL, "open_fist_open", 100, np.random.default_rng(0))[:FRAMES]


@cache
def views(sensor):
    return list(depth_views(MODEL, TRUTH, sensor, np.random.default_rng(3)))


def tracked(seen, model=MODEL, **settings):
    tracker = Tracker(model, TrackerSettings().with_values(settings))
    return followed(tracker, seen, MODEL.transform.solver_params(TRUTH[0]))


def palm_mm(result, joint):
    at = [MODEL.joint_names.index(name) for name in ("wrist", "middle_mcp")]
    truth = MODEL.joint_positions(MODEL.bones(MODEL.transform.solver_params(joint)))
    return 1e3 * np.linalg.norm(result.joint_positions[at] - truth[at], axis=1).mean()


def test_a_good_cloud_is_left_to_all_joints():
    seen = views(FINE)[:2]
    results = tracked(seen, **QUICK)
    assert [r.status for r in results] == [Status.TRACKED] * 2
    assert not any(r.poor_cloud for r in results)
    without = tracked(seen, **QUICK, **{"model.fallback": "none"})
    for one, other in zip(results, without, strict=True):
        assert_array_equal(one.parameters, other.parameters)


PERSON = HandScale(1.1, {"index": 0.97}, {"palm_breadth": 1.0, "finger_share": -0.5}, {"index_mcp": (1.0, 2.0, 3.0)})  # fmt: skip
"""whose palm is broader, whose fingers are longer, and of which a detector sees joints beside them: a simpler hand has none of these"""


@pytest.mark.parametrize(("kind", "within_mm"), [("auto", 10.0), ("glove9", 40.0), ("ball6", 40.0)])
def test_a_poor_cloud_moves_the_palm_and_says_so(kind, within_mm):
    model = MODEL if kind == "auto" else load_model(scale=PERSON)
    results = tracked(views(DIGICLOPS), model, **{"model.fallback": kind})
    for result, joint in zip(results, TRUTH, strict=True):
        assert result.status == Status.DOUBTFUL
        assert result.poor_cloud
        assert result.is_simplified == (kind != "auto")
        assert np.isfinite(result.parameter_std[:6]).all()
        assert_allclose(model.clipped(result.parameters), result.parameters, atol=1e-9)
        assert palm_mm(result, joint) < within_mm
        if kind != "auto":
            assert f"({kind})" in result.note
            assert_array_equal(result.parameters[6:], results[0].parameters[6:])


def test_depths_are_doubted_not_directions():
    """Points that moved by centimetres along their lines of sight leave the palm where it is; moved aside they take it along."""
    seen = views(DIGICLOPS)[1]
    points, centre = seen.cloud.points, view_centres(seen.cloud_views[0])[0]
    wrong = points[:, 0] > np.median(points[:, 0]) + 0.01
    deeper = centre + (points - centre) * np.where(wrong, 1.06, 1.0)[:, None]
    aside = points + np.array([0.012, 0.0, 0.0])
    doubted = Tracker(MODEL, poor_cloud_settings(TrackerSettings()))
    begun = TrackerState.beginning_at(MODEL.transform.solver_params(TRUTH[1]))

    def found(moved):
        frame = replace(seen, cloud=replace(seen.cloud, points=moved))
        return doubted.step(begun, frame)[1]

    assert wrong.mean() > 0.2
    assert palm_mm(found(deeper), TRUTH[1]) < 6.0
    assert palm_mm(found(aside), TRUTH[1]) > 9.0


def test_what_no_line_of_sight_meets_may_be_a_hole():
    """A patch of the hand beside all lines costs log 2, however far; deeper or nearer on them it costs nothing."""
    calm, params = poor_cloud_settings(TrackerSettings()), MODEL.transform.solver_params(TRUTH[0])
    seen = see_cloud(views(FINE)[0], MODEL, MODEL.bones(params), calm)
    _, holes = cloud_terms(seen, 1.2)
    patches = holes.weight * len(holes.bone)
    sight = TRUTH[0][:3] - views(DIGICLOPS)[0].cloud_views[0][0]

    def cost(place):
        return holes.cost(MODEL.bones(params + np.r_[place, np.zeros(len(params) - 3)])) / patches

    here, near, *far = (cost([aside, 0.0, 0.0]) for aside in (0.0, 0.015, 0.3, 0.5))
    assert 20.0 < patches < 60.0
    assert here < 0.05 < near
    assert_allclose(far, np.log(2.0), rtol=1e-6)
    for along in (-0.02, 0.02):
        assert cost(along * sight / np.linalg.norm(sight)) < 0.1


POSE = MODEL.rest_params()
POSE[1] = -0.09
WHOLE, FAIR, POOR = 0.0, 0.2, 0.4
"""how much of the hand is missing, in zones"""


def cloud(missing, frame=0):
    sensor = Sensor((160, 120), noise_m=5e-4, missing=missing, blob_m=0.04)
    joint = MODEL.joint_params(POSE)[None]
    seen = next(depth_views(MODEL, joint, sensor, np.random.default_rng(4)))
    return replace(seen, frame=frame, time_s=frame / 25.0)


def agreed(missing):
    bones = MODEL.bones(POSE)
    seen = see_cloud(cloud(missing), MODEL, bones, TrackerSettings())
    assert seen is not None
    found = agreement(seen, bones)
    return found.share


def test_a_doubt_begins_below_one_bound_and_ends_above_a_higher_one():
    assert agreed(WHOLE) > 0.95
    assert 0.82 < agreed(FAIR) < 0.86
    assert agreed(POOR) < 0.78
    clouds = [WHOLE, FAIR, POOR, FAIR, WHOLE, FAIR]
    seen = [cloud(missing, frame) for frame, missing in enumerate(clouds)]
    settings = TrackerSettings().with_values(QUICK | {"solver.iterations": 6})
    told = Told()
    results = followed(Tracker(MODEL, settings), seen, POSE, Control(observer=told))
    assert [r.poor_cloud for r in results] == [False, False, True, True, False, False]
    assert [(r.frame, r.winner is not None) for r in told] == [(2, True), (3, True), (4, False)]
