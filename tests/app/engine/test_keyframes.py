"""Keyframes: poses set by hand stay, and tracking starts again from each."""

import numpy as np
import pytest

from handtrack_app.page.panels.tracking import frozen_ends
from handtrack_app.protocol import snapshots
from tests.app.desk import a_desk, pose_with
from tests.app.fake_run import FRAMES


def test_a_corrected_frame_stays_and_the_next_ones_follow_it(tmp_path):
    for worker, listener in a_desk(tmp_path, step_s=0.0):
        values = pose_with(listener, ring_pip_flex=1.0)
        worker.engine.set_pose(8, values, 1)
        listener.wait(snapshots.PoseSnapshot, lambda p: p.frame == 8)
        worker.engine.track(0, FRAMES, 3, anew=True)
        done = listener.told("Tracking finished")
        assert f"{FRAMES - 1} of {FRAMES - 1} frames" in done.text
        document = worker.document
        ring = document.model.parameter_names.index("ring_pip_flex")
        assert sorted(document.results) == [f for f in range(FRAMES) if f != 8]
        np.testing.assert_allclose(document.pose_at(8), values)
        assert document.results[9].parameters[ring] > 0.9  # tracked from the corrected pose
        assert document.results[7].parameters[ring] < 0.9


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
def test_between_which_frames(by_hand, accepted, frame, ends):
    none = np.full(12, np.nan)
    strip = snapshots.TimelineSnapshot(0, np.zeros(12, int), none, none, by_hand, marked={"accepted": frozenset(accepted)})  # fmt: skip
    assert frozen_ends(strip, frame) == ends
