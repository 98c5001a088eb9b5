"""First poses that leave something open: found by `--init auto`, or joints in images; says how sure they are."""

from __future__ import annotations

from collections.abc import Mapping

from handtrack.errors import HandtrackError
from handtrack.session.doctor.check_hand import check_side_of
from handtrack.session.first_pose.first_pose import FirstPose
from handtrack.session.first_pose.first_pose_candidate import FirstPoseCandidate
from handtrack.session.first_pose.first_pose_search import (
    SURE,
    confirmed_by_tracking,
    find_first_poses,
    no_hand_found,
)
from handtrack.session.run import TrackingRun, given_in_images
from handtrack.session.session import Session
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack_app.commands.terminal.progress import Stop, say
from handtrack_app.commands.terminal.questions import can_ask, confirmed

_ANYWAY = "Track from it all the same?"


def found_first_pose(
    session: Session, overrides: Mapping[str, object], frames: range, stop: Stop, yes: bool
) -> FirstPose | None:
    """Return the surest pose in a range of frames; None when the user stopped it. HandtrackError where there is no hand, or the
    surest is not sure, tracking from it does not confirm it, and nobody says that it is to be taken. yes: it is.
    """
    run = TrackingRun.open(session, overrides, use_init=False)
    begun: list[float] = []

    def progress(share: float, _text: str) -> None:
        if not begun:
            say("looking for the first pose …")
        begun.append(share)

    found = find_first_poses(run, frames, stop, progress)
    if stop():
        return None
    if not found:
        raise no_hand_found(run)
    for line in described(found):
        say(line)
    first = found[0].first_pose
    if found[0].confidence >= SURE or yes:
        return first
    unfitted = {**overrides, "model.fit_size": False}
    begun_there = TrackingRun.open(session, unfitted, first, stop)
    if confirmed_by_tracking(begun_there, frames, stop):
        say("Tracking confirms it: the next frames fit as well.")
    elif not stop() and not confirmed(_ANYWAY):
        is_body = found[0].model.kind == "body"
        more = "add another camera's joints" if is_body else "give joints (`handtrack detect`)"
        raise HandtrackError(
            f"{session.folder}: the best first pose, in frame {found[0].frame}, has a confidence of {percent(found[0].confidence)}, so "
            f"nothing was tracked. Look at it in the workbench (`handtrack open`), {more}, give a "
            "pose (--init FILE), name other frames with --frames, or take it all the same with --yes."
        )
    return None if stop() else first


def ask_for_other_side(session: Session, first: FirstPose | None, yes: bool) -> None:
    """Raise HandtrackError where a given first pose's joints are those of the other hand, and nobody says that it is to be taken."""
    if yes or first is None or first.xyz is None:
        return
    for finding in check_side_of("first pose", first.xyz, session):
        if can_ask():
            say(f"note: {finding.text}")
        if not confirmed(_ANYWAY):
            raise HandtrackError(
                f"{session.folder}, {finding.text} Nothing was tracked from it. Take it all the same with --yes."
            )


def first_pose_of_images(
    session: Session, settings: TrackerSettings, first: FirstPose
) -> FirstPose:
    """Return the likeliest pose that joints in images mean, and tell the others."""
    found = given_in_images(session, settings, first)
    for line in described(found):
        say(line)
    return found[0].first_pose


def described(found: list[FirstPoseCandidate]) -> list[str]:
    """Return lines that say what was found, how sure it is, and what else it may be."""
    best, others = found[0], found[1:]
    lines = [f"first pose: frame {best.frame}, {percent(best.confidence)} sure ({best.note})."]
    lines += [f"  or: {percent(other.confidence)}, {other.note}" for other in others]
    if best.confidence < SURE:
        lines.append(
            "note: the confidence is low. Check it in the workbench (`handtrack open`), where you can choose another."
        )
    return lines


def percent(share: float) -> str:
    """Return a share in words: never 0 % nor 100 %, which nobody knows."""
    return "below 1 %" if share < 0.01 else f"{100 * min(share, 0.99):.0f} %"
