"""One thing that the doctor found."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

SEVERITIES = ("ok", "note", "warning", "error")


class Finding(NamedTuple):
    """What was found, in one plain sentence or two."""

    severity: str
    """ok: as it should be; note: worth knowing; warning: probably wrong; error: tracking cannot
    use it."""
    text: str


ok, note, warning, error = (partial(Finding, severity) for severity in SEVERITIES)
