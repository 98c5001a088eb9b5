"""The list of takes on the page, bringing one back, and whether all is saved."""

from typing import Any

from handtrack_app.page.panels.tracking import takes_table
from handtrack_app.protocol.snapshots import TakeCard, WorkSnapshot
from handtrack_app.workbench import Workbench
from tests.app.fake_run import FRAMES
from tests.app.waiting import eventually


def track(bench: Workbench, first: int, number: int, count: int) -> Any:
    """Track from a frame on; return frame 6."""
    bench.engine.track(first, FRAMES, first)
    takes = bench.layout.takes
    eventually(
        lambda: (
            takes.numbers[:1] == (str(number),)
            and f"{count} frames shown" in takes.list.content
            and bench.layout.progress.state == "idle"
        ),
        f"take {number}",
    )
    return six(bench)


def six(bench: Workbench) -> Any:
    return bench.worker.document.results[6].parameters.tolist()


def test_an_earlier_take_is_brought_back_on_the_page_and_that_is_undone(bench, wire):
    panel, document = bench.layout.takes, bench.worker.document
    assert panel.folder is None, "nothing was tracked"
    first = track(bench, 0, 1, FRAMES)
    posed = tuple(value + 0.05 for value in document.start)
    bench.engine.set_pose(4, posed, 100)
    second = track(bench, 4, 2, FRAMES - 5)  # the keyframe stays
    assert first != second
    wire.set_value(panel.chosen, "1")
    wire.set_value(panel.back, True)
    eventually(lambda: six(bench) == first, "brought back")
    eventually(lambda: f"{FRAMES} frames shown" in panel.list.content, "told")
    wire.set_value(bench.layout.pose.edit_buttons, "Undo")
    eventually(lambda: six(bench) == second, "undone")


def test_names_of_takes_are_text():
    cards = (TakeCard(2, "<b>x</b>", 0), TakeCard(1, "first", 1))
    table = takes_table(WorkSnapshot("saved", cards))
    assert "&lt;b&gt;x" in table and "1 frame shown" in table
