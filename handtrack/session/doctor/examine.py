"""Everything that can be odd about a session, looked at in one go."""

from __future__ import annotations

from collections.abc import Iterator

from handtrack.errors import HandtrackError
from handtrack.session.doctor.check_agreement import check_joints, check_outlines
from handtrack.session.doctor.check_hand import (
    check_init,
    check_model,
    check_side,
    check_tracked_cameras,
    check_tracked_from,
    check_truth,
)
from handtrack.session.doctor.check_views import (
    Finding,
    check_cameras,
    check_clouds,
    check_files,
    check_lengths,
    check_rate,
    check_synchrony,
    check_times,
    check_view,
    error,
    note,
    ok,
    warning,
)
from handtrack.session.session import Session

_START = 5  # frames from the first pose on


def examine(session: Session) -> list[Finding]:
    """Return the findings about a session's files, cameras, masks, first pose and truth, in this
    order."""
    try:
        session.check_frames()
    except HandtrackError as reason:
        return [error(str(reason))]
    found = [
        ok(
            f"{session.frame_count} frames, {session.frame_count / session.fps:.1f} s at "
            f"{session.fps:g} fps.",
        )
    ]
    for view in session.views:
        found += _all_of(check_view(view, session))
    for check in (
        check_files,
        check_times,
        check_lengths,
        check_synchrony,
        check_cameras,
        check_outlines,
        check_joints,
        check_clouds,
        check_model,
        check_init,
        check_side,
        check_tracked_from,
        check_tracked_cameras,
        check_truth,
    ):
        found += _all_of(check(session))
    # last, since looking at the files is what brings these to light
    found += [warning(text) for text in session.warnings]
    found += [note(text) for text in session.corrected_words]
    return list(dict.fromkeys(found))  # two checks may meet the same damaged file


def examine_start(session: Session, init: bool = True) -> list[str]:
    """Return what is odd about the cameras, their joints and the first pose, in sentences: quickly seen, and in vain all tracking else.

    init: whether tracking begins at init.json.
    """
    first = session.init.frame if init and session.init is not None else 0
    begin = range(first, min(first + _START, len(session.known_frames)))
    checks = [check_cameras(session), check_outlines(session, begin)]
    checks += [check_init(session)] if init else []
    checks += [check_joints(session, briefly=True), check_times(session)]
    checks += [check_rate(view, session) for view in session.views]
    if session.file.clouds is not None and session.file.clouds.stereo:
        checks.append(check_synchrony(session))
    found = [finding for check in checks for finding in _all_of(check)]
    odd = [finding.text for finding in found if finding.severity in ("warning", "error")]
    return [*session.absent, *odd]


def _all_of(check: Iterator[Finding]) -> Iterator[Finding]:
    """Yield a check's findings; what it cannot read becomes one more."""
    try:
        yield from check
    except HandtrackError as reason:
        yield error(str(reason))
