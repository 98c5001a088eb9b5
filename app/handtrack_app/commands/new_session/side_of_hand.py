"""Which hand was recorded: said by the user, else seen by the detector, where its weights are there."""

from __future__ import annotations

from pathlib import Path

from handtrack.errors import HandtrackError
from handtrack.session.session import Session
from handtrack_app.commands.terminal.progress import say
from handtrack_app.commands.terminal.questions import can_ask, confirmed, question

USUAL = "right"
_SURE = 0.9  # below, somebody is asked


def check_detector(weights: Path | None, wanted: bool, yes: bool) -> str:
    """Return what is missing for the hand to be found in images, in a sentence, or nothing. Raises HandtrackError for a file
    that was named and cannot be used. wanted: it will be looked for, so that a detector is fetched if that is agreed to.
    """
    from handtrack.detector.weights import DOWNLOAD_MB, fetch_weights, has_weights
    from handtrack.session.detection import HandDetector

    offer = f"The hand detector is not installed. Fetch it now, {DOWNLOAD_MB} MB by pip?"
    try:
        if wanted and weights is None and not has_weights() and (yes or confirmed(offer)):
            say(f"fetching the hand detector, {DOWNLOAD_MB} MB …")
            fetch_weights()
        HandDetector.open(weights)
    except HandtrackError as error:
        if weights is not None:
            raise HandtrackError(str(error).replace("--weights", "--detector")) from None
        return str(error)
    return ""


def side_of_hand(session: Session, weights: Path | None, yes: bool) -> str:
    """Return the side that the images show, with how sure that is said; asked where it is not sure, `right` where nobody knows.

    Weights must be there.
    """
    from handtrack.session.detection import HandDetector, seen_side

    say("looking which hand it is …")
    found = seen_side(session, HandDetector.open(weights))
    seen = f"a hand is detected in {found.seen} of {found.looks} images"
    if not found.seen:
        say(f"note: {seen}; the side is taken to be {USUAL}. Say otherwise with --side left.")
        return USUAL
    percent = f"{100 * found.confidence:.0f} % sure"
    if found.confidence >= _SURE or yes or not can_ask():
        doubt = "" if found.confidence >= _SURE else " The confidence is low: give --side."
        say(f"side: {found.side}, {percent} ({seen}).{doubt}")
        return found.side
    answer = ""
    while answer not in ("right", "left"):
        answer = question(
            f"side: {found.side}, {percent} ({seen}). Which hand is it, right or left?", found.side
        )
    return answer
