"""The table of all search policies that docs/reports/search_policy.md shows."""

from __future__ import annotations

from handtrack.tracking.frame.control import Fitter, Proposer, Round, Search
from handtrack.tracking.hypotheses.mixture import FIRST_HYPOTHESES, NEXT_HYPOTHESES
from handtrack.tracking.search.frame_solve import LOST_FINGER, POOR_CLOUD, SHIFTED_FINGERS
from handtrack.tracking.search.global_search import (
    FIRST_POSE,
    GIVEN_JOINTS,
    LOST_HAND,
    OTHER_SIDE,
)
from handtrack.tracking.search.keypoint_start import IMAGE_JOINTS

SEARCHES = (
    FIRST_POSE,
    GIVEN_JOINTS,
    IMAGE_JOINTS,
    FIRST_HYPOTHESES,
    NEXT_HYPOTHESES,
    LOST_FINGER,
    SHIFTED_FINGERS,
    POOR_CLOUD,
    LOST_HAND,
    OTHER_SIDE,
)
"""in the order in which a frame runs them"""


def table() -> str:
    """Return all policies as a table in Markdown, and what each of their functions does."""
    head = "| situation | trigger | rounds | objective | accepted | retry |\n|---|---|---|---|---|---|\n"
    rows = "".join(
        f"| {s.situation} | {s.when} | {_tried(s)} | {s.measure} | {_taken(s)} | {s.again} |\n"
        for s in SEARCHES
    )
    rounds = [step for search in SEARCHES for step in search.rounds]
    proposers = {_name(p): p for step in rounds for p, _ in step.propose}
    fitters = {_name(f): f for step in rounds for f, _ in step.fits}
    return f"{head}{rows}\n{_listed('proposal', proposers)}\n{_listed('optimisation', fitters)}"


def _listed(kind: str, functions: dict[str, Proposer] | dict[str, Fitter]) -> str:
    rows = (
        f"| {name} | {(one.__doc__ or '').strip().splitlines()[0]} |\n"
        for name, one in functions.items()
    )
    return f"| {kind} | what it does |\n|---|---|\n" + "".join(rows)


def _name(function: Proposer | Fitter) -> str:
    return function.__name__.replace("_", " ")


def _tried(search: Search) -> str:
    repeats = (
        f"; repeated up to {search.repeats} times while the pose improves"
        if search.repeats > 1
        else ""
    )
    return search.tried or "; ".join(_round(one, search.margin) for one in search.rounds) + repeats


def _round(step: Round, margin: float) -> str:
    proposed = [_name(p) + (f" ({most})" if most else "") for p, most in step.propose]
    words = [" and ".join(proposed)] if proposed else []
    if step.keep:
        words[0] += f" in addition to the best {step.keep}"
    if step.enter is not None:
        words.append(f"best {step.enter}")
    words += [_name(f) + (f" {count}" if count else "") for f, count in step.fits]
    again = f", up to {step.times} times while the best cost falls by {margin:g}"
    return " → ".join(words) + (again if step.times > 1 else "")


def _taken(search: Search) -> str:
    if search.taken:
        return search.taken
    if search.most > 1:
        return f"the best {search.most} distinct candidates"
    share = "" if search.factor == 1.0 else f"{search.factor:g} × "
    less = f" − {search.margin:g}" if search.margin else ""
    return f"cost below {share}the current pose's{less}"
