"""What an engine is to open, and how: all that one that begins anew is told; picklable, and light to import."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from handtrack_app.engine.live.live_options import LiveOptions

if TYPE_CHECKING:  # the page's process has no use for what the engine imports
    from handtrack_app.engine.worker import Opener


@dataclass(frozen=True)
class EnginePlan:
    """What to open, and how."""

    folder: Path
    live: LiveOptions | None = None
    """track running cameras by the folder's settings"""
    rerun: bool = False
    """stream what is tracked to rerun's viewer"""
    take_over: bool = False
    """write, even if another program does"""
    opener: Opener | None = None
    """what opens the folder instead; a module's function, where it is for another process"""
    memory: int | None = None
    """bytes that the engine's process may use; None: no limit"""
    preview: bool = True
    """show what can be shown at once before the session can be worked in"""
    version: int = 0
    """of the user's edits so far"""
    page: str = ""
    """whose numbers the commands have: an engine that begins again finds on disk up to which they are done"""
