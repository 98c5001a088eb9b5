"""When a frame is tracked, doubtful or lost, and what is said of it."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from handtrack.model.model_file import load_model
from handtrack.observation.observation import ImageKeypoints, Keypoints, Observation
from handtrack.simulation.scenes.simulated_views import mask_views
from handtrack.simulation.simulate import simulated_rig
from handtrack.tracking.frame import assessment
from handtrack.tracking.frame.assessment import (
    assess,
    energy_ratio,
    is_suspicious,
    part_outside,
    what_is_open,
)
from handtrack.tracking.frame.frame_terms import frame_terms
from handtrack.tracking.frame.result import Status
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.search.restart import worth_restarting
from handtrack.tracking.tracker import Tracker

MODEL = load_model()
CAMERAS = simulated_rig(3, (320, 240)).cameras
POSE = MODEL.rest_params()
POSE[1] = -0.09


def assessed(observation, params=POSE, energy=10.0, previous=(), **settings):
    chosen = TrackerSettings().with_values(settings)
    terms = frame_terms(MODEL, chosen, observation, MODEL.bones(params), None)
    return assess(terms, MODEL.bones(params), energy, previous)


def earlier(energy, count=20, status=Status.TRACKED):
    return [SimpleNamespace(energy=energy, status=status, fits=status == Status.TRACKED)] * count


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


def test_it_is_the_bounds_that_decide(seen, monkeypatch):
    monkeypatch.setattr(assessment, "DOUBTFUL_OVERLAP", 0.1)
    monkeypatch.setattr(assessment, "LOST_OVERLAP", 0.05)
    # fingers are beside theirs
    assert assessed(seen, shifted(0.016))[0] == Status.DOUBTFUL
    monkeypatch.setattr(assessment, "DOUBTFUL_PART", 0.0)
    assert assessed(seen, shifted(0.016))[0] == Status.TRACKED


def test_a_finger_beside_the_mask_is_doubtful_though_the_outlines_overlap(seen, monkeypatch):
    params = POSE.copy()
    params[MODEL.skeleton.parameter("index_mcp_flex")] -= 0.5
    params[MODEL.skeleton.parameter("index_mcp_abd")] += 0.6
    with monkeypatch.context() as without:
        without.setattr(assessment, "DOUBTFUL_PART", 0.0)
        assert assessed(seen, params)[0] == Status.TRACKED
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


def spread_mm(model, **by_joint):
    """Return joint covariances (J, 3, 3): 2 mm in all, and what is given for joints whose names begin so."""
    total = [
        next((v for k, v in by_joint.items() if n.startswith(k)), 2.0) for n in model.joint_names
    ]
    return np.array(total)[:, None, None] ** 2 * 1e-6 * np.eye(3) / 3.0


def test_what_is_open_is_named():
    open_fingers = spread_mm(MODEL, ring_mcp=5.0, little_mcp=5.0, ring=40.0, little=40.0)
    ring_and_little = "what was seen leaves the ring and little finger open: ± 40 mm"
    assert what_is_open(MODEL, open_fingers, 15.0) == ring_and_little
    thumb = spread_mm(MODEL, thumb_cmc=2.0, thumb=60.0)
    assert what_is_open(MODEL, thumb, 15.0) == "what was seen leaves the thumb open: ± 60 mm"
    all_of_it = spread_mm(MODEL, **dict.fromkeys(MODEL.joint_names, 20.0))
    assert (
        what_is_open(MODEL, all_of_it, 15.0) == "what was seen leaves the whole hand open: ± 20 mm"
    )


def test_it_is_the_mean_joint_that_counts():
    assert what_is_open(MODEL, spread_mm(MODEL, index_tip=60.0), 15.0) == ""
    assert what_is_open(MODEL, spread_mm(MODEL, index_tip=80.0), 15.0) != ""  # 80 / √21 > 15


def test_nothing_is_open_to_those_who_do_not_ask_nor_of_a_body():
    for model, most in ((MODEL, 0.0), (load_model("body34"), 15.0)):
        far = spread_mm(model, **dict.fromkeys(model.joint_names, 500.0))
        assert what_is_open(model, far, most) == ""


@pytest.mark.parametrize("name", ["glove9", "ball6"])
def test_a_hand_of_few_joints_is_open_as_a_whole(name):
    model = load_model(name)
    far = spread_mm(model, **dict.fromkeys(model.joint_names, 30.0))
    assert what_is_open(model, far, 15.0) == "what was seen leaves the whole hand open: ± 30 mm"


def seen_by(cameras, frame):
    """Return all joints as these cameras see them."""
    points = MODEL.joint_positions(MODEL.bones(POSE))
    views = [ImageKeypoints(c, MODEL.joint_names, c.project(points), 5.0) for c in cameras]
    return Observation(frame, frame / 30.0, (), tuple(views))


def test_a_single_camera_leaves_the_hand_open_and_nothing_else_changes():
    """Doubt about what was not seen is said; it moves no pose, and nothing is looked for."""
    told, silent = (
        Tracker(MODEL, TrackerSettings().with_values({"tracker.doubtful_mm": most}))
        for most in (15.0, 0.0)
    )
    results = [t.step(seen_by(CAMERAS[:1], 0), (), shifted(0.002)) for t in (told, silent)]
    doubted, tracked = results
    assert doubted.status == Status.DOUBTFUL
    assert doubted.note.startswith("what was seen leaves the whole hand open: ± ")
    assert tracked.status == Status.TRACKED
    assert doubted.parameters.tobytes() == tracked.parameters.tobytes()
    assert doubted.fits
    assert not worth_restarting(doubted, results)
    after = [t.step(seen_by(CAMERAS, 1), [r]) for t, r in zip((told, silent), results, strict=True)]
    assert {r.status for r in after} == {Status.TRACKED}
    assert after[0].parameters.tobytes() == after[1].parameters.tobytes()


def test_frames_that_only_leave_something_open_tell_what_is_usual():
    unknown = [SimpleNamespace(energy=100.0, status=Status.DOUBTFUL, fits=True)] * 10
    assert energy_ratio(200.0, 3, unknown + earlier(900.0, 20, Status.DOUBTFUL)) == pytest.approx(
        2.0
    )
