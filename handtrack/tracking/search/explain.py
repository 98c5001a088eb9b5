"""What was searched in a frame, in words: which rows of the policy fired, what each tried, what it cost, why the winner won."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby

import numpy as np

from handtrack.tracking.frame.result import FrameResult
from handtrack.tracking.search.engine import SearchReport, Trial

_LISTED = 6  # candidates of a round that are named


def explained(frame: int, reports: Sequence[SearchReport], result: FrameResult | None) -> list[str]:
    """Return lines that tell of a frame's searches, in the order in which they were made, and of what came of it."""
    own = [report for report in reports if report.frame == frame]
    lines = [
        f"frame {frame}: {len(own)} searches" if own else f"frame {frame}: nothing was searched"
    ]
    for report in own:
        lines += _report(report)
    if result is not None:
        found = f"result: {result.status.name.lower()}, energy {result.energy:.1f}"
        lines.append(f"{found}; {result.note}" if result.note else found)
    return lines


def _report(report: SearchReport) -> Iterator[str]:
    yield f"- {report.search.situation} ({report.why})"
    stands = np.isfinite(report.standing)
    standing = f"standing pose: {report.standing:.2f}, by" if stands else "compared by"
    yield f"  {standing} {report.search.measure}"
    for number, (proposed, trials) in enumerate(report.rounds, start=1):
        yield f"  round {number}: {proposed} proposed, {len(trials)} fitted: {_trials(trials)}"
    if report.winner is None:
        yield f"  nothing {'better was found; the standing pose stays' if stands else 'was taken'}"
    else:
        yield f"  taken: {report.winner.origin} at {report.winner.cost:.2f}, {_why(report)}"


def _trials(trials: Sequence[Trial]) -> str:
    """Return the best of a round's candidates, those of one origin together."""
    ordered = sorted(trials, key=lambda t: (t.origin, t.cost))
    groups = [list(group) for _, group in groupby(ordered, key=lambda t: t.origin)]
    groups.sort(key=lambda group: group[0].cost)
    named = [
        f"{group[0].origin}{f' ×{len(group)}' if len(group) > 1 else ''} {group[0].cost:.2f}"
        for group in groups[:_LISTED]
    ]
    more = len(groups) - _LISTED
    return ", ".join(named) + (f" and {more} more" if more > 0 else "")


def _why(report: SearchReport) -> str:
    search = report.search
    if search.taken:
        return search.taken
    limit = search.factor * report.standing - search.margin
    return f"below {limit:.2f} ({search.factor:g} × {report.standing:.2f} − {search.margin:g})"
