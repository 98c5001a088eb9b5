"""Whole sequences against their truth: the bundled session, an independent hand, and a real one."""

from typing import Any

import numpy as np
import pytest

from handtrack import Session, Status, TrackingRun, bundled_session
from handtrack.model.size import hand_length_mm
from tests.app.command_line import small_recording
from tests.benchmarks.desk_two_view import compare
from tests.session.small_session import edit


def errors_mm(track, truth):
    """Return the distances (F, 21) of keypoints to the truth."""
    row = {int(frame): i for i, frame in enumerate(truth.frame)}
    true = truth.keypoints21[[row[int(frame)] for frame in track.frame]]
    return 1e3 * np.linalg.norm(track.keypoints21 - true, axis=2)


LIVE = {"tracker.estimate": "forward"}
QUICK = {"tracker.escape": False, "tracker.recovery": False}
"""no searches: here they change the errors by hundredths of a millimetre"""


@pytest.fixture(scope="module")
def bundled():
    return TrackingRun.open(Session.open(bundled_session("open_fist_open")), LIVE)


@pytest.fixture(scope="module")
def opening(bundled):
    return bundled.result(bundled.track(range(30), *bundled.initial()))


def test_the_bundled_session_is_followed(bundled, opening):
    """Init.json has 5 mm of noise; three cameras, 640 × 480, the hand half closed at the end."""
    off = errors_mm(opening, bundled.session.truth)
    assert off.mean() < 0.15  # measured 0.107 mm
    assert np.percentile(off, 95) < 0.35  # measured 0.25 mm
    assert off.max() < 2.0  # measured 1.37 mm
    assert (opening.status == Status.TRACKED).all()


def test_refined_together_no_joint_is_worse_by_a_tenth_of_a_millimetre(bundled, opening):
    again = bundled.with_values({"tracker.estimate": "whole"})
    refined = again.result(again.refined(opening.frames()))
    truth = bundled.session.truth
    assert errors_mm(refined, truth).mean() < errors_mm(opening, truth).mean() + 0.1
    moves = [np.diff(k.keypoints21, 2, axis=0) for k in (refined, opening)]
    assert np.linalg.norm(moves[0], axis=2).mean() < np.linalg.norm(moves[1], axis=2).mean()


def test_an_independent_hand_mesh_is_followed(tmp_path):
    """Another model's surface and joints (linear skinning), ragged masks; its joints lie elsewhere by definition."""
    folder = small_recording(tmp_path / "session", "another_hand", 5, more="")
    edit(folder / "session.toml", "forearm = false", 'forearm = "auto"')  # masks end at a cuff
    session = Session.open(folder)
    run = TrackingRun.open(session, QUICK)
    track = run.result(run.track(range(5), *run.initial()))
    assert errors_mm(track, run.session.truth).mean() < 4.5  # measured 3.5 mm
    chain = np.diff(run.session.truth.keypoints21[0][[0, 9, 10, 11, 12]], axis=0)
    length_mm = 1e3 * np.linalg.norm(chain, axis=1).sum()
    assert hand_length_mm(run.model) == pytest.approx(length_mm, rel=0.05)
    assert (track.status != Status.LOST).all()


def test_a_real_hand_on_a_desk_is_near_marks_set_by_eye(data_dir):
    """Two cameras, forearm in view, size by keypoints alone (fitting it to masks: 5.7 px, slower)."""
    session = Session.open(data_dir / "sessions" / "desk_two_view")
    run = TrackingRun.open(session, {"model.fit_size": False, **QUICK})
    track = run.result(run.track(range(18, 20), *run.initial()))
    figures: Any = compare(track, session)
    assert run.forearm
    assert figures["landmarks"] == 21
    assert figures["median_px"] < 10.5  # measured 8.4 px
    assert figures["within_20_px"] >= 0.85  # measured 0.90
    assert figures["iou_least"] > 0.85  # measured 0.886
