"""What is tried when: one row a situation, run by the engine. docs/explanation/search.md is printed from here."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import takewhile

import numpy as np

from handtrack.tracking.frame.assessment import FEWEST_FRAMES, energy_ratio
from handtrack.tracking.frame.constants import SEARCH_EVERY
from handtrack.tracking.frame.result import FrameResult, Status
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.search.engine import Fit, Propose, Round, Search

SUSPICIOUS_RATIO = 1.4
"""times the usual energy from which a finger may be lost; `bench finger_shift`"""
SUSPICIOUS_FRAMES = FEWEST_FRAMES
"""the first frames, in which nothing vouches for any pose"""
UNSEEN_EVERY = 5
"""frames between two looks in a row where nothing was seen near the expected place"""

LOST_FINGER = Search(
    situation="a finger may be lost",
    when=(
        f"the energy is above {SUSPICIOUS_RATIO:g} times the usual; each of the first {SUSPICIOUS_FRAMES} frames; every "
        f"{SEARCH_EVERY}th frame (`tracker.escape`)"
    ),
    rounds=(
        Round((Propose("finger shift"), Propose("finger grid", 4)), keep=0, fits=(Fit("frame"),)),
    ),
    measure="the frame's energy in its narrowest band, without the pull to the prediction",
    margin=2.0,  # [log-likelihood] e² times as probable
    repeats=3,
    again="in the next frame that asks for it",
)
SHIFTED_FINGERS = Search(
    situation="all fingers may be one off",
    when="each frame, by the 2004 paper's method",
    rounds=(Round((Propose("finger shift as bent"),), keep=0, fits=(Fit("frame"),)),),
    measure="as for a lost finger",
    again="in the next frame",
)
LOST_HAND = Search(
    situation="the hand may be lost",
    when="a frame is doubtful or lost, unless what was seen only leaves the hand open, or its cloud is poor or shows other things, too (`tracker.recovery`); masks of more than half of an image do not count",
    rounds=(
        Round((Propose("rigid grid nearby", 28), Propose("standing pose"), Propose("depth flips")), keep=0, enter=60, fits=(Fit("wide", 8),)),
        Round(enter=10, fits=(Fit("wide", 12),)),
        Round(enter=3, fits=(Fit("tracker"),)),
    ),
    measure="energy of what was seen with short arms (4 mm), the same for all",
    factor=0.95,
    again=(
        "of such frames in a row the first, second, fourth, eighth …; where nothing was seen also every "
        f"{UNSEEN_EVERY}th"
    ),
)  # fmt: skip
FINISH = (
    Round(enter=5, fits=(Fit("tracker"),)),
    Round((Propose("best again"),), adds=True, fits=(Fit("tracker with lost fingers"),)),
    Round((Propose("finger swaps"),), adds=True, fits=(Fit("wide", 12), Fit("tracker"))),
)
"""how first poses are finished, wherever they come from"""
FIRST_POSE = Search(
    situation="there is no first pose",
    when="`--init auto`, *Find the hand*",
    rounds=(
        Round((Propose("rigid grid", 48),), enter=48, fits=(Fit("wide", 10),)),
        Round((Propose("finger bends", 12),), keep=12, fits=(Fit("wide", 12),)),
        Round(enter=24, fits=(Fit("narrow", 8),)),
        Round((Propose("best of unknown size", 5),), adds=True, fits=(Fit("size"),)),
        *FINISH,
        Round((Propose("best of unknown size", 1),), adds=True, fits=(Fit("size"), Fit("tracker"))),
    ),
    measure="energy of what was seen with short arms (4 mm), the same for all; the surest comes first",
    most=5,
)
GIVEN_JOINTS = Search(
    situation="a first pose is given as joints in images, and silhouettes or a cloud may decide",
    when="two cameras agree on fewer than 12 of 21 joints",
    rounds=FINISH,
    measure="as for a first pose",
    most=FIRST_POSE.most,
)
IMAGE_JOINTS = Search(
    situation="joints in images alone must give a first pose",
    when="as before; without silhouettes and cloud, and of a body, this is all",
    rounds=(
        Round((Propose("attitudes in four postures", 300),), fits=(Fit("cheapest", 48), Fit("polish", 40))),
        Round((Propose("flips in depth of the best", 6),), keep=6, fits=(Fit("polish", 40),)),
    ),
    measure="robust distance of the joints in the images, and priors; shares of exp(−cost)",
    most=8,
)  # fmt: skip
POOR, GOOD = 0.80, 0.88
"""agreement below which a cloud's depths are doubted, and above which they are believed again; `bench poor_clouds`"""
POOR_CLOUD = Search(
    situation="a cloud that alone holds the hand is poor",
    when=(
        f"cloud and hand agree by less than {POOR:g}, until they agree by {GOOD:g} (`model.fallback`): harmonic mean of the "
        "share of points on the surface and of the surface in view that was measured, or the latter alone where it is more"
    ),
    rounds=(Round((Propose("depths doubted"), Propose("glove9"), Propose("ball6")), fits=(Fit("frame"),)),),
    measure="energy; only the one that `model.fallback` names is proposed",
    taken="always: the frame is called doubtful",
    again="in the next frame, first of all",
)  # fmt: skip
OTHER_SIDE = Search(
    situation="the hand may be of the other side",
    when=(
        "after tracking from a first pose that was found, or given without joints: in up to 4 frames, until this side fits "
        "better; then of this side likewise"
    ),
    rounds=(
        Round((Propose("rigid grid nearby", 28),), keep=0, enter=28, fits=(Fit("wide", 8),)),
        Round(enter=10, fits=(Fit("wide", 12),)),
        Round(enter=3, fits=(Fit("tracker with lost fingers"),)),
    ),
    measure="as for a first pose",
    taken="never: told, where the log-odds of all frames together are above 5",
)
FIRST_HYPOTHESES = Search(
    situation="several hypotheses, first frame",
    when="`tracker.hypotheses` above 1",
    rounds=(
        Round((Propose("headings, seen coarsely", 4),), fits=(Fit("minimum"),)),
        Round((Propose("the start and what was found"),), keep=0, fits=(Fit("minimum"),)),
        Round((Propose("interpretation trees of the best", 6),), adds=True, fits=(Fit("minimum"),), times=3),
    ),
    measure="energy",
    margin=1.0,
    taken="distinct minima, the heaviest by exp(−cost)",
)  # fmt: skip
NEXT_HYPOTHESES = Search(
    situation="several hypotheses, every other frame",
    when="`tracker.hypotheses` above 1",
    rounds=(
        Round(
            (Propose("each followed"), Propose("each jumped along chains")), fits=(Fit("minimum"),)
        ),
    ),
    measure="−log of the posterior mass: exp(−cost), the prior's share, the minimum's width (Laplace)",
    taken="distinct minima, the heaviest",
)
SEARCHES = (
    FIRST_POSE, GIVEN_JOINTS, IMAGE_JOINTS, FIRST_HYPOTHESES, NEXT_HYPOTHESES, LOST_FINGER, SHIFTED_FINGERS,
    POOR_CLOUD, LOST_HAND, OTHER_SIDE,
)  # fmt: skip
"""in the order in which a frame asks for them"""


