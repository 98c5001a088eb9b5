"""What is tried when: one row a situation, run by the engine. docs/search_policy.md is printed from here."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from handtrack.tracking.frame.assessment import FEWEST_FRAMES, energy_ratio
from handtrack.tracking.frame.result import FrameResult
from handtrack.tracking.search.engine import Fit, Round, Search

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
        "so many frames (`tracker.escape_every`)"
    ),
    rounds=(Round(("finger shift", "finger grid"), keep=0, fits=(Fit("frame"),)),),
    measure="the frame's energy in its narrowest band, without the pull to the prediction",
    margin=2.0,  # [log-likelihood] e² times as probable
    repeats=3,
    again="in the next frame that asks for it",
)
LOST_HAND = Search(
    situation="the hand may be lost",
    when="a frame is doubtful or lost, unless what was seen only leaves the hand open, or its cloud is poor",
    rounds=(
        Round(("rigid grid nearby", "standing pose", "depth flips"), keep=0, enter=60, fits=(Fit("wide", 8),)),
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
    Round(("best again",), adds=True, fits=(Fit("tracker with lost fingers"),)),
    Round(("finger swaps",), adds=True, fits=(Fit("wide", 12), Fit("tracker"))),
)
"""how first poses are finished, wherever they come from"""
FIRST_POSE = Search(
    situation="there is no first pose",
    when="`--init auto`, *Find the hand*",
    rounds=(
        Round(("rigid grid",), enter=48, fits=(Fit("wide", 10),)),
        Round(("finger bends",), keep=12, fits=(Fit("wide", 12),)),
        Round(enter=24, fits=(Fit("narrow", 8),)),
        *FINISH,
    ),
    measure="energy of what was seen with short arms (4 mm), the same for all; the surest comes first",
)
GIVEN_JOINTS = Search(
    situation="a first pose is given as joints in images, and silhouettes or a cloud may decide",
    when="two cameras agree on fewer than 12 of 21 joints",
    rounds=FINISH,
    measure="as for a first pose",
)
IMAGE_JOINTS = Search(
    situation="joints in images alone must give a first pose",
    when="as before; without silhouettes and cloud this is all",
    rounds=(
        Round(("attitudes and postures",), fits=(Fit("cheapest", 48), Fit("polish", 40))),
        Round(("depth flips",), keep=6, fits=(Fit("polish", 40),)),
    ),
    measure="robust distance of the joints in the images, and priors; shares of exp(−cost)",
)
SEARCHES = (FIRST_POSE, GIVEN_JOINTS, IMAGE_JOINTS, LOST_FINGER, LOST_HAND)


def why_fingers_may_be_lost(
    frame: int, every: int, energy: float, views: int, previous: Sequence[FrameResult]
) -> str:
    """Return why lost fingers are looked for in a frame; empty where they are not.

    When it fits worse than usual, in one of the first frames, which nothing vouches for, and every so many frames: a
    finger hidden in a fist may settle wrongly with the usual energy.
    """
    if every > 0 and frame % every == every - 1:
        return f"every {every}th frame"
    if len(previous) < SUSPICIOUS_FRAMES:
        return f"one of the first {SUSPICIOUS_FRAMES} frames"
    ratio = energy_ratio(energy, views, previous)
    return f"{ratio:.2f} times the usual energy" if ratio > SUSPICIOUS_RATIO else ""


def why_hand_may_be_lost(result: FrameResult, previous: Sequence[FrameResult]) -> str:
    """Return why the hand is looked for elsewhere; empty where it is not.

    When a frame does not fit; of several such frames in a row the first, second, fourth, eighth …: what was not found in
    one of them is rarely found in the next. Frames in which nothing was seen do not count, unless this is one (there may
    be a cloud, but far from where the hand was expected): then every fifth is looked at as well. Among the wrong points
    of a poor cloud another hand often fits better: there nothing is looked for.
    """
    if result.fits or not previous or result.poor_cloud:
        return ""
    unseen, row = not np.isfinite(result.energy), 1
    for before in reversed(previous):
        if before.fits or not (unseen or np.isfinite(before.energy)):
            break
        row += 1
    due = row & (row - 1) == 0 or (unseen and row % UNSEEN_EVERY == 0)
    return f"frame {row} of a row that is in doubt: {result.note}" if due else ""
