"""The review queue on the page: next, previous, accept by button and key; frames accepted are said to be."""

import numpy as np

from handtrack.diagnostics.review import Stretch
from handtrack_app.page.panels.review import undoubted
from handtrack_app.protocol.snapshots import Notice, TimelineSnapshot
from handtrack_app.workbench import Workbench
from tests.app.fake_run import FRAMES
from tests.app.waiting import eventually


def _tracked(bench: Workbench) -> None:
    bench.engine.track(0, FRAMES, 3)
    eventually(lambda: len(bench.layout.review.stretches) == 1, "frame 7 is doubtful")
    eventually(lambda: bench.layout.progress.state == "idle", "all are tracked")


def test_a_doubtful_frame_is_gone_to_accepted_and_let_go(bench, wire):
    review, state, document = bench.layout.review, bench.state, bench.worker.document
    assert "Track some frames" in review.head.content
    _tracked(bench)
    assert review.rows[0].visible and review.rows[0].label == "7, low confidence"
    wire.set_value(review.go, "Next")
    eventually(lambda: state.frame == 7, "gone to")
    wire.set_value(review.accept, "Interval")
    eventually(lambda: document.accepted == {7}, "accepted")
    eventually(lambda: not review.stretches and "No frames" in review.head.content, "done")  # fmt: skip
    eventually(lambda: "and locked" in review.here.content, "said so")
    assert "Accepted" in bench.layout.pose.card.content
    wire.set_value(review.accept, "All confident")
    eventually(lambda: len(document.accepted) == FRAMES, "all")
    wire.set_value(review.release, "Frame")
    eventually(lambda: 7 not in document.accepted and len(review.stretches) == 1, "let go")
    wire.set_value(bench.layout.pose.edit_buttons, "Undo")
    eventually(lambda: len(document.accepted) == FRAMES, "undone")


def test_what_is_found_out_about_a_recording_stays_until_it_is_tracked_anew(bench):
    about = bench.layout.review.about
    notice = Notice("warning", "", "camera 'left' contradicts the others", of_recording=True)
    for _ in range(2):
        bench.page.show(notice)
    assert about.content.count("contradicts") == 1
    bench.engine.track(3, 4, 3)
    eventually(lambda: bench.layout.timeline.strip.status[3] >= 0, "one frame is fitted")
    assert "contradicts" in about.content
    _tracked(bench)
    assert not about.content


def _card(first: int, last: int, brief: str = "thumb") -> Stretch:
    return Stretch(first, last, first, 1.0, brief, "the thumb may be off <b>")


def test_the_queue_goes_on_and_around(bench):
    _tracked(bench)
    review, state = bench.layout.review, bench.state
    strip = review.strip
    cards = (_card(5, 6), _card(1, 3), _card(9, 9))
    review.show_timeline(TimelineSnapshot(0, strip.status, strip.energy, strip.error_mm, (), stretches=cards))  # fmt: skip
    seen = []
    for by in (1, 1, 1, 1, -1, -1):
        review.step(by)
        eventually(lambda: bench.stage.pose.frame == state.frame == cards[review.at].worst, "shown")
        seen.append(state.frame)
    assert seen == [5, 1, 9, 5, 9, 1]
    assert review.current == cards[1]
    state.frame = 4
    assert review.current is None, "that frame is in no stretch"


def test_what_is_not_doubted():
    none = np.full(8, np.nan)
    strip = TimelineSnapshot(10, np.array([0, 0, 1, 0, 2, -1, 0, 1]), none, none, (17,))
    assert undoubted(strip) == [(10, 11), (13, 13), (16, 17)]
    assert undoubted(None) == []
