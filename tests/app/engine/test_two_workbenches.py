"""Two programs on one session: the second looks on, says who writes, and destroys nothing."""

import os
from functools import partial

import pytest

from handtrack import HandtrackError
from handtrack_app.engine.persistence import Persistence
from tests.app.command_line import listing
from tests.app.fake_run import fake_document
from tests.app.opened import opened, posed


def test_a2_c43_the_second_sees_all_and_writes_nothing_until_it_takes_over(tmp_path):
    first = opened(tmp_path)
    posed(first, 5)
    second = opened(tmp_path)
    assert f"`handtrack open` (process {os.getpid()}" in second.warning
    assert sorted(second.document.by_hand) == [5]
    before = listing(tmp_path)
    posed(second, 7)
    for save in (
        second.save_first_pose,
        partial(second.save_settings, "setting"),
        second.save_track,
    ):
        with pytest.raises(HandtrackError):
            save()
    second.close()
    assert listing(tmp_path) == before
    third = Persistence.open(fake_document(tmp_path), take_over=True)
    third.restore()
    assert third.warning == ""
    posed(third, 8)
    for left in (lambda: posed(first, 9), first.close):
        with pytest.raises(HandtrackError):
            left()
    third.close()
    last = opened(tmp_path)
    assert sorted(last.document.by_hand) == [5, 8]
    last.close()
