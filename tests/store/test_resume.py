"""Tracking goes on from steps that were stored as if it had never stopped: every number is the same to the bit."""

import numpy as np
import pytest

from handtrack import ImageKeypoints, Observation, Tracker, TrackerSettings, load_model
from handtrack.simulation.simulate import simulated_rig
from handtrack.store.store import Store, WritableStore
from handtrack.tracking.frame.control import Control, Observer
from handtrack.tracking.sequence import track_recording
from tests.experiments.scenes.closing_fist import scene
from tests.store.made import about, same
from tests.tracking.test_appearance import BY_IMAGES, MODEL, observer
from tests.tracking.test_appearance import POSES as BY_IMAGES_POSES

SCENE = scene(2, 100, (96, 72), range(8, 14))
POSES = [SCENE.model.transform.solver_params(joint) for joint in SCENE.joint_params]


class Steps(list, Observer):
    step = list.append  # type: ignore[assignment]


def stored(folder, steps):
    """Return steps as a store gives them back."""
    with WritableStore(folder, "a test") as store:
        writer = store.begin(about())
        for step in steps:
            writer.add(step)
    return Store(folder).takes()[-1].steps()


def check_every_cut(folder, tracker, seen, poses, start, frames):
    """Track; then again from every step on. Return the results of the first time."""

    def tracked(done=()):
        steps = Steps()
        path = track_recording(
            tracker,
            lambda f, _: seen[f],
            start,
            poses[start],
            frames,
            Control(observer=steps),
            done,
        )
        return steps, list(path)

    steps, results = tracked()
    for count in range(1, len(steps) + 1):
        more, rest = tracked(stored(folder, steps[:count]))
        assert same(tuple(more), tuple(steps[count:])), f"after {count} steps"
        known = {s.result.frame: s.result for s in steps[:count]} | {r.frame: r for r in rest}
        for frame, result in {r.frame: r for r in results}.items():
            assert same(known[frame], result), f"frame {frame} after {count} steps"
    return results


@pytest.mark.parametrize(
    ("start", "frames"), [(2, range(1, 4)), (0, range(2, 4)), (5, range(3, 5))]
)
def test_a1_both_ways_from_inside_and_outside_of_the_range(tmp_path, start, frames):
    check_every_cut(tmp_path, Tracker(SCENE.model), SCENE.observations, POSES, start, frames)


def test_a1_a_refined_recording_is_refined_again(tmp_path):
    whole = TrackerSettings().with_values({"tracker.estimate": "whole"})
    tracker = Tracker(SCENE.model, whole)
    results = check_every_cut(tmp_path, tracker, SCENE.observations, POSES, 1, range(2))
    assert len(results) == 4


def test_a1_hypotheses_are_carried_on(tmp_path):
    ball = load_model("ball6")
    camera = simulated_rig(1, (320, 240)).cameras[0]
    pose = ball.rest_params()
    seen = []
    for frame in range(4):
        moved = pose + 0.003 * frame * (np.arange(len(pose)) < 3)
        pixels = camera.project(ball.joint_positions(ball.bones(moved)))
        joints = ImageKeypoints(camera, ball.joint_names, pixels, 1.0)
        seen.append(Observation(frame, frame / 25.0, keypoints=(joints,)))
    several = {"tracker.hypotheses": 4, "tracker.estimate": "forward"}
    tracker = Tracker(ball, TrackerSettings().with_values(several))
    results = check_every_cut(tmp_path, tracker, seen, [pose] * 4, 1, range(4))
    assert all(result.alternatives for result in results)
    assert len(results) == 4


def test_a1_texture_is_carried_on(tmp_path):
    observe = observer()
    seen = [observe(frame, None) for frame in range(3)]
    results = check_every_cut(
        tmp_path, Tracker(MODEL, BY_IMAGES), seen, BY_IMAGES_POSES, 0, range(3)
    )
    assert "intensity" in results[2].energies
