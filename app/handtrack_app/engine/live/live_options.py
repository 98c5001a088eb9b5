"""What the command line says of a live source; light to import."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class LiveOptions:
    """How running cameras are opened."""

    devices: Mapping[str, str]
    """by camera; none: 0, 1, 2 … in the session's order"""
    tolerance_s: float
    """how far apart the images of one frame may be"""
    record: Path | None = None
    """a new folder to record to from the start"""
    rate: float = 1.0
    """how many times faster than their pace video files are played, to measure by"""
