"""Takes brought back; frames between two that are kept."""

import pytest

from tests.app.engine.test_refine import bends
from tests.app.fake_run import FRAMES
from tests.app.waiting import eventually


def track(bench, first, number):
    """Track from a frame on, and wait until it is shown as a take."""
    bench.engine.track(first, FRAMES, first)
    takes = bench.layout.takes
    eventually(
        lambda: takes.chosen.options[:1] == (str(number),) and bench.state.progress.state == "idle",
    )


def test_a_take_comes_back(bench, wire):
    panel = bench.layout.takes
    track(bench, 0, 1)
    first = bends(bench.worker)
    bench.engine.set_pose(4, tuple(bench.worker.document.start + 0.05), 100)
    track(bench, 4, 2)  # the keyframe stays
    second = bends(bench.worker)
    wire.set_value(panel.chosen, "1")
    wire.set_value(panel.back, True)
    eventually(lambda: bends(bench.worker) == first)
    wire.trigger("Undo")
    eventually(lambda: bends(bench.worker) == second)


def test_frames_between_two_kept_ones_are_tracked_from_both_sides(bench, wire):
    document, tracking = bench.worker.document, bench.layout.tracking
    assert not tracking.between.visible
    for frame, by in ((2, 0.05), (9, 0.4)):
        posed = tuple(value + by * (n == 10) for n, value in enumerate(document.start))
        bench.engine.set_pose(frame, posed, 100 + frame)
    bench.go_to(2)
    eventually(lambda: tracking.between.visible)
    wire.set_value(tracking.between, True)
    eventually(lambda: set(document.results) == set(range(3, 9)))
    at = document.model.parameter_names.index("index_mcp_flex")
    for frame, kept in ((3, 2), (8, 9)):
        beside = document.results[frame].parameters[at], document.by_hand[kept][at]
        assert beside[0] == pytest.approx(beside[1]), "it begins with the kept one beside"
