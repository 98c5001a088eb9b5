"""The lanes of the timeline: what stands where, zoom, and what a frame shown sends."""

import re
from dataclasses import replace

import numpy as np
import pytest

from handtrack.store.spans import Span
from handtrack_app.page.time.lanes import Window, extremes, lanes_of, whole
from handtrack_app.protocol import snapshots
from handtrack_app.protocol.snapshots import TimelineSnapshot

COUNT = 18_000


def _strip(count=COUNT, **changed):
    rng = np.random.default_rng(0)
    lanes = {
        name: rng.random(count) * size
        for name, size in ((snapshots.PROBABILITY, 1.0), (snapshots.VIEWS, 3.0), (snapshots.AT_LIMITS, 6.0), (snapshots.MOVED, 20.0), (snapshots.APART, 20.0))
    }  # fmt: skip
    terms = {name: rng.random(count) for name in ("silhouettes", "cloud→model", "keypoints")}
    strip = TimelineSnapshot(
        0, rng.integers(0, 3, count), rng.random(count), np.full(count, np.nan), (3, 700), terms, (), lanes,
        frozenset(range(100, 300)), (), (Span(1, 0, 500), Span(2, 500, count)),
    )  # fmt: skip
    return replace(strip, **changed)


def test_frames_stand_where_the_slider_has_them():
    """viser's slider has its first and its last value at its ends."""
    window = Window(100, 200)
    assert (window.place(100), window.place(150), window.place(200)) == (0.0, 500.0, 1000.0)


def test_zoomed_in_each_frame_is_told_apart():
    status = np.zeros(COUNT, int)
    status[9_000] = 2
    strip = _strip(status=status)
    window = whole(range(COUNT)).zoomed(1 / 256, 9_000, range(COUNT))
    assert window.count == 70 and window.first < 9_000 < window.last
    lane = lanes_of(strip, window, every=False)[1]
    lost = [re.findall(r"\bx='([\d.]+)'", part)[0] for part in lane.parts if "#d55e00" in part]
    (x,) = lost
    assert float(x) == pytest.approx(window.place(9_000) - window.half, abs=0.1)
    assert lane.value(9_000) == "lost" and lane.value(8_999) == "tracked"


def test_a_frame_stays_where_it_stands_while_zooming():
    window, frames = Window(0, 999), range(1000)
    for _ in range(4):
        window = window.zoomed(0.5, 300, frames)
        assert window.place(300) == pytest.approx(300, abs=15)
    assert window.zoomed(100.0, 300, frames) == whole(frames)
    assert window.zoomed(1e-9, 300, frames).count == 10


def test_the_window_goes_along_with_the_frame_shown():
    window, frames = Window(100, 199), range(1000)
    assert window.around(150, frames) is window
    assert window.around(200, frames) == Window(190, 289)
    assert window.around(999, frames) == Window(900, 999)
    assert window.around(0, frames) == Window(0, 99)


def test_extremes_of_columns_and_of_frames_that_are_not_there():
    values = np.arange(1000.0)
    values[:500] = np.nan
    place, low, high = extremes(values, 0, Window(0, 1999))
    assert len(place) == 400 and np.isnan(low[:100]).all() and np.isnan(high[200:]).all()
    assert (low[100], high[100], high[199]) == (500.0, 504.0, 999.0)
