"""Step and sequence: missing views, lost frames, backward, stopping, the same bytes again."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from handtrack import Status, Tracker
from handtrack.tracking.frame.control import Control
from handtrack.tracking.sequence import refine_recording, track_frames
from handtrack.tracking.tracker import CONFIRMED_BY
from tests.experiments.scenes.closing_fist import scene
from tests.tracking.scenes import off_mm

FIRST, COUNT = 8, 10
SCENE = scene(3, 100, (320, 240), range(FIRST, FIRST + COUNT))
MODEL = SCENE.model
TRACKER = Tracker(MODEL)
START = MODEL.transform.solver_params(SCENE.joint_params[0])


def errors_mm(results):
    """Return the mean joint error of each result."""
    return np.array([off_mm(r, MODEL, SCENE.joint_params[r.frame]).mean() for r in results])


def seen(frame, _bones=None):
    return SCENE.observations[frame]


def followed(observe=seen, frames=range(COUNT), tracker=TRACKER, control=Control()):
    return list(track_frames(tracker, observe, 0, START, frames, control))


def without(observation, cameras):
    left = tuple(s for s in observation.silhouettes if s.camera.name not in cameras)
    return replace(observation, silhouettes=left)


@pytest.fixture(scope="module")
def forward():
    return followed()


def test_no_frame_is_surer_than_an_unsure_start_until_five_have_confirmed_it(forward):
    unsure = replace(TRACKER, start_confidence=0.3)
    results = followed(frames=range(CONFIRMED_BY + 1), tracker=unsure)
    doubtful = [r.status == Status.DOUBTFUL for r in results]
    assert doubtful == [True] * (CONFIRMED_BY - 1) + [False] * 2
    assert all(r.reason.number == 0.3 and r.fits for r in results[: CONFIRMED_BY - 1])
    for one, other in zip(results, forward):
        assert_array_equal(one.parameters, other.parameters)
    (single,) = followed(frames=range(1), tracker=unsure)
    assert single.status == Status.DOUBTFUL
    again = refine_recording(unsure, seen, results[:3])
    assert {r.status for r in again} == {Status.DOUBTFUL}
    confirmed = refine_recording(unsure, seen, results)
    assert {r.status for r in confirmed} == {Status.TRACKED}


def test_one_camera_alone_is_followed_and_says_that_it_knows_less(forward):
    results = followed(lambda f, _: without(seen(f), ("cam0", "cam2")))
    assert errors_mm(results).max() < 3.0  # measured 1.5 mm
    spread = np.trace(results[5].joint_covariance, axis1=1, axis2=2).mean()
    assert spread > 5 * np.trace(forward[5].joint_covariance, axis1=1, axis2=2).mean()


def test_nothing_seen_is_lost_holds_the_last_estimate_and_goes_on():
    def observe(frame, _bones):
        unseen = ("cam0", "cam1", "cam2") if 4 <= frame < 7 else ()
        return without(seen(frame), unseen)

    results = followed(observe)
    for lost in results[4:7]:
        assert lost.status == Status.LOST
        assert np.isinf(lost.parameter_std).all()
        assert np.isnan(lost.energy)
        assert lost.iterations == 0
        assert np.isfinite(lost.joint_covariance).all()
        assert_allclose(lost.parameters, results[3].parameters, atol=1e-12)
        assert lost.reason.kind == "unseen"
    assert [r.status for r in results[7:]] == [Status.TRACKED] * (COUNT - 7)
    assert errors_mm(results[7:]).max() < 0.4  # measured 0.26 mm


def test_stopping_leaves_what_is_done():
    results = []
    control = Control(should_stop=lambda: len(results) == 2)
    for result in track_frames(TRACKER, seen, 0, START, range(COUNT), control):
        results.append(result)
    assert 2 <= len(results) < COUNT
    assert [r.frame for r in results] == list(range(len(results)))
    assert errors_mm(results).max() < 0.4
    assert followed(control=Control(should_stop=lambda: True)) == []
