"""The mixture tracker: alternatives that look alike are carried, weighed, and survive unseen frames."""

from dataclasses import replace

import numpy as np
import pytest

from handtrack import Observation, Status, Tracker, TrackerSettings, TrackerState
from tests.tracking.test_doubt_of_bodies import BODY, FRONT, SIDE, joints_of_body, places_of

ARM = ("left_shoulder_abd", "left_shoulder_flex", "left_elbow_flex")
TRUTH = [
    BODY.params_from(dict(zip(ARM, bends, strict=True)))
    for bends in np.linspace((1.0, 0.3, 0.6), (1.2, 0.4, 0.8), 6)
]
"""A left arm held out and bent forward, swinging slowly; the same arm bent backward looks alike."""


def _seen(*cameras):
    """Return what cameras see in each frame, with a pixel of noise."""
    seen, rng = [], np.random.default_rng(5)
    for frame, pose in enumerate(TRUTH):
        off_px = rng.normal(size=(len(BODY.joint_names), 2))
        joints = joints_of_body(pose, *cameras, off_px=off_px, sigma_px=1.0)
        seen.append(replace(joints, frame=frame, time_s=frame / 25.0))
    return seen


def _tracked(observations):
    few = {"tracker.hypotheses": 3, "mixture.draws": 8, "mixture.carried": 5}
    tracker = Tracker(BODY, TrackerSettings().with_values(few))
    state, results = TrackerState.beginning_at(TRUTH[0]), []
    for observation in observations:
        state, result = tracker.step(state, observation)
        assert len(state.beliefs) == len(result.alternatives)
        results.append(result)
    return results


@pytest.fixture(scope="module")
def observations():
    return _seen(FRONT)


def test_one_of_few_is_near_the_truth_and_another_is_a_flip(observations):
    """Both look alike: within the noise in the image, decimetres apart in space."""
    true, seen = places_of(TRUTH[-1]), observations[-1].keypoints[0]
    held = _tracked(observations)[-1].alternatives[:3]
    shapes = [places_of(BODY.transform.solver_params(h.parameters)) for h in held]
    off = [np.linalg.norm((s - s[0]) - (true - true[0]), axis=1).mean() for s in shapes]
    assert min(off) < 0.06
    for shape in shapes:
        error = np.linalg.norm(FRONT.project(shape) - seen.pixels, axis=1)
        assert np.median(error) < 4.0
    ends = ("elbow", "wrist", "knee", "ankle")
    limbs = [i for i, n in enumerate(BODY.joint_names) if n.endswith(ends)]
    apart = [np.linalg.norm(s - shapes[0], axis=1)[limbs].max() for s in shapes[1:]]
    assert max(apart) > 0.1


def test_hypotheses_survive_frames_without_anything_seen(observations):
    blank = Observation(2, 2 / 25.0)
    results = _tracked([*observations[:2], blank, *observations[3:4]])
    assert results[2].status == Status.LOST
    held, before = results[2].alternatives, results[1].alternatives
    assert [h.weight for h in held] == [h.weight for h in before]
    assert [h.parent for h in held] == list(range(len(before)))
    assert results[3].status != Status.LOST
    assert all(h.parent >= 0 for h in results[3].alternatives)


def test_two_cameras_leave_one_pose():
    """What a second camera sees decides between flips: nearly all the weight is on the truth."""
    last = _tracked(_seen(FRONT, SIDE)[:3])[-1]
    assert np.linalg.norm(last.joint_positions - places_of(TRUTH[2]), axis=1).mean() < 0.02
    assert last.alternatives[0].weight > 0.9
