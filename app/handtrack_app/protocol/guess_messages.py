"""What page and worker say to each other about poses that explain a frame, besides the one shown: frozen, picklable."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from handtrack.arrays import Floats, Ints

# ---- commands: page → worker ----------------------------------------------------------------------


@dataclass(frozen=True)
class FindHand:
    """Look for the hand without any first pose, in one frame, or in the surest of several."""

    frame: int | None


@dataclass(frozen=True)
class TakeGuess:
    """Set the pose of a frame to one of the list."""

    frame: int
    index: int
    version: int
    """of the user's edits"""


# ---- snapshots: worker → page ---------------------------------------------------------------------


@dataclass(frozen=True)
class Guess:
    """One pose of the list."""

    share: float
    """0 to 1: how probable it is held to be"""
    words: str


@dataclass(frozen=True)
class GuessesSnapshot:
    """Poses that explain a frame, the surest first, and their bones to be drawn."""

    frame: int
    kind: str
    """`found` without a first pose, `carried` by the tracker, or empty: there are none"""
    guesses: tuple[Guess, ...] = ()
    owner: Ints = field(default_factory=lambda: np.zeros(0, np.int64))
    """(N,) the guess that each bone belongs to"""
    position: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    """(N, 3) where bones begin, world [m]"""
    rotation: Floats = field(default_factory=lambda: np.zeros((0, 3, 3)))
    """(N, 3, 3) bone → world; bones lie along y"""
    length: Floats = field(default_factory=lambda: np.zeros(0))
    """(N,) [m]"""
    is_new: bool = False
    """just found: the surest is to be taken"""
