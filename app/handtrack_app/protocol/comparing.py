"""What the engine tells of a take that is compared, and of the course of joint parameters."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from handtrack.arrays import D3, B, F, Floats, N


@dataclass(frozen=True)
class ComparedSnapshot:
    """The hand of another take at the frame shown; without bones where it has none, or none is compared."""

    frame: int
    number: int | None
    """of the take"""
    position: Floats[B, D3] = field(default_factory=lambda: np.zeros((0, 3)))
    """where bones begin, world [m]"""
    rotation: Floats[B, D3, D3] = field(default_factory=lambda: np.zeros((0, 3, 3)))
    """bone → world; bones lie along y"""
    length: Floats[B] = field(default_factory=lambda: np.zeros(0))
    """[m]"""


@dataclass(frozen=True)
class Curve:
    """The course of a joint parameter over the recording [m, rad]; NaN where it is not known."""

    name: str
    values: Floats[F]
    std: Floats[F]
    other: Floats[F]
    """in the take that is compared"""
    truth: Floats[N]
    """(F,), or empty where there is none"""
    interval: tuple[float, float]
    """its limits"""


@dataclass(frozen=True)
class CurvesSnapshot:
    """Courses of joint parameters, from frame `start` on."""

    start: int
    fps: float
    curves: tuple[Curve, ...]
    take: int | None = None
    """that is compared"""
