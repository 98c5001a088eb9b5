"""What the session's state says of pins, frame by frame. Changes nothing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from handtrack.errors import HandtrackError, unknown_name
from handtrack.observation.pins import Pin
from handtrack.session.session import Session
from handtrack.session.session_state import Edit, FramePins, decide
from handtrack.session.sources.session_pins import SessionPins

_SAME_PX = 0.01
"""a file has thousandths of a pixel"""


def pinning(pins: Mapping[int, Sequence[Pin]]) -> Edit:
    """Return the edit by which frames have these pins."""
    return decide(pins={f: FramePins(tuple(own)) if own else None for f, own in pins.items()})


def checked(session: Session, decided: FramePins | None) -> tuple[Pin, ...]:
    """Return a frame's pins as its file has them. Raises HandtrackError."""
    return tuple(_checked(session, pin) for pin in (() if decided is None else decided.pins))


def _checked(session: Session, pin: Pin) -> Pin:
    if pin.camera not in session.rig:
        raise unknown_name("camera", pin.camera, session.rig.names, "a pin")
    if not np.isfinite([*pin.pixel, *pin.point]).all():
        raise HandtrackError(f"a pin: expected a pixel's column and row, found {pin.pixel}.")
    return session.pins.as_written(pin)


def changed_elsewhere(stood: Mapping[int, tuple[Pin, ...]], pins: SessionPins) -> list[Edit]:
    """Return edits by which frames have the pins that the file has otherwise than the state, after which it was written.

    stood: as the file has them; pins: as the state does.
    """
    frames = sorted({*stood, *pins.frames})
    return [
        pinning({frame: stood.get(frame, ())})
        for frame in frames
        if not _same(stood.get(frame, ()), pins.of(frame))
    ]


def _same(one: tuple[Pin, ...], other: tuple[Pin, ...]) -> bool:
    return len(one) == len(other) and all(
        a.what == b.what and float(np.abs(np.subtract(a.pixel, b.pixel)).max()) < _SAME_PX
        for a, b in zip(one, other, strict=True)
    )
