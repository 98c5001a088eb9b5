"""Calls to the engine, made before they are sent."""

from typing import Any

from handtrack_app.engine.open_session import RULES
from handtrack_app.protocol.calls import Call


def call(name: str, *given: Any, **named: Any) -> Call:
    """Return a call of an engine's method."""
    return Call.of(RULES, name, given, named)
