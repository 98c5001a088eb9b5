"""Errors beside a constant offset, which two definitions of the same point have: fitted on one half of the frames, applied to the other."""

from __future__ import annotations

import numpy as np

from handtrack.arrays import D3, Array, Axes, F, Floats, N


def beside_other_half(errors: Floats[F, *Axes]) -> Floats[F, *Axes]:
    """Return errors beside the median of those in the other half of the frames, in time: neighbouring frames err alike, so that a
    median of every second frame would know what it is applied to. NaN where unknown, or where the other half knows nothing.
    """
    half = len(errors) // 2
    first, second = errors[:half], errors[half:]
    return np.concatenate([first - _median(second), second - _median(first)])


def offset_free_errors(
    found: Floats[F, N, D3], truth: Floats[F, N, D3], turns: Floats[F, N, D3, D3]
) -> Floats[F, N]:
    """Return how far points are off beside each one's constant offset in its bone's frame, in their unit; NaN where unknown.

    turns: bone → world of the bone that carries each point.
    """
    own = np.einsum("fnji,fnj->fni", turns, truth - found)
    return np.linalg.norm(beside_other_half(own), axis=2)


def _median(values: Array[F, *Axes]) -> Floats[*Axes]:
    flat = values.reshape(len(values), int(np.prod(values.shape[1:])))
    known = np.isfinite(flat)
    medians = [np.median(c[k]) if k.any() else np.nan for c, k in zip(flat.T, known.T, strict=True)]
    return np.reshape(medians, values.shape[1:])


def mean_size(errors: Floats[*Axes]) -> float | None:
    """Return the mean size of the errors that are known; None where none is."""
    known = np.isfinite(errors)
    return float(np.abs(errors[known]).mean()) if known.any() else None
