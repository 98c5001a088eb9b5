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
    """of the samples of one frame, those that are optimised, best first; keypoints alone: all of them are"""
    merge_deg: float = 5.7
    """two minima closer than this, root mean square over all angles, are one"""
    apart_mm: float = 0.0
    """hypotheses that are carried differ by at least this, mean over the joints relative to the root"""
    seed: int = 0
    """another one gives other samples; the same gives the same result"""
    sequence: str = "best"
    """`best`: of each frame the best hypothesis; `path`: the best path through all frames; `smooth`: that path smoothed"""
