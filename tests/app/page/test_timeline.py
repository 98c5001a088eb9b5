"""Lanes and plots: what stands where, zoom, the worst of frames in one place, speed and range; the score and its ink on the card."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from handtrack.session.session_state import decide
from handtrack.store.store import Span
from handtrack.store.take import TakeFrames
from handtrack_app import protocol
from handtrack_app.engine.document_snapshots import timeline_change, timeline_snapshot
from handtrack_app.engine.posing_service import LiveScore
from handtrack_app.engine.posing_service import pose as pose_edit
from handtrack_app.page.panels.review import plot_data
from handtrack_app.page.panels.tracking import nearest_posed
from handtrack_app.page.timeline import Window, lanes_of, lanes_picture
from handtrack_app.palette import STATUS
from handtrack_app.protocol import COST, ERROR, TERM, Curve, CurvesSnapshot, ScoreSnapshot
from tests.app.fake_run import fake_document
from tests.app.opened import opened, posed, tracked
from tests.app.page.test_review_panel import _tracked
from tests.app.waiting import eventually


def test_a_frame_stays_where_it_stands_while_zooming():
    window = whole = Window.whole(range(1000))
    for _ in range(4):
        window = window.zoomed(0.5, 300)
        assert window.place(300) == pytest.approx(300, abs=15)
    assert window.zoomed(100.0, 300) == whole
    assert window.zoomed(1e-9, 300).count == 10


def test_the_window_goes_along_with_the_frame_shown():
    window = Window(100, 199, range(1000))
    assert window.around(150) is window
    for frame, first in ((200, 190), (999, 900), (0, 0)):
        assert window.around(frame) == replace(window, first=first, last=first + 99)


def test_of_frames_drawn_in_one_place_the_worst_is_seen():
    status = np.zeros(20_000, int)
    status[1234] = 2
    lanes = {COST: np.where(status == 2, 7.0, 1.0)}
    strip, window = protocol.TimelineSnapshot(0, status, lanes), Window.whole(range(len(status)))
    picture = lanes_picture(lanes_of(strip, window, True), strip, window, True)
    assert STATUS[2][1] in picture.partition("<svg")[2]


def test_a_range_is_tracked_from_the_nearest_pose_of_its_own():
    strip = protocol.TimelineSnapshot(10, np.full(20, -1), {}, (15,))
    assert nearest_posed(strip, 12, 25, 24) == 15, "nothing is tracked at the frame shown"
    assert nearest_posed(strip, 16, 25, 24) == 24
    assert nearest_posed(replace(strip, by_hand=()), 12, 25, 3) == 12
    tracked = replace(strip, status=np.where(np.arange(20) > 12, 0, -1))
    assert nearest_posed(tracked, 12, 25, 24) == 24


def test_a_plot_has_track_band_and_truth_in_the_window_alone():
    values = np.linspace(0, 1, 300)
    curve = Curve("index_mcp_flex", values, np.full(300, 0.05), values - 0.1)
    data = plot_data(curve, Window(100, 199, range(300)))
    assert (data["frame"][0], data["frame"][-1]) == (100, 199)
    assert_allclose(data["track"], np.rad2deg(values[100:200]))
    assert_allclose(data["high"] - data["track"], np.rad2deg(0.1))
    assert_allclose(data["track"] - data["low"], np.rad2deg(0.1))
    assert_allclose(data["track"] - data["truth"], np.rad2deg(0.1))


def test_the_tab_plots_the_angles_of_a_finger(bench, wire):
    panel = bench.layout.plots
    _tracked(bench)
    wire.set_value(panel.group, "Index")
    eventually(lambda: len(panel.plots) == 4)
    assert np.isfinite(panel.plots[0].data[1]).any()
    before = panel.plots[0].data
    panel.show(CurvesSnapshot(tuple(replace(c, values=c.values + 1.0) for c in panel.curves)))
    assert (panel.plots[0].data[1] > before[1]).all()  # the same joints, as they are now
    bench.layout.timeline.look_closer("+")
    eventually(lambda: len(panel.plots[0].data[0]) < len(before[0]))
    wire.set_value(panel.group, "Thumb")
    eventually(lambda: "humb" in (panel.plots[0].title or ""))


def test_the_card_has_the_score_of_its_own_pose_alone(bench):
    panel = bench.layout.pose
    pose = panel.pose
    eventually(lambda: panel.score)  # it has rested: no other score comes between
    six = {camera: ord(camera) / 100 for camera in "fedcba"}
    own = ScoreSnapshot(pose.frame, tuple(pose.values), six, {})
    for score in (replace(own, frame=7), replace(own, values=(0.0,)), own):
        panel.show_score(score)
        assert ("overlap" in panel.card.content) == (score is own)
    assert ">a\u00a00.97, b\u00a00.98, c\u00a00.99<" in panel.card.content  # the lowest


def test_the_engine_scores_the_pose_that_is_shown(tmp_path, left_open):
    store, told = tracked(opened(tmp_path)), []
    document = store.document
    live = LiveScore(document, told.append)
    assert not live.is_due, "nothing was shown yet"
    posed(store, 5, by=0.05)
    document.show(5)
    live.since = 0.0
    live.report()
    (found,) = told
    assert (found.frame, found.values) == (5, tuple(document.shown.tolist()))
    assert not live.is_due
    live.since = float("inf")  # it has not rested
    assert live.is_due, "what was seen of this frame is at hand"


def test_a18_what_is_told_of_the_timeline_adds_up_to_the_whole(tmp_path):
    document = fake_document(tmp_path)
    take = TakeFrames(document.run.labels)
    document.takes.put(1, take)
    document.apply(decide(spans=(Span(1, 0, len(document.frames)),)))
    strip = timeline_snapshot(document)
    result = document.run._result  # type: ignore[attr-defined]
    document.apply(pose_edit(document, 5, (document.start + 0.01 * np.eye(26)[0]).tolist()))
    for frame in (3, 4, 5, 4):
        take.put(replace(result(frame, document.model.rest_params(), 0), energies={"rest": 2.0}), None)  # fmt: skip
        strip = timeline_change(document).over(strip)
    whole = timeline_snapshot(document)
    assert_array_equal(strip.status, whole.status)
    assert {COST, ERROR, f"{TERM}priors"} <= set(whole.lanes)
    for name, row in whole.lanes.items():
        assert_array_equal(strip.lanes[name], row)
    assert whole.lanes[ERROR][5] == pytest.approx(10.0), "of the pose that is given [mm]"
    assert np.isnan(whole.lanes[ERROR][6])
    other = replace(timeline_change(document), frames=range(99))
    assert other.over(strip) is strip, "of a recording that is counted anew meanwhile"