def table() -> str:
    """Return all rows as a table in Markdown."""
    head = "| situation | when | tried, round by round | measure | taken | again |\n|---|---|---|---|---|---|\n"
    return head + "".join(
        f"| {s.situation} | {s.when} | {_rounds(s)} | {s.measure} | {_taken(s)} | {s.again} |\n"
        for s in SEARCHES
    )


def _rounds(search: Search) -> str:
    repeats = f"; up to {search.repeats} times from the better pose" if search.repeats > 1 else ""
    return "; ".join(_round(step, search.margin) for step in search.rounds) + repeats


def _round(step: Round, margin: float) -> str:
    words = (
        [" and ".join(f"{p.name} ({p.most})" if p.most else p.name for p in step.propose)]
        if step.propose
        else []
    )
    if step.keep:
        words[0] += f", beside the best {step.keep} so far"
    if step.enter is not None:
        words.append(f"best {step.enter}")
    words += [f"{f.kind} {f.iterations}" if f.iterations else f.kind for f in step.fits]
    again = f", up to {step.times} times while the best gets better by {margin:g}"
    return " → ".join(words) + (again if step.times > 1 else "")


def _taken(search: Search) -> str:
    if search.taken:
        return search.taken
    if search.most > 1:
        return f"the best {search.most} distinct ones"
    share = "" if search.factor == 1.0 else f"{search.factor:g} × "
    less = f" − {search.margin:g}" if search.margin else ""
    return f"cost below {share}the standing pose's{less}"


