"""The queue of stretches that are worth a look."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from handtrack.diagnostics.review import probability_off, queue_words, worth_a_look
from handtrack.tracking.frame.reason import BRIEF, KINDS, SIGNS, Reason
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
    assert str(first) == "212–219, ring finger, P 0.45 off, ± 12 mm"
    assert (second.first, second.last) == (30, 31), "1.8 frames are expected to be off"


def test_parts_have_stretches_of_their_own_and_short_gaps_are_bridged():
    thumb = [off(f, "thumb", 0.5) for f in (*range(10, 18), 19, 20, 40)]
    palm = [off(f, "palm", 0.5) for f in (18, *range(21, 28))]
    found = {(s.first, s.last) for s in worth_a_look(sorted([*thumb, *palm], key=lambda f: f.frame))}  # fmt: skip
    assert found == {(10, 20), (18, 27), (40, 40)}


def test_a_few_frames_beside_others_are_seen_in_one_look():
    ring = [off(f, "ring finger", 0.6) for f in range(100, 110)]
    few = [off(98, "thumb", 0.5), off(112, "palm", 0.9), off(118, "little finger", 0.5)]
    found = worth_a_look(sorted([*ring, *few], key=lambda f: f.frame))
    assert [(s.first, s.last, s.worst) for s in found] == [(98, 118, 112)], "and what joins goes on"
    assert found[0].words.endswith("; also thumb, ring finger, little finger")
    assert found[0].expected == pytest.approx(10 * 0.6 + 1.9)
    alone = worth_a_look([off(10, "thumb", 0.5), off(12, "palm", 0.7), off(19, "thumb", 0.5)])
    assert [(s.first, s.last) for s in alone] == [(10, 12), (19, 19)]


def test_what_is_done_needs_no_look():
    frames = [off(f, "thumb", 0.5) for f in range(10)]
    assert [(s.first, s.last) for s in worth_a_look(frames, done={0, 1, 9})] == [(2, 8)]
    assert worth_a_look(frames, done=range(10)) == []


def test_a_lost_hand_is_off_and_a_body_as_probably_as_not():
    lost = Known(5, Status.LOST, Reason("unseen"), 0.2)
    assert probability_off(lost) == 1.0
    assert probability_off(Known(5)) == 0.5
    assert probability_off(Known(5, Status.TRACKED)) == 0.0
    (stretch,) = worth_a_look([lost])
    assert str(stretch) == "5, lost: not seen"


def test_the_head_of_the_queue_in_words():
    assert queue_words([]) == ""
    overlap = Known(7, reason=Reason("overlap", camera="cam1", number=0.61))
    apart = [off(20 * n, "thumb", 0.5) for n in range(1, 5)]
    words = queue_words(worth_a_look([overlap, *apart]), most=1)
    assert words == "worth a look, worst first: frames 7, cam1 overlap 0.61; 4 more."


def test_each_reason_has_brief_words():
    assert BRIEF.keys() == KINDS.keys()
    for kind in KINDS:
        brief = Reason(kind, "thumb", next(iter(SIGNS)), 0.5, 3.0).brief
        assert 0 < len(brief) < 45
