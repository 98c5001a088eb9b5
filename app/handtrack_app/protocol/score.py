"""What the engine tells of how well the pose shown explains its frame."""

from __future__ import annotations

from dataclasses import dataclass

from handtrack.arrays import Floats, S


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

    def is_of(self, frame: int, values: Floats[S]) -> bool:
        """Return whether it is of a pose, joint parameters [m, rad], and no other."""
        return (self.frame, self.values) == (frame, tuple(values.tolist()))
