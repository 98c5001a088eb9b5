"""Settings of the mixture tracker: how widely it looks for other poses that explain a frame."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class MixtureSettings:
    """Where `tracker.hypotheses` is above 1: how other poses are looked for, and what becomes of them at the end."""

    draws: int = 24
    """samples a frame, each of them flipped along one chain"""
    scale: float = 4.0
    """how far samples scatter around a hypothesis, in standard deviations (2003 paper: 4 to 6)"""
    jump_share: float = 0.1
    """how probable it is that a hypothesis jumps between two frames"""
    descents: int = 12
    """samples a frame that are optimised, where it is not by keypoints alone: then all are"""
    carried: int = 20
    """hypotheses carried in all: `tracker.hypotheses` that differ, and the heaviest of those that do not yet; keypoints
    alone: anything else takes too long"""
    merge_deg: float = 2.0
    """two minima closer than this, root mean square over all angles, are one"""
    apart_mm: float = 40.0
    """`tracker.hypotheses` differ from each other by at least this, mean over the joints relative to the root"""
    seed: int = 0
    """another one gives other samples; the same gives the same result"""
    sequence: str = "best"
    """`best`: of each frame the best hypothesis; `path`: those that the last frame's best descends from; `smooth`: that
    path smoothed"""
