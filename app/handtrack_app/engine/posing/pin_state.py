"""What the session's state says of pins, frame by frame. Changes nothing."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from handtrack.errors import HandtrackError, unknown_name
from handtrack.observation.pins import Pin
from handtrack.session.session import Session
from handtrack.session.sources.session_pins import SessionPins
from handtrack.store.history import Value
from handtrack_app.engine.store import keys

_SAME_PX = 0.01
"""a file has thousandths of a pixel"""


def pins_value(pins: Iterable[Pin]) -> Value:
    """Return a frame's pins as the state has them; None: there are none."""
    rows = [
        {"camera": p.camera, "pixel": list(p.pixel)}
        | ({"joint": p.joint} if p.joint else {"bone": p.bone, "point": list(p.point)})
        for p in pins
    ]
    return {"pins": rows} if rows else None


def pins_from(session: Session, value: Value) -> tuple[Pin, ...]:
    """Return the pins that a value of the state is. Raises HandtrackError, KeyError, TypeError or ValueError."""
    return tuple(_pin(session, row) for row in (() if value is None else value["pins"]))


def _pin(session: Session, row: Value) -> Pin:
    camera, (x, y) = str(row["camera"]), (float(part) for part in row["pixel"])
    if camera not in session.rig:
        raise unknown_name("camera", camera, session.rig.names, "a pin")
    i, j, k = (float(part) for part in row.get("point", (0.0, 0.0, 0.0)))
    if not np.isfinite([x, y, i, j, k]).all():
        raise HandtrackError(f"a pin: expected a pixel's column and row, found {row['pixel']}.")
    pin = Pin(camera, (x, y), str(row.get("joint", "")), str(row.get("bone", "")), (i, j, k))
    return session.pins.as_written(pin)


def pins_in(session: Session, values: Mapping[str, Value]) -> dict[int, tuple[Pin, ...]]:
    """Return the pins among values of the state, by frame. Raises what `pins_from` does."""
    return {
        int(name): pins_from(session, value)
        for key, value in values.items()
        for kind, name in (keys.parts(key),)
        if kind == keys.PINS
    }


def changed_elsewhere(stood: Mapping[int, tuple[Pin, ...]], pins: SessionPins) -> dict[str, Value]:
    """Return values for the frames whose pins the file has otherwise than the state, after which it was written.

    stood: as the file has them; pins: as the state does.
    """
    frames = sorted({*stood, *pins.frames})
    return {
        keys.pins(frame): pins_value(stood.get(frame, ()))
        for frame in frames
        if not _same(stood.get(frame, ()), pins.of(frame))
    }


def _same(one: tuple[Pin, ...], other: tuple[Pin, ...]) -> bool:
    return len(one) == len(other) and all(
        a.what == b.what and float(np.abs(np.subtract(a.pixel, b.pixel)).max()) < _SAME_PX
        for a, b in zip(one, other, strict=True)
    )
