"""How far joints are bent, from points alone: what a hand's angles are compared by, whatever model either side has."""

from __future__ import annotations

import numpy as np

from handtrack.arrays import D3, D21, F, Floats, N
from handtrack.diagnostics.constant_offsets import beside_other_half, mean_size
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
    """Return the mean error of the joints' flexion [°], as it is and beside each joint's own constant offset (two models call
    different points a knuckle; `beside_other_half`): of all, and of each joint; None where nothing is known.
    """
    off = flexion_deg(found) - flexion_deg(truth)
    beside = beside_other_half(off)
    each = [*enumerate(BENT_JOINTS)]
    return {
        "flexion_deg": mean_size(off),
        "flexion_offset_free_deg": mean_size(beside),
        **{f"flexion_{name}_deg": mean_size(off[:, k]) for k, name in each},
        **{f"flexion_{name}_offset_free_deg": mean_size(beside[:, k]) for k, name in each},
    }
