"""The review queue on the page: next, previous, accept by button and key; frames accepted are said to be."""

from dataclasses import replace
from functools import partial

import numpy as np

from handtrack.diagnostics.review import ReviewInterval
from handtrack.tracking.whole.refinement import CameraError
from handtrack_app.protocol import Notice, TimelineSnapshot
from tests.app.desk import shown
from tests.app.fake_run import FRAMES, fake_document
from tests.app.waiting import eventually
from tests.app.wire import WireClient


def _tracked(bench):
    bench.engine.track(0, FRAMES, 3)
    eventually(lambda: len(bench.layout.review.intervals) == 1, "frame 7 is doubtful")
    eventually(lambda: bench.state.progress.state == "idle")


def test_a_doubtful_frame_is_gone_to_accepted_and_let_go(bench, wire):
    review, state, document = bench.layout.review, bench.state, bench.worker.document
    assert "Track some frames" in review.head.content
    _tracked(bench)
    assert review.rows[0].visible and review.rows[0].label == "7, low confidence"
    eventually(lambda: "<img" in review.cards[0].content)
    wire.set_value(review.go, "Next")
    eventually(lambda: state.frame == 7)
    wire.set_value(review.accept, "Interval")
    eventually(lambda: document.accepted == {7})
    eventually(lambda: not review.intervals and "No frames" in review.head.content)
    eventually(lambda: "and locked" in review.here.content)
    assert "Accepted" in bench.layout.pose.card.content
    wire.set_value(review.release, "Frame")
    eventually(lambda: not document.accepted and len(review.intervals) == 1)
    wire.set_value(review.accept, "All confident")
    eventually(lambda: document.accepted == {*range(FRAMES)} - {7})
    wire.trigger("Undo")
    eventually(lambda: not document.accepted)


def test_what_is_found_out_about_a_recording_stays_until_it_is_tracked_anew(bench):
    about = bench.layout.review.about
    notice = Notice("warning", "", "camera 'left' contradicts the others", of_recording=True)
    for _ in range(2):
        bench.page.show(notice)
    assert about.content.count("contradicts") == 1
    bench.engine.track(3, 4, 3)
    eventually(lambda: bench.state.strip.status[3] >= 0)
    assert "contradicts" in about.content
    _tracked(bench)
    assert not about.content


def test_cameras_that_are_surely_off_are_corrected_by_one_button_and_undo_takes_it_back(tmp_path):
    off = CameraError("side", (0.0, 2.0, 0.0), (0.0, 0.0, 0.0), 0.0, 0.0, (0.1,) * 9)
    other = replace(off, name="front", turn_deg=(1.0, 0.0, 0.0))
    opener = partial(fake_document, step_s=0.0, refined_by=0.1, refined_cameras=(other, off))
    with shown(tmp_path, opener=opener) as bench, WireClient(bench.url) as client:
        review, undo = bench.layout.review, bench.layout.pose.edit_buttons
        frustum = bench.stage.cameras.frusta["side"]
        calibrated = np.array(frustum.wxyz)
        states = lambda: (  # noqa: E731
            review.restore.visible,
            not review.correct.visible,
            not np.allclose(frustum.wxyz, calibrated),
        )
        bench.engine.track(0, FRAMES, 3)
        eventually(lambda: review.correct.visible and "front" in review.off.content)
        assert "rotation 2.00° (± 0.10)" in review.off.content
        for pressed, value, corrected in (
            (review.correct, True, True),
            (review.restore, True, False),
            (undo, "Undo", True),
            (undo, "Undo", False),
        ):
            client.set_value(pressed, value)
            eventually(lambda corrected=corrected: states() == (corrected,) * 3)
        assert set(review.strip.cameras_off) == {"front", "side"}, "one step of undo"


def _card(first, last):
    return ReviewInterval(first, last, first, 1.0, "thumb", "the thumb may be off <b>")


def test_the_queue_goes_on_and_around(bench):
    _tracked(bench)
    review, state = bench.layout.review, bench.state
    strip = review.strip
    cards = (_card(5, 6), _card(1, 3), _card(9, 9))
    bench.layout.show_timeline(TimelineSnapshot(0, strip.status, strip.lanes, intervals=cards))
    seen = []
    for by in (1, 1, 1, 1, -1, -1):
        review.step(by)
        eventually(lambda: bench.stage.pose.frame == state.frame == cards[review.at].worst)
        seen.append(state.frame)
    assert seen == [5, 1, 9, 5, 9, 1]
    assert review.current == cards[1]
    state.frame = 4
    assert review.current is None, "that frame is in no stretch"
