"""The mixture tracker: alternatives that look alike are carried, weighed, repeatable, and survive unseen frames."""

from dataclasses import replace

import numpy as np
import pytest

from handtrack import (
    ImageKeypoints,
    Observation,
    Status,
    Tracker,
    TrackerSettings,
    TrackerState,
    load_model,
)
from handtrack.tracking.frame.control import Control
from tests.cameras import FACING, pinhole

FRAMES, FEW = 6, {"tracker.hypotheses": 3, "mixture.draws": 8, "mixture.carried": 5}


@pytest.fixture(scope="module")
def body():
    return load_model("body34")


@pytest.fixture(scope="module")
def camera():
    return pinhole("front", (1280, 960), 1200, FACING, (0, 0, 4), at=(640, 480))


@pytest.fixture(scope="module")
def truth(body):
    """A left arm held out and bent forward, swinging slowly; the same arm bent backward looks alike."""
    poses = np.tile(body.rest_params(), (FRAMES, 1))
    for name, first, last in (
        ("left_shoulder_abd", 1.0, 1.2),
        ("left_shoulder_flex", 0.3, 0.4),
        ("left_elbow_flex", 0.6, 0.8),
    ):
        poses[:, body.parameter_names.index(name)] = np.linspace(first, last, FRAMES)
    return poses


@pytest.fixture(scope="module")
def observations(body, camera, truth):
    rng = np.random.default_rng(5)
    seen = []
    for frame, pose in enumerate(truth):
        pixels = camera.project(body.joint_positions(body.bones(pose)))
        pixels = pixels + rng.normal(size=pixels.shape)
        joints = ImageKeypoints(camera, body.joint_names, pixels, 1.0)
        seen.append(Observation(frame, frame / 25.0, keypoints=(joints,)))
    return seen


def _track(body, observations, start, on_search=None, **settings):
    chosen = {name.replace("__", "."): value for name, value in settings.items()}
    tracker = Tracker(body, TrackerSettings().with_values(FEW | chosen))
    state, results = TrackerState.beginning_at(start), []
    for observation in observations:
        state, result = tracker.step(state, observation, Control(on_search=on_search))
        assert len(state.hypotheses) == len(result.alternatives)
        results.append(result)
    return results


def _places(body, pose):
    return body.joint_positions(body.bones(body.transform.solver_params(pose.parameters)))


@pytest.fixture(scope="module")
def tracked(body, observations, truth):
    return _track(body, observations, truth[0])


def test_one_of_few_is_near_the_truth_and_another_is_a_flip(body, observations, truth, tracked):
    """Both look alike: within the noise in the image, decimetres apart in space."""
    last = tracked[-1]
    true = body.joint_positions(body.bones(truth[-1]))
    shapes = [_places(body, h) for h in last.alternatives[:3]]
    off = [np.linalg.norm((s - s[0]) - (true - true[0]), axis=1).mean() for s in shapes]
    assert min(off) < 0.06
    seen = observations[-1].keypoints[0]
    for shape in shapes:
        error = np.linalg.norm(seen.camera.project(shape) - seen.pixels, axis=1)
        assert np.median(error) < 4.0
    limbs = [
        i for i, n in enumerate(body.joint_names) if n.endswith(("elbow", "wrist", "knee", "ankle"))
    ]
    apart = [np.linalg.norm(s - shapes[0], axis=1)[limbs].max() for s in shapes[1:]]
    assert max(apart) > 0.1


def test_hypotheses_survive_frames_without_anything_seen(body, observations, truth):
    blank = Observation(2, 2 / 25.0)
    results = _track(body, [*observations[:2], blank, *observations[3:4]], truth[0])
    assert results[2].status == Status.LOST
    held, before = results[2].alternatives, results[1].alternatives
    assert [h.weight for h in held] == [h.weight for h in before]
    assert [h.parent for h in held] == list(range(len(before)))
    assert results[3].status != Status.LOST
    assert all(h.parent >= 0 for h in results[3].alternatives)


def test_two_cameras_leave_one_pose(body, camera, truth):
    """What a second camera sees decides between flips: nearly all the weight is on the truth."""
    turn = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    side = replace(camera, name="side", rotation=camera.rotation @ turn)
    rng = np.random.default_rng(2)
    seen = []
    for frame, pose in enumerate(truth[:3]):
        places = body.joint_positions(body.bones(pose))
        joints = tuple(
            ImageKeypoints(c, body.joint_names, c.project(places) + rng.normal(size=(22, 2)), 1.0)
            for c in (camera, side)
        )
        seen.append(Observation(frame, frame / 25.0, keypoints=joints))
    last = _track(body, seen, truth[0])[-1]
    error = np.linalg.norm(
        last.joint_positions - body.joint_positions(body.bones(truth[2])), axis=1
    )
    assert error.mean() < 0.02
    assert last.alternatives[0].weight > 0.9
