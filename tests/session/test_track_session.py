"""One tracking for all clients: events, fixed poses, cancelling, resuming."""

import re
from types import SimpleNamespace
from typing import cast

import pytest

from handtrack import (
    FrameResult,
    Session,
    TrackingRequest,
    TrackingRun,
    load_model,
    track_session,
)
from handtrack.session.track_session import SizeFitted, tracking_segments
from tests.app.command_line import small_recording


def test_a_hand_that_was_sized_on_opening_is_not_sized_again(tmp_path):
    folder = small_recording(tmp_path / "session", frames=3)
    file = folder / "session.toml"
    file.write_text(re.sub(r"scale = .*", 'scale = "fit"', file.read_text()))
    session = Session.open(folder)
    sized = TrackingRun.open(session)
    unsized = TrackingRun.open(session, {"model.fit_size": "false"})
    assert sized.scale != unsized.scale
    *events, end = track_session(sized)
    assert not any(isinstance(one, SizeFitted) for one in events)
    *events, expected = track_session(unsized.with_values({"model.fit_size": "true"}))
    assert any(isinstance(one, SizeFitted) for one in events)
    assert end.track.parameters.tobytes() == expected.track.parameters.tobytes()


def _segments(frames, first, fixed=(), guides=(), both_ends=False):
    """Return where segments begin and end, from which frame they go, and the frame whose pose they start from (0: the start)."""
    model = load_model("hand26")

    def pose(frame):
        values = model.rest.copy()
        values[0] = frame
        return values

    run = cast("TrackingRun", SimpleNamespace(model=model))
    posed = {frame: cast("FrameResult", SimpleNamespace(parameters=pose(frame))) for frame in fixed}
    led = {frame: pose(frame) for frame in guides}
    request = TrackingRequest(frames, first, pose(0), posed, led, both_ends)
    return [
        (frames.start, frames.stop, first, float(params[0]))
        for first, params, frames in tracking_segments(run, request)
    ]


@pytest.mark.parametrize(
    ("first", "fixed", "expected"),
    [
        (3, (), [(0, 12, 3, 0)]),
        (3, (7,), [(0, 7, 3, 0), (8, 12, 8, 7)]),
        (5, (1, 8), [(2, 8, 5, 0), (9, 12, 9, 8), (0, 1, 0, 1)]),
        (3, (3, 4, 6), [(0, 3, 2, 3), (5, 6, 5, 4), (7, 12, 7, 6)]),
        (1, (1, 11), [(2, 11, 2, 1), (0, 1, 0, 1)]),
        (3, (40,), [(0, 12, 3, 0)]),
    ],
)
def test_each_fixed_frame_starts_a_segment(first, fixed, expected):
    assert _segments(range(12), first, fixed) == expected


def test_between_fixed_frames_half_is_tracked_from_each():
    assert _segments(range(2, 10), 2, (2, 9), both_ends=True) == [(3, 6, 3, 2), (6, 9, 8, 9)]
    assert _segments(range(2, 5), 2, (2, 4), both_ends=True) == [(3, 4, 3, 2)]
    halves = _segments(range(2, 10), 2, (2,), (8,), both_ends=True)
    assert [segment[:2] for segment in halves] == [(3, 6), (6, 8), (8, 10)]
