"""What the panels say: counts in singular and plural, given frames, the energy's parts of a poor cloud."""

from dataclasses import replace

import numpy as np
import pytest

from handtrack_app.engine.document_snapshots import timeline_snapshot
from handtrack_app.engine.posing_service import pose as pose_edit
from handtrack_app.page.panels.pose import ink_on
from handtrack_app.page.panels.tracking import nearest_posed
from handtrack_app.page.time.lanes import lanes_of, lanes_picture, whole
from handtrack_app.protocol import snapshots
from handtrack_app.protocol.palette import STATUS
from tests.app.fake_run import fake_document


def _strip(**changed):
    none = np.full(4, np.nan)
    return replace(snapshots.TimelineSnapshot(10, np.full(4, -1), none, none, ()), **changed)


def timeline_picture(strip):
    frames = whole(range(strip.start, strip.start + len(strip.status)))
    return lanes_picture(lanes_of(strip, frames), strip, frames)


def test_of_frames_drawn_in_one_place_the_worst_is_seen():
    status = np.zeros(20_000, int)
    status[1234] = 2
    strip = _strip(start=0, status=status, energy=np.where(status == 2, 7.0, 1.0))
    assert STATUS[2][1] in timeline_picture(strip).partition("<svg")[2]


def test_the_error_of_a_given_pose_is_on_the_timeline(tmp_path):
    document = fake_document(tmp_path)
    moved = document.start + np.eye(26)[0] * 0.01
    document.apply(pose_edit(document, 5, moved.tolist()))
    error = timeline_snapshot(document).error_mm
    assert error[5] == pytest.approx(10.0)
    assert np.isnan(error[6])


def test_a_range_is_tracked_from_the_nearest_pose_of_its_own():
    strip = snapshots.TimelineSnapshot(
        10, np.full(20, -1), np.full(20, np.nan), np.full(20, np.nan), (15,)
    )
    assert nearest_posed(strip, 12, 25, 24) == 15, "nothing is tracked at the frame shown"
    assert nearest_posed(strip, 16, 25, 24) == 24
    assert nearest_posed(snapshots.NO_TIMELINE, 12, 25, 3) == 12
    tracked = replace(strip, status=np.where(np.arange(20) > 12, 0, -1))
    assert nearest_posed(tracked, 12, 25, 24) == 24


@pytest.mark.parametrize(
    ("ground", "ink"),
    [((240, 228, 66), "#000"), ((47, 75, 110), "#fff"), ((128, 128, 128), "#000"), ((200, 0, 0), "#fff")],
)  # fmt: skip
def test_words_on_a_colour_can_be_read(ground, ink):
    """By a contrast of 4.5 and more: of the third white has 3.9, of the last black 3.5."""
    assert ink_on(ground) == ink
