"""The pose library as the engine tells it: in words, and in pictures."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class PoseName:
    """A pose of the library."""

    name: str
    short: str
    """what it is called among those of its group"""
    group: str

    @property
    def title(self) -> str:
        """What it is called."""
        return f"{self.short} ({self.group})" if len(self.short) == 1 else self.short


@dataclass(frozen=True)
class PosePicture(PoseName):
    """A pose of the library, drawn."""

    picture: str
    """SVG"""


@dataclass(frozen=True)
class LibrarySnapshot:
    """The pose library in pictures, for one client."""

    client_id: int
    poses: tuple[PosePicture, ...]
