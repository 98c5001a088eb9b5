"""Keyframes: poses set by hand stay, and tracking starts again from each."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from handtrack_app.page.panels.tracking import frozen_ends, keyframe_words, odd_frames
from handtrack_app.protocol import snapshots
from tests.app.engine.test_worker import _desk, _pose
from tests.app.fake_run import FRAMES


def test_a_corrected_frame_stays_and_the_next_ones_follow_it(tmp_path: Path) -> None:
    for worker, listener in _desk(tmp_path, step_s=0.0):
        values = _pose(listener, ring_pip_flex=1.0)
        worker.engine.set_pose(8, values, 1)
        listener.wait(snapshots.PoseSnapshot, lambda p: p.frame == 8)
        worker.engine.track(0, FRAMES, 3, anew=True)
        done = listener.wait(snapshots.Notice, lambda n: n.title == "Tracking finished")
        assert f"{FRAMES - 1} of {FRAMES - 1} frames" in done.text
        assert done.text.endswith("One, set by hand or detected, is unchanged.")
        document = worker.document
        assert document is not None
        ring = document.model.parameter_names.index("ring_pip_flex")
        assert sorted(document.results) == [f for f in range(FRAMES) if f != 8]
        np.testing.assert_allclose(document.pose_at(8), values)
        assert document.results[9].parameters[ring] > 0.9  # tracked from the corrected pose
        assert document.results[7].parameters[ring] < 0.9


def test_tracking_from_a_corrected_frame_leaves_it(tmp_path: Path) -> None:
    for worker, listener in _desk(tmp_path, step_s=0.0):
        values = _pose(listener, ring_pip_flex=1.0)
        worker.engine.set_pose(8, values, 1)
        worker.engine.track(8, FRAMES, 8)
        listener.wait(snapshots.Notice, lambda n: n.title == "Tracking finished")
        document = worker.document
        assert document is not None
        assert sorted(document.results) == list(range(9, FRAMES))
        np.testing.assert_allclose(document.by_hand[8], values)


def test_fitting_one_frame_replaces_what_was_set_by_hand(tmp_path: Path) -> None:
    for worker, listener in _desk(tmp_path, step_s=0.0):
        worker.engine.set_pose(8, _pose(listener, ring_pip_flex=1.0), 1)
        worker.engine.track(8, 9, 8)
        listener.wait(snapshots.Notice, lambda n: n.title == "Frame 8 is fitted")
        document = worker.document
        assert document is not None and not document.by_hand and 8 in document.results


def test_frames_that_are_all_set_by_hand_are_not_tracked(tmp_path: Path) -> None:
    for worker, listener in _desk(tmp_path, step_s=0.0):
        for frame in (4, 5):
            worker.engine.set_pose(frame, _pose(listener, ring_pip_flex=1.0), frame)
            listener.wait(snapshots.PoseSnapshot, lambda p, frame=frame: p.version == frame)
        worker.engine.track(4, 6, 4)
        assert (
            "nothing to track" in listener.wait(snapshots.Notice, lambda n: n.level == "error").text
        )


def test_the_page_names_keyframes_and_leads_to_doubtful_frames() -> None:
    status = np.array([0, 1, 0, 2, 1, -1])
    none = np.full(6, np.nan)
    strip = snapshots.TimelineSnapshot(10, status, none, none, (14,))
    assert odd_frames(strip) == [11, 13]
    assert "Frame 14 set by hand. Tracking leaves it, and starts again from it." in keyframe_words(
        strip.by_hand
    )
    assert "and 3 more" in keyframe_words(tuple(range(15)))
    both = keyframe_words((2, 5, 7), (5,))
    assert "Frames 2, 7 set by hand; " in both
    assert "Frame 5 found. Tracking leaves them, and starts again from each." in both


@pytest.mark.parametrize(
    ("by_hand", "accepted", "frame", "ends"),
    [
        ((2,), {8}, 5, (2, 8)),
        ((2,), {8}, 2, (2, 8)),
        ((2,), {8}, 8, None),
        ((2, 3), set(), 2, None),
        ((), set(), 4, None),
    ],
)
def test_between_which_frames(by_hand, accepted, frame, ends) -> None:
    none = np.full(12, np.nan)
    strip = snapshots.TimelineSnapshot(0, np.zeros(12, int), none, none, by_hand, accepted=frozenset(accepted))  # fmt: skip
    assert frozen_ends(strip, frame) == ends
