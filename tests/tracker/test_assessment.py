"""When a frame is tracked, doubtful or lost, and what is said of it."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from handtrack.bench.simulated_views import mask_views
from handtrack.model.model_file import load_model
from handtrack.observation.observation import Keypoints, Observation
from handtrack.session.simulate import simulated_rig
from handtrack.tracker.assessment import assess, energy_ratio, is_suspicious, part_outside
from handtrack.tracker.frame_terms import frame_terms
from handtrack.tracker.result import Status
from handtrack.tracker.settings import TrackerSettings

MODEL = load_model()
CAMERAS = simulated_rig(3, (320, 240)).cameras
POSE = MODEL.rest_params()
POSE[1] = -0.09


def assessed(observation, params=POSE, energy=10.0, previous=(), **settings):
    chosen = TrackerSettings().with_values(settings)
    terms = frame_terms(MODEL, chosen, observation, MODEL.bones(params), None)
    return assess(terms, MODEL.bones(params), energy, previous)


def earlier(energy, count=20, status=Status.TRACKED):
    return [SimpleNamespace(energy=energy, status=status)] * count


def shifted(metres):
    params = POSE.copy()
    params[0] += metres
    return params


@pytest.fixture(scope="module")
def seen():
    return mask_views(MODEL, POSE, CAMERAS)


def test_a_good_fit_is_tracked_without_a_word(seen):
    assert assessed(seen) == (Status.TRACKED, "")


def test_a_poor_overlap_is_doubtful_and_names_the_camera(seen):
    status, note = assessed(seen, shifted(0.016))
    assert status == Status.DOUBTFUL
    assert note.startswith("model and silhouette overlap by ")
    assert note.split()[-1] in {c.name for c in CAMERAS}


def test_no_overlap_is_lost(seen):
    status, note = assessed(seen, shifted(0.2))
    assert status == Status.LOST
    assert "overlap by 0 %" in note


def test_one_bad_view_is_doubtful_not_lost(seen):
    """An arm in front of one camera: the others still hold the hand."""
    first, *rest = seen.silhouettes
    odd = replace(first, mask=np.roll(first.mask, 90, axis=1))
    status, note = assessed(replace(seen, silhouettes=(odd, *rest)))
    assert status == Status.DOUBTFUL
    assert note.endswith("in cam0")


def test_the_bounds_are_settings(seen):
    bounds = {"tracker.doubtful_overlap": 0.1, "tracker.lost_overlap": 0.05}
    assert (
        assessed(seen, shifted(0.016), **bounds)[0] == Status.DOUBTFUL
    )  # fingers are beside theirs
    bounds["tracker.doubtful_part"] = 0.0
    assert assessed(seen, shifted(0.016), **bounds)[0] == Status.TRACKED


def test_a_finger_beside_the_mask_is_doubtful_though_the_outlines_overlap(seen):
    params = POSE.copy()
    params[MODEL.skeleton.parameter("index_mcp_flex")] -= 0.5
    params[MODEL.skeleton.parameter("index_mcp_abd")] += 0.6
    assert assessed(seen, params, **{"tracker.doubtful_part": 0.0})[0] == Status.TRACKED
    status, note = assessed(seen, params)
    assert status == Status.DOUBTFUL
    assert "% of the index " in note
    assert "outside the silhouette in cam" in note


def test_a_forearm_longer_than_the_mask_is_no_lost_part(seen):
    """Nobody knows where a sleeve begins."""
    whole = load_model(forearm=True)
    params = np.insert(POSE, 6, [0.0, 0.0])
    terms = frame_terms(whole, TrackerSettings(), seen, whole.bones(params), None)
    assert part_outside(terms, whole.bones(params)) == ""


def test_a_hand_out_of_all_views_is_lost(seen):
    nothing = [replace(s, mask=np.zeros_like(s.mask)) for s in seen.silhouettes]
    status, note = assessed(replace(seen, silhouettes=tuple(nothing)), shifted(2.0))
    assert status == Status.LOST
    assert note == "neither model nor silhouette is in any view"


def test_keypoints_alone_are_doubtful():
    points = MODEL.joint_positions(MODEL.bones(POSE))
    given = Observation(0, 0.0, (), (Keypoints(MODEL.joint_names, points, 0.005),))
    status, note = assessed(given)
    assert status == Status.DOUBTFUL
    assert note == "nothing was seen; only given keypoints hold the pose"


def test_a_fit_much_worse_than_usual_is_doubtful(seen):
    status, note = assessed(seen, energy=300.0, previous=earlier(100.0))
    assert status == Status.DOUBTFUL
    assert note == "the model fits 3.0 times worse than usual; a finger may be lost"
    assert assessed(seen, energy=150.0, previous=earlier(100.0))[0] == Status.TRACKED


def test_usual_is_what_tracked_frames_were():
    assert energy_ratio(200.0, 3, []) == 1.0
    assert energy_ratio(200.0, 3, earlier(100.0)) == pytest.approx(2.0)
    assert energy_ratio(200.0, 3, earlier(100.0, status=Status.LOST)) == 1.0
    assert energy_ratio(200.0, 3, earlier(100.0, 2)) == 1.0  # too few to go by
    always_doubtful = earlier(100.0, status=Status.DOUBTFUL)
    assert energy_ratio(200.0, 3, always_doubtful) == pytest.approx(2.0)
    mixed = earlier(100.0, 20) + earlier(900.0, 5)
    assert energy_ratio(200.0, 3, mixed) == pytest.approx(2.0)


def test_nearly_perfect_fits_do_not_call_each_other_bad():
    assert energy_ratio(5.0, 3, earlier(0.1)) < 1.0


def test_a_first_frame_is_suspicious_and_a_usual_one_is_not():
    assert is_suspicious(1.0, 3, [])
    assert not is_suspicious(110.0, 3, earlier(100.0))
    assert is_suspicious(150.0, 3, earlier(100.0))
