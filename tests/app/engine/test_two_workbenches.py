"""Two programs on one session: the second looks on, says who writes, and destroys nothing."""

import os

import pytest

from handtrack import HandtrackError
from handtrack_app.engine.store import saving
from handtrack_app.engine.store.persistence import Persistence
from tests.app.command_line import listing
from tests.app.fake_run import fake_document
from tests.app.opened import opened, posed


def test_a2_the_second_sees_all_and_writes_nothing(tmp_path):
    first = opened(tmp_path)
    posed(first, 5)
    second = opened(tmp_path)
    assert f"by `handtrack open` (process {os.getpid()} on " in second.warning
    assert sorted(second.document.by_hand) == [5]
    before = listing(tmp_path)
    posed(second, 7)
    for save in (saving.save_first_pose, saving.save_settings, saving.save_track):
        with pytest.raises(HandtrackError):
            save(second)
    second.close()
    assert listing(tmp_path) == before
    posed(first, 8)
    first.close()
    third = opened(tmp_path)
    assert sorted(third.document.by_hand) == [5, 8]
    third.close()


def test_c43_a_second_workbench_that_takes_over_writes_and_the_first_is_told(
    tmp_path,
):
    first = opened(tmp_path)
    posed(first, 5)
    second = Persistence.open(fake_document(tmp_path), take_over=True)
    second.restore()
    assert second.warning == ""
    posed(second, 7)
    with pytest.raises(HandtrackError):
        posed(first, 8)
    with pytest.raises(HandtrackError):
        first.close()
    second.close()
    third = opened(tmp_path)
    assert sorted(third.document.by_hand) == [5, 7]
    third.close()