def finger_search(
    settings: TrackerSettings,
    frame: int,
    energy: float,
    views: int,
    previous: Sequence[FrameResult],
) -> tuple[Search, str]:
    """Return which search for fingers a frame may need, and why it is made; no reason where it is not."""
    if settings.traits.shifts_each_frame:
        return SHIFTED_FINGERS, f"by the method {settings.method}"
    if not settings.tracker.escape:
        return LOST_FINGER, ""
    return LOST_FINGER, why_fingers_may_be_lost(frame, energy, views, previous)


def why_fingers_may_be_lost(
    frame: int, energy: float, views: int, previous: Sequence[FrameResult]
) -> str:
    """Return why lost fingers are looked for in a frame; empty where they are not.

    When it fits worse than usual, in one of the first frames, which nothing vouches for, and every so many frames: a
    finger hidden in a fist may settle wrongly with the usual energy.
    """
    if frame % SEARCH_EVERY == SEARCH_EVERY - 1:
        return f"every {SEARCH_EVERY}th frame"
    if len(previous) < SUSPICIOUS_FRAMES:
        return f"one of the first {SUSPICIOUS_FRAMES} frames"
    ratio = energy_ratio(energy, views, previous)
    return f"{ratio:.2f} times the usual energy" if ratio > SUSPICIOUS_RATIO else ""


def why_hand_may_be_lost(result: FrameResult, previous: Sequence[FrameResult]) -> str:
    """Return why the hand is looked for elsewhere; empty where it is not.

    When a frame does not fit; of several such frames in a row the first, second, fourth, eighth …: what was not found in
    one of them is rarely found in the next. A frame in which nothing was seen ends such a row and begins one of its own
    (there may be a cloud, but far from where the hand was expected), of which every fifth is looked at as well. Among the wrong points
    of a poor cloud, and among those of other things, another hand often fits better: there nothing is looked for while the hand is not lost.
    """
    if result.fits or not previous or result.clutters:
        return ""
    unseen, row = not np.isfinite(result.energy), 1
    for before in reversed(previous):
        if before.fits or not (unseen or np.isfinite(before.energy)):
            break
        row += 1
    due = _is_due(row) or (unseen and row % UNSEEN_EVERY == 0)
    return f"frame {row} of a row that is in doubt: {result.note}" if due else ""


def looks_everywhere(previous: Sequence[FrameResult]) -> bool:
    """Return whether the next frame is one in which a lost hand is looked for everywhere; in others it is where it was, or nowhere."""
    row = 1 + len(list(takewhile(lambda r: not r.fits, reversed(previous))))
    lost = bool(previous) and previous[-1].status == Status.LOST
    return lost and (_is_due(row) or row % UNSEEN_EVERY == 0)


def _is_due(row: int) -> bool:
    return row & (row - 1) == 0


if __name__ == "__main__":
    print(table())
