"""The calibration that `handtrack new` is given, in whatever form, as a rig in metres: nothing open is decided in silence."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from handtrack.capture.calibration.formats.given_rig import GivenRig
from handtrack.capture.calibration.formats.read_calibration import read_calibration
from handtrack.capture.calibration.formats.settle import (
    LensView,
    Unit,
    named,
    pinholes,
    sized,
    unit_of,
    with_lens,
)
from handtrack.capture.images.openpose import LAYOUTS
from handtrack.capture.joints.subject import subject_length
from handtrack.errors import HandtrackError
from handtrack.geometry.camera import CameraRig
from handtrack_app.commands.new_session.joints import (
    GivenSubject,
    joint_regions,
    subject_in_views,
)
from handtrack_app.commands.new_session.side_of_hand import USUAL
from handtrack_app.commands.terminal.progress import say
from handtrack_app.commands.terminal.questions import can_ask, question


def given_rig(
    paths: Sequence[Path],
    sizes: Mapping[str, tuple[int, int]],
    cameras: Sequence[str],
    subject: GivenSubject,
    unit_m: float | None,
    lens: str | None,
    yes: bool,
) -> tuple[CameraRig, GivenSubject, dict[str, LensView], list[str]]:
    """Return all cameras of a calibration, with the recording's names, in metres; the subject with its joints in their images;
    which of them are pinhole views of other lenses; and what was assumed, in sentences.

    sizes: [px] of the recorded cameras' images, where there are some. subject: what is tracked, with its joints. unit_m: what the user
    said. lens: `plain` or `fisheye`, where the user says it. yes: take proposals without asking. Raises HandtrackError where something cannot be known.
    """
    where = " and ".join(map(str, paths))
    try:
        given, assumed = named(read_calibration(paths), cameras, where)
        given = _with_lens(given, lens, where)
        given = sized(given, sizes, where)
        shown, views = pinholes(given, joint_regions(subject, given))
        subject = subject_in_views(subject, views)
        in_units = shown.rig(1.0)
        length = _length(in_units, subject)
        found = unit_of(given, length, subject.kind) if unit_m is None else Unit(unit_m, True, "")
        chosen = (
            found.unit_m
            if found.sure and found.unit_m
            else _asked(found, where, yes, subject.kind.word)
        )
        rig = shown.rig(chosen)
    except HandtrackError as error:
        text = str(error)
        raise HandtrackError(
            text if any(str(p) in text for p in paths) else f"{where}: {text}"
        ) from None
    notes = [
        assumed,
        f"unit: {found.why if found.sure else f'{chosen:g} m.'}" if unit_m is None else "",
    ]
    if length is not None and not subject.kind.fits(length * chosen):
        notes.append(
            f"note: with {chosen:g} m a unit, the joints make a {subject.kind.word} {100 * length * chosen:.3g} cm long; expected "
            f"{subject.kind.range_words}. Is the unit right, and do cameras, joints and frames belong together?"
        )
    for name in dict.fromkeys(seen.camera for seen in views.values()):
        tiles = [(tile, seen.view.size) for tile, seen in views.items() if seen.camera == name]
        shown = ", ".join(f"{tile} ({w} × {h})" for tile, (w, h) in tiles)
        kind = (
            "a fisheye lens"
            if next(v for v in views.values() if v.camera == name).lens.fisheye
            else "a lens with skew"
        )
        notes.append(
            f"camera '{name}' has {kind}: its images are undistorted to a pinhole view, {shown}."
        )
    return rig, subject, views, [text for text in notes if text not in ("", "unit: ")]


def _length(rig: CameraRig, subject: GivenSubject) -> float | None:
    """Return how long what is tracked is, in the rig's unit, where joints tell it."""
    seen = {name: joints for name, joints in subject.joints.items() if name in rig}
    pixels = {name: joints.pixels(rig[name].size) for name, joints in seen.items()}
    layouts = {name: LAYOUTS[joints.layout(USUAL)] for name, joints in seen.items()}
    return subject_length(rig, pixels, layouts, subject.kind)


def _with_lens(given: GivenRig, lens: str | None, where: str) -> GivenRig:
    """Ask for the lens model where the calibration leaves it open; no proposal is made, so nothing is taken unasked."""
    try:
        return with_lens(given, lens, where)
    except HandtrackError as error:
        if lens is not None:
            raise
        if not can_ask():
            raise HandtrackError(
                f"{error} Say which with --lens plain or --lens fisheye. Nothing was written."
            ) from None
        say(str(error))
        answer = question("Which lens, plain or fisheye?", "")
        if answer not in ("plain", "fisheye"):
            raise HandtrackError(f"the lens '{answer}'; expected plain or fisheye.") from None
        return with_lens(given, answer, where)


def _asked(found: Unit, where: str, yes: bool, what: str) -> float:
    """Return the unit that the user says, or agrees to."""
    proposal = found.unit_m
    if yes and proposal is not None:
        return proposal
    if can_ask() and not yes:
        say(f"{where}: {found.why}")
        answer = question(
            "How many metres is one unit of it?", "" if proposal is None else f"{proposal:g}"
        )
        return checked_unit(answer, "the answer")
    maybe = "" if proposal is None else f" ({proposal:g} would be usual for a {what})"
    raise HandtrackError(
        f"{where}: {found.why} Say how many metres one unit of it is, with --world-unit-m{maybe}: 1 for metres, 0.001 for "
        "millimetres, the side of a square in metres for a board counted in squares. Nothing was written."
    )


def checked_unit(text: str | float, what: str) -> float:
    """Return metres above 0. Raises HandtrackError."""
    try:
        unit = float(text)
    except ValueError:
        unit = math.nan
    if not 0 < unit < math.inf:
        raise HandtrackError(f"{what} {text:g}: expected metres above 0." if isinstance(text, float) else
                             f"{what} '{text}': expected metres above 0.")  # fmt: skip
    return unit
