"""Whole sequences against their truth: the bundled session, an independent hand, and a real one."""

from typing import Any

import numpy as np
import pytest

from handtrack import Session, Status, TrackingRun, bundled_session, evaluate
from handtrack.model.size import hand_length_mm
from handtrack.session.truth import Truth
from tests.app.command_line import small_recording
from tests.benchmarks.desk_two_view import compare
from tests.session.small_session import edit
from tests.tracking.scenes import QUICK


def scores(track, truth):
    """Return the measures of the recording's first frames, which were tracked."""
    own = slice(len(track))
    return evaluate(track, Truth(truth.frame[own], None, truth.keypoints21[own], (), None))


def test_the_bundled_session_is_followed():
    """Init.json has 5 mm of noise; three cameras, 640 × 480, the hand half closed at the end."""
    bundled = TrackingRun.open(
        Session.open(bundled_session("open_fist_open")), {"tracker.estimate": "forward"}
    )
    opening = bundled.result(bundled.track(range(30), *bundled.initial()))
    off = scores(opening, bundled.session.truth)
    assert off["mpjpe_mm"] < 0.15  # measured 0.107
    assert off["max_mm"] < 2.0  # measured 1.37
    assert (opening.status == Status.TRACKED).all()


def test_an_independent_hand_mesh_is_followed(tmp_path):
    """Another model's surface and joints (linear skinning), ragged masks; its joints lie elsewhere by definition."""
    folder = small_recording(tmp_path / "session", "another_hand", 5, more="")
    edit(folder / "session.toml", "forearm = false", 'forearm = "auto"')  # masks end at a cuff
    session = Session.open(folder)
    run = TrackingRun.open(session, QUICK)
    track = run.result(run.track(range(5), *run.initial()))
    assert scores(track, session.truth)["mpjpe_mm"] < 4.5  # measured 3.5 mm
    chain = np.diff(session.truth.keypoints21[0][[0, 9, 10, 11, 12]], axis=0)
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
    assert figures["median_px"] < 10.5  # measured 8.4 px
    assert figures["within_20_px"] >= 0.85  # measured 0.90
    assert figures["iou_least"] > 0.85  # measured 0.886
