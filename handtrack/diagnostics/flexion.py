"""How far joints are bent, from points alone: what a hand's angles are compared by, whatever model either side has."""

from __future__ import annotations

import numpy as np

from handtrack.arrays import D3, D21, F, Floats, N
from handtrack.model.articulated import FINGERS, keypoint_names

_KEYPOINTS = keypoint_names()
_CHAINS = [
    [0, *(n for n, name in enumerate(_KEYPOINTS) if name.startswith(f"{f}_"))] for f in FINGERS
]
_BENT = [triple for chain in _CHAINS for triple in zip(chain, chain[1:], chain[2:], strict=False)]
BENT_JOINTS = tuple(_KEYPOINTS[joint] for _, joint, _ in _BENT)
"""three a finger, from the palm out"""


def flexion_deg(keypoints21: Floats[F, D21, D3]) -> Floats[F, N]:
    """Return by how much the way along each finger turns at its joints [°], 0 where straight; NaN where a point is unknown.

    Between wrist, joint and next joint: a knuckle's spread counts with its bending.
    """
    before, here, after = (keypoints21[:, list(part)] for part in zip(*_BENT, strict=True))
    came, goes = here - before, after - here
    lengths = np.linalg.norm(came, axis=2) * np.linalg.norm(goes, axis=2)
    with np.errstate(invalid="ignore", divide="ignore"):
        cosine = (came * goes).sum(axis=2) / lengths
    return np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0)))


def flexion_errors(
    found: Floats[F, D21, D3], truth: Floats[F, D21, D3]
) -> dict[str, float | int | None]:
    """Return the mean error of the joints' flexion [°]: of all, of all beside each joint's own constant offset (two models
    call different points a knuckle), and of each joint; None where nothing is known.
    """
    off = flexion_deg(found) - flexion_deg(truth)
    known = np.isfinite(off)
    beside = np.array([_beside_median(column) for column in off.T]).T
    each = {
        f"flexion_{name}_deg": float(np.abs(column[ok]).mean()) if ok.any() else None
        for name, column, ok in zip(BENT_JOINTS, off.T, known.T, strict=True)
    }
    return {
        "flexion_deg": float(np.abs(off[known]).mean()) if known.any() else None,
        "flexion_offset_free_deg": float(np.abs(beside[known]).mean()) if known.any() else None,
        **each,
    }


def _beside_median(values: Floats[F]) -> Floats[F]:
    known = np.isfinite(values)
    return values - np.median(values[known]) if known.any() else values
