"""Everything that can be odd about a session, looked at in one go."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from handtrack.errors import HandtrackError
from handtrack.session.check_cameras import check_cameras
from handtrack.session.check_clouds import check_clouds
from handtrack.session.check_hand import check_init, check_truth
from handtrack.session.check_views import check_lengths, check_view
from handtrack.session.finding import Finding

if TYPE_CHECKING:
    from handtrack.session.session import Session


def examine(session: Session) -> list[Finding]:
    """Return the findings about a session's files, cameras, masks, first pose and truth, in this
    order."""
    if session.frame_count == 0:
        return [
            Finding(
                "error",
                f"{session.folder}: no frames at all; no camera has images, masks or depth.",
            )
        ]
    found = [
        Finding(
            "ok",
            f"{session.frame_count} frames, {session.frame_count / session.fps:.1f} s at "
            f"{session.fps:g} fps.",
        )
    ]
    for view in session.views:
        found += _all_of(check_view(view, session))
    for check in (check_lengths, check_cameras, check_clouds, check_init, check_truth):
        found += _all_of(check(session))
    # last, since looking at the files is what brings these to light
    found += [Finding("warning", text) for text in session.warnings]
    return list(dict.fromkeys(found))  # two checks may meet the same damaged file


def _all_of(check: Iterator[Finding]) -> Iterator[Finding]:
    """Yield a check's findings; what it cannot read becomes one more."""
    try:
        yield from check
    except HandtrackError as error:
        yield Finding("error", str(error))
