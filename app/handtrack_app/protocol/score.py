"""What the engine tells of how well the pose shown explains its frame."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ScoreSnapshot:
    """The score of one pose, and of the one that was fitted to its frame last."""

    frame: int
    values: tuple[float, ...]
    """(S,) joint parameters of the pose that it is of [m, rad]"""
    overlap: dict[str, float]
    """with the masks, 0 to 1, by camera"""
    energy: dict[str, float]
    """by its parts in words"""
    fitted_overlap: dict[str, float] | None = None
    """None: nothing was fitted there"""
    fitted_energy: float | None = None
