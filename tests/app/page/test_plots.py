"""Plots: names of parameters, speed and range, what is plotted, the tab."""

import numpy as np

from handtrack_app.page.panels.plots import plot_data, range_and_speed, speed_of
from handtrack_app.page.time.lanes import Window
from handtrack_app.protocol.snapshots import Curve, CurvesSnapshot
from tests.app.page.test_review_panel import _tracked
from tests.app.waiting import eventually


def test_range_of_motion_and_speed():
    values = np.array([0.0, 10.0, np.nan, 5.0, 5.0, 8.0])
    assert range_and_speed(values, 10.0) == (0.0, 10.0, 100.0, 30.0)
    np.testing.assert_allclose(speed_of(values, 10.0), [100, 100, np.nan, 0, 15, 30])
    assert range_and_speed(np.array([1.0, np.nan, 2.0]), 10.0) is None


def _snapshot(count=300):
    values = np.linspace(0, 1, count)
    curve = Curve("index_mcp_flex", values, np.full(count, 0.05), values + 0.1, values - 0.1)  # fmt: skip
    return CurvesSnapshot(0, 30.0, (curve,), 3)


def test_a_plot_has_track_band_other_take_and_truth_in_the_window_alone():
    data = plot_data(snapshot := _snapshot(), snapshot.curves[0], Window(100, 199), False)
    assert (data["frame"][0], data["frame"][-1]) == (100, 199)
    np.testing.assert_allclose(data["track"], np.rad2deg(np.linspace(0, 1, 300)[100:200]))
    np.testing.assert_allclose(data["high"] - data["track"], np.rad2deg(0.1))
    np.testing.assert_allclose(data["track"] - data["low"], np.rad2deg(0.1))
    np.testing.assert_allclose(data["take 3"] - data["truth"], np.rad2deg(0.2))


def test_the_tab_plots_the_angles_of_a_finger(bench, wire):
    panel = bench.layout.plots
    _tracked(bench)
    wire.set_value(panel.group, "Index")
    eventually(lambda: len(panel.plots) == 4, "plotted")
    assert np.isfinite(panel.plots[0].data[1]).any()
    before = panel.plots[0].data
    bench.layout.timeline.look_closer("+")
    eventually(lambda: len(panel.plots[0].data[0]) < len(before[0]), "the timeline's window")
    wire.set_value(panel.group, "Thumb")
    eventually(lambda: "humb" in (panel.plots[0].title or ""), "another finger")
