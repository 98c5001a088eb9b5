"""A cloud too poor for all joints: the palm goes on, the fingers are held, and it is said."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from handtrack.bench.simulated_clouds import DIGICLOPS, FINE, depth_views
from handtrack.model.model_file import load_model
from handtrack.model.pose_library import named_pose
from handtrack.session.motion import motion
from handtrack.tracker.fallback import GOOD, POOR, Agreement, is_simplified, simplified, steadier
from handtrack.tracker.result import Status
from handtrack.tracker.sequence import track_frames
from handtrack.tracker.settings import TrackerSettings
from handtrack.tracker.tracker import Tracker

MODEL = load_model()
FRAMES = 8
TRUTH = motion(MODEL, "open_fist_open", 100, np.random.default_rng(0))[:FRAMES]


def views(sensor, seed=3):
    return list(depth_views(MODEL, TRUTH, sensor, np.random.default_rng(seed)))


def tracked(seen, **settings):
    tracker = Tracker(MODEL, TrackerSettings().with_values(settings))
    start = MODEL.transform.solver_params(TRUTH[0])
    return list(track_frames(tracker, lambda f, *_: seen[f], 0, start, range(len(seen))))


def palm_mm(result, joint):
    at = [MODEL.joint_names.index(name) for name in ("wrist", "middle_mcp")]
    truth = MODEL.joint_positions(MODEL.bones(MODEL.transform.solver_params(joint)))
    return 1e3 * np.linalg.norm(result.joint_positions[at] - truth[at], axis=1).mean()


@pytest.fixture(scope="module")
def poor():
    return views(DIGICLOPS)


def test_a_good_cloud_is_left_to_all_joints():
    seen = views(FINE)[:3]
    results = tracked(seen)
    assert [r.status for r in results] == [Status.TRACKED] * 3
    assert not any(is_simplified(r) for r in results)
    without = tracked(seen, **{"model.fallback": "none"})
    for one, other in zip(results, without, strict=True):
        np.testing.assert_array_equal(one.parameters, other.parameters)


@pytest.mark.parametrize("kind", ["auto", "glove9", "ball6"])
def test_a_poor_cloud_moves_the_palm_and_says_so(poor, kind):
    results = tracked(poor, **{"model.fallback": kind})
    for result, joint in zip(results, TRUTH, strict=True):
        assert result.status == Status.DOUBTFUL
        assert result.note.startswith("poor cloud: ")
        assert is_simplified(result)
        assert np.isfinite(result.parameter_std[:6]).all()
        assert len(result.parameters) == 26
        low, high = MODEL.limits.bounds(result.parameters).T
        assert (result.parameters >= low - 1e-9).all()
        assert (result.parameters <= high + 1e-9).all()
        assert palm_mm(result, joint) < (15.0 if kind == "auto" else 40.0)
    assert ("one bend of the fingers" if kind == "auto" else f"({kind})") in results[-1].note


def test_what_is_held_stays_held(poor):
    """glove9 in a poor frame: not a finger moves. With nine freedoms they bend together."""
    fingers = [i for i, n in enumerate(MODEL.parameter_names) if i >= 6 and "_cmc_" not in n]
    held = tracked(poor, **{"model.fallback": "glove9"})[-1]
    np.testing.assert_allclose(held.parameters[fingers], TRUTH[0][fingers], atol=1e-9)
    bent = tracked(poor)[-1].parameters - TRUTH[0]
    knuckle, tip = (MODEL.parameter_names.index(f"ring_{j}_flex") for j in ("pip", "dip"))
    assert bent[tip] == pytest.approx(2 / 3 * bent[knuckle], abs=1e-9)


def test_nothing_is_claimed_of_held_fingers(poor):
    """Their joints may be as far off as limits let them; the palm's are known."""
    result = tracked(poor[:2])[-1]
    spread = 1e3 * np.sqrt(np.trace(result.joint_covariance, axis1=1, axis2=2))
    tip, wrist = (MODEL.joint_names.index(name) for name in ("index_tip", "wrist"))
    assert spread[tip] > 30.0
    assert spread[wrist] < 15.0


def test_it_can_be_switched_off(poor):
    assert not any(is_simplified(r) for r in tracked(poor[:3], **{"model.fallback": "none"}))


def test_it_ends_with_the_poor_frames(poor):
    """The fingers are found again as soon as they are measured."""
    good = views(FINE)
    mixed = [good[0], poor[1], poor[2], *good[3:]]
    results = tracked(mixed)
    assert [is_simplified(r) for r in results[:3]] == [False, True, True]
    assert not any(is_simplified(r) for r in results[4:])
    assert palm_mm(results[-1], TRUTH[-1]) < 1.5


def test_it_does_not_flicker():
    between = Agreement(0.5 * (POOR + GOOD), 0.5 * (POOR + GOOD))
    usual = SimpleNamespace(status=Status.TRACKED, parameter_std=np.ones(26))
    held = SimpleNamespace(status=Status.DOUBTFUL, parameter_std=np.r_[np.ones(6), [np.inf] * 20])
    assert not between.is_poor([])
    assert not between.is_poor([usual])
    assert between.is_poor([held])
    assert Agreement(1.0, 0.5).is_poor([usual])  # half of the hand was not measured
    assert Agreement(0.5, 1.0).is_poor([usual])  # half of the points are elsewhere
    assert not Agreement(0.95, 0.95).is_poor([held])


def test_the_simpler_hand_stands_where_the_whole_one_stood(rng):
    joint = named_pose(MODEL, "pinch")
    joint[:6] = rng.normal(scale=0.2, size=6)
    few = simplified(MODEL, joint, "auto")
    assert len(few.model.transform.names) == 9
    np.testing.assert_allclose(few.whole(few.start), joint, atol=1e-12)
    for kind, count in (("glove9", 9), ("ball6", 6)):
        few = simplified(MODEL, joint, kind)
        assert len(few.model.transform.names) == count
        np.testing.assert_allclose(few.whole(few.start), joint, atol=1e-12)


def test_a_forearm_keeps_its_own_freedoms():
    model = load_model(forearm=True)
    few = simplified(model, model.rest, "auto")
    assert {"wrist_flex", "wrist_abd"} <= set(few.model.transform.names)


def test_settings_of_poor_frames_look_for_no_fallback_of_their_own():
    calm = steadier(TrackerSettings())
    assert calm.model.fallback == "none"
    assert replace(calm.model, fallback="auto") == TrackerSettings().model


def test_a_palm_in_a_poor_cloud_is_never_looked_for_elsewhere() -> None:
    assert TrackerSettings().tracker.jumps
    follow = steadier(TrackerSettings()).tracker
    assert not follow.jumps
    assert not follow.escape
