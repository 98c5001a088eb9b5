"""The calibration that `handtrack new` is given, in whatever form, as a rig in metres: nothing open is decided in silence."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from handtrack.capture.calibration.formats.read_calibration import read_calibration
from handtrack.capture.calibration.formats.settle import (
    Unit,
    is_a_hand,
    named,
    sized,
    unit_of,
)
from handtrack.capture.joints.hand_length import hand_length
from handtrack.errors import HandtrackError
from handtrack.geometry.camera import CameraRig
from handtrack_app.commands.new_session.joints import CameraJoints
from handtrack_app.commands.terminal.progress import say
from handtrack_app.commands.terminal.questions import can_ask, question


def given_rig(
    paths: Sequence[Path],
    sizes: Mapping[str, tuple[int, int]],
    cameras: Sequence[str],
    joints: Mapping[str, CameraJoints],
    unit_m: float | None,
    yes: bool,
) -> tuple[CameraRig, list[str]]:
    """Return all cameras of a calibration, with the recording's names, in metres; and what was assumed, in sentences.

    sizes: [px] of the recorded cameras' images, where there are some. joints: of those that have some. unit_m: what the user
    said. yes: take proposals without asking. Raises HandtrackError where something cannot be known.
    """
    where = " and ".join(map(str, paths))
    try:
        given, assumed = named(read_calibration(paths), cameras, where)
        given = sized(given, sizes, where)
        in_units = given.rig(1.0)
        pixels = {n: found.pixels(in_units[n].size) for n, found in joints.items() if n in in_units}
        hand = hand_length(in_units, pixels)
        found = unit_of(given, hand) if unit_m is None else Unit(unit_m, True, "")
        chosen = found.unit_m if found.sure and found.unit_m else _asked(found, where, yes)
        rig = given.rig(chosen)
    except HandtrackError as error:
        text = str(error)
        raise HandtrackError(
            text if any(str(p) in text for p in paths) else f"{where}: {text}"
        ) from None
    notes = [
        assumed,
        f"unit: {found.why if found.sure else f'{chosen:g} m.'}" if unit_m is None else "",
    ]
    if hand is not None and not is_a_hand(hand * chosen):
        notes.append(
            f"note: with {chosen:g} m a unit, the joints make a hand {100 * hand * chosen:.3g} cm long; expected 6 to 25 cm. Is the "
            "unit right, and do cameras, joints and frames belong together?"
        )
    return rig, [text for text in notes if text not in ("", "unit: ")]


def _asked(found: Unit, where: str, yes: bool) -> float:
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
    maybe = "" if proposal is None else f" ({proposal:g} would be usual for hands)"
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
