"""The unit of a calibration, inferred from the rig: what is tracked must be seen at a usual size where the cameras look."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from handtrack.arrays import D3, C, Floats
from handtrack.geometry.camera import CameraRig

UNITS_M = {1.0: "metres", 0.001: "millimetres"}
"""those that calibrations are written in and that cannot be taken for one another; others must be said"""
_SEEN = (0.05, 1.5)  # of the image's smaller side: less is too small to track, more does not fit in
_SIDE_BY_SIDE = (
    1 / 18,
    10 / 3,
)  # between cameras that look one way, in sizes of what both see: 1 to 60 cm for hands
_PARALLEL = 0.005  # least eigenvalue of Σ(1 − a aᵀ)/C: below, axes within some 6° meet nowhere


def likely_units(rig: CameraRig, size_m: float) -> list[float]:
    """Return which units, metres each, a rig with translations in file units may have; all where nothing depends on it.

    size_m: of what is tracked.
    """
    centres = np.array([camera.centre for camera in rig])
    apart = [float(np.linalg.norm(a - b)) for a, b in combinations(centres, 2)]
    if not apart or max(apart) == 0:
        return [1.0]
    depths = _depths(centres, np.array([camera.rotation[2] for camera in rig]))
    if depths is None:
        low, high = (share * size_m for share in _SIDE_BY_SIDE)
        return [unit for unit in UNITS_M if low <= max(apart) * unit <= high]
    spans = np.array([camera.focal_px / min(camera.size) for camera in rig]) * size_m
    share = float(np.median(spans / depths))
    return [unit for unit in UNITS_M if _SEEN[0] <= share / unit <= _SEEN[1]]


def rig_in_words(rig: CameraRig) -> str:
    """Return how far cameras stand apart, and what they look at, in file units."""
    centres = np.array([camera.centre for camera in rig])
    apart = [float(np.linalg.norm(a - b)) for a, b in combinations(centres, 2)]
    depths = _depths(centres, np.array([camera.rotation[2] for camera in rig]))
    words = _range(apart, "apart")
    return (
        words
        if depths is None
        else f"{words}, and look at a place {_range(depths.tolist(), 'away')}"
    )


def _range(values: Sequence[float], word: str) -> str:
    low, high = min(values), max(values)
    return f"{low:.3g} {word}" if high < 1.01 * low else f"{low:.3g} to {high:.3g} {word}"


def _depths(centres: Floats[C, D3], axes: Floats[C, D3]) -> Floats[C] | None:
    """Return how far before each camera all axes come nearest; None where they meet nowhere in front."""
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    total = across.sum(axis=0)
    if np.linalg.eigvalsh(total)[0] < _PARALLEL * len(axes):
        return None
    point = np.linalg.solve(total, np.einsum("cij,cj->i", across, centres))
    depths = np.einsum("cj,cj->c", axes, point - centres)
    return depths if (depths > 0).all() else None
