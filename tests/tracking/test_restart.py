"""Recovery: a lost hand is found again, and nothing else ever changes."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from handtrack import (
    Observation,
    PointCloud,
    Status,
    Tracker,
    TrackerSettings,
    TrackerState,
    load_model,
)
from handtrack.simulation.scenes.simulated_views import mask_views
from handtrack.simulation.simulate import simulated_rig
from handtrack.tracking.frame.control import Control, Round, Search
from handtrack.tracking.search import engine
from handtrack.tracking.search.engine import Candidate, improved
from handtrack.tracking.search.global_search import LOST_HAND, GlobalObjective, why_hand_may_be_lost
from tests.tracking.scenes import Told, joints_seen, off_mm, on_surface, posed

MODEL = load_model()
RIG = simulated_rig(3, (320, 240))
PLAIN = TrackerSettings().with_values({"tracker.recovery": False})
JUMPS = PLAIN.with_values({"tracker.recovery": True})
STOOD = posed(MODEL, "rest")


def first_of(seen):
    """Return the result of a first frame."""
    return Tracker(MODEL, PLAIN).step(TrackerState.beginning_at(STOOD), seen)[1]


@pytest.fixture(scope="module")
def known():
    """The result of a frame that was tracked."""
    return first_of(mask_views(MODEL, STOOD, RIG.cameras))


@pytest.mark.parametrize("by", ["masks", "cloud"])
def test_a_hand_that_moved_on_unseen_is_found_again(rng, by):
    """Faults C32, C33. Further away than clouds are cropped: without jumps not one point is looked at."""
    truth = posed(MODEL, "open", (0.2, 0.3, 0.0))
    truth[:3] += (0.15, 0.05, 0.1)

    def observation_of(params, frame):
        if by == "masks":
            return mask_views(MODEL, params, RIG.cameras, frame)
        points, _ = on_surface(MODEL, params, 2500, rng)
        return Observation(frame, frame / 25.0, cloud=PointCloud(points))

    first = first_of(observation_of(STOOD, 0))
    seen = observation_of(truth, 1)
    after = TrackerState.resumed([first])
    plain, jumps = (Tracker(MODEL, s).step(after, seen)[1] for s in (PLAIN, JUMPS))
    assert plain.status == Status.LOST
    assert jumps.status == Status.TRACKED
    assert off_mm(jumps, MODEL, truth).mean() < 2.0


def searched_for(known, seen):
    """Return the result of the frame after a known one, and in which situations something was looked for."""
    told = Told()
    _, result = Tracker(MODEL, JUMPS).step(
        TrackerState.resumed([known]), seen, Control(observer=told)
    )
    return result, [report.search.situation for report in told]


@pytest.mark.parametrize("spoil", [np.ones_like, lambda mask: 1 - mask], ids=["white", "inverted"])
def test_masks_that_outline_nothing_are_not_searched_and_the_frame_says_so(known, spoil):
    good = mask_views(MODEL, STOOD, RIG.cameras, 1)
    spoilt = [replace(one, mask=spoil(one.mask)) for one in good.silhouettes]
    seen = replace(good, silhouettes=tuple(spoilt))
    result, searched = searched_for(known, seen)
    assert result.status == Status.LOST
    assert result.reason.kind == "filled mask"
    assert LOST_HAND.situation not in searched
    assert GlobalObjective.of(seen, JUMPS) is None
    some = GlobalObjective.of(replace(good, silhouettes=(*good.silhouettes[:2], spoilt[2])), JUMPS)
    assert [len(source.whole) for source in some.sources] == [2]


@pytest.mark.parametrize("box", [(), np.s_[20:100, 200:280]])
def test_neither_a_ball_nor_what_fits_no_hand_is_taken_for_the_hand(known, box):
    """A ball, and the same box in all images; the hand itself is nowhere."""
    ball = load_model("ball6")
    place = ball.rest_params() + np.r_[STOOD[:3] + (0.2, 0.05, 0.1), 0.0, 0.0, 0.0]
    seen = mask_views(ball, place, RIG.cameras, 1)
    for one in seen.silhouettes if box else ():
        one.mask[:] = 0.0
        one.mask[box] = 1.0
    result, searched = searched_for(known, seen)
    assert LOST_HAND.situation in searched
    assert result.status == Status.LOST


def test_a_hand_whose_joints_two_cameras_see_there_is_not_lost_nor_looked_for(known, monkeypatch):
    monkeypatch.setattr(engine, "run_rounds", lambda *_, **__: [])  # what a search finds takes long
    good = mask_views(MODEL, STOOD, RIG.cameras, 1)
    beside = np.zeros_like(good.silhouettes[0].mask)
    beside[:80, :100] = 1.0  # something else of skin's colour
    spoilt = tuple(replace(one, mask=np.maximum(one.mask, beside)) for one in good.silhouettes)
    joints = joints_seen(RIG.cameras, MODEL.keypoints21(MODEL.bones(STOOD)))
    for cameras, status in ((1, Status.LOST), (2, Status.DOUBTFUL)):
        seen = replace(good, silhouettes=spoilt, keypoints=joints[:cameras])
        result, searched = searched_for(known, seen)
        assert result.status == status
        assert (LOST_HAND.situation in searched) == (status == Status.LOST)


@pytest.mark.parametrize(
    ("said", "expected"),
    [
        ("d" * 33, [1, 2, 4, 8, 16, 32]),
        ("dddtddd", [1, 2, 5, 6]),  # a frame that fits begins the row anew
        ("dddud", [1, 2, 4, 5]),  # so does one in which nothing was seen
        ("u" * 12, [1, 2, 4, 5, 8, 10]),  # of which every fifth is looked at as well
    ],
)
def test_a_row_of_doubts_is_tried_ever_more_rarely(said, expected):
    """Of a row of frames after one that is tracked. t: tracked, d: in doubt, u: nothing seen."""
    kinds = {"t": (True, 1.0), "d": (False, 1.0), "u": (False, np.nan)}
    frames = [SimpleNamespace(fits=kinds[k][0], energy=kinds[k][1], clutters=False, note="") for k in "t" + said]  # fmt: skip
    due = [n for n in range(1, len(frames)) if why_hand_may_be_lost(frames[n], frames[:n])]
    assert due == expected


def candidate(x):
    return Candidate(MODEL, np.array([x]), abs(x - 3.0))


def grid(line, found, most):
    return [candidate(x) for x in (0.0, 1.0, 2.5, 2.6)]


def line(told=Told()):
    """Return an objective in one number: the cost is its distance from 3."""
    return SimpleNamespace(
        control=Control(observer=told),
        distinct=lambda found, most: sorted(found, key=lambda c: c.cost)[:most],
    )


def places(found):
    return [c.params[0] for c in found]


def test_a_pose_is_taken_only_where_it_is_better_by_the_rows_gain():
    rounds = (Round(((grid, 0),), keep=0),)
    for factor, margin, start, taken in (
        (1.0, 1.0, 4.3, False), (1.0, 1.0, 4.5, True), (0.5, 0.0, 3.7, False), (0.5, 0.0, 3.9, True),
    ):  # fmt: skip
        search = Search("", "", rounds, "", factor=factor, margin=margin)
        standing, told = candidate(start), Told()
        found = improved(search, line(told), standing, 7, "asked")
        assert (found is not standing) == taken, (factor, margin, start)
        assert (told[0].winner is not None) == taken
        assert places([found]) == ([2.6] if taken else [start])
