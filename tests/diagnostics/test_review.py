"""The queue of stretches that are worth a look."""

from dataclasses import dataclass

import pytest

from handtrack.diagnostics.review import worth_a_look
from handtrack.tracking.frame.reason import Reason
from handtrack.tracking.frame.result import Status


@dataclass(frozen=True)
class Known:
    frame: int
    status: Status = Status.DOUBTFUL
    reason: Reason | None = None
    p_off_25mm: float = float("nan")


def off(frame: int, part: str, probability: float) -> Known:
    reason = Reason("off", part, "outline", 12.0, probability)
    return Known(frame, Status.DOUBTFUL, reason, probability)


def test_most_frames_off_come_first_with_reason_and_size():
    ring = [off(f, "ring finger", 0.4 + 0.05 * (f == 215)) for f in range(212, 220)]
    thumb = [off(f, "thumb", 0.9) for f in (30, 31)]
    fine = [Known(f, Status.TRACKED, None, 0.1) for f in range(100, 110)]
    first, second = worth_a_look([*thumb, *fine, *ring])
    assert (first.first, first.last, first.worst) == (212, 219, 215)
    assert first.expected == pytest.approx(8 * 0.4 + 0.05)
    assert str(first) == "212–219, ring finger, P(error > 25 mm) 0.45, ± 12 mm"
    assert (second.first, second.last) == (30, 31), "1.8 frames are expected to be off"


def test_parts_have_stretches_of_their_own_and_short_gaps_are_bridged():
    thumb = [off(f, "thumb", 0.5) for f in (*range(10, 18), 19, 20, 40)]
    palm = [off(f, "palm", 0.5) for f in (18, *range(21, 28))]
    found = {(s.first, s.last) for s in worth_a_look(sorted([*thumb, *palm], key=lambda f: f.frame))}  # fmt: skip
    assert found == {(10, 20), (18, 27), (40, 40)}


def test_what_is_done_needs_no_look():
    frames = [off(f, "thumb", 0.5) for f in range(10)]
    assert [(s.first, s.last) for s in worth_a_look(frames, done={0, 1, 9})] == [(2, 8)]
    assert worth_a_look(frames, done=range(10)) == []
