"""How large what is tracked is, a hand or a body: what a calibration's unit can be told by."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from handtrack.arrays import D3, Floats, K
from handtrack.capture.images.openpose import Layout
from handtrack.geometry.camera import CameraRig

_MOST = 60  # frames that are asked
_PARALLEL = 1e-3  # least eigenvalue of Σ(1 − a aᵀ): rays some 2° apart


@dataclass(frozen=True)
class Subject:
    """What is tracked, in sizes of people."""

    word: str
    size_m: float
    """of an adult, as it fills the image"""
    chains: tuple[tuple[str, ...], ...]
    """joints along which its length is measured"""
    usual_m: float
    """of that length, an adult's"""
    range_m: tuple[float, float]
    """of that length, a small child's to a large man's; less than a factor of ten, so that one unit fits at most"""
    range_words: str

    def fits(self, length_m: float) -> bool:
        """Return whether somebody may be so long."""
        return self.range_m[0] <= length_m <= self.range_m[1]


HAND = Subject(
    "hand",
    0.18,
    (("wrist", "middle_mcp", "middle_pip", "middle_dip", "middle_tip"),),
    0.18,
    (0.06, 0.25),
    "6 to 25 cm",
)
# from ankle to shoulder along the bones is 0.78 of stature in body34 (de Leva 1996); statures of 0.75 to 2.2 m
BODY = Subject(
    "body",
    1.75,
    tuple((f"{s}_ankle", f"{s}_knee", f"{s}_hip", f"{s}_shoulder") for s in ("left", "right")),
    1.36,
    (0.58, 1.72),
    "58 to 172 cm, ankle to shoulder",
)


def subject_length(
    rig: CameraRig,
    joints: Mapping[str, Mapping[int, Floats[K, D3]]],
    layouts: Mapping[str, Layout],
    subject: Subject,
) -> float | None:
    """Return its length along the bones, in the rig's unit, the median of some frames and of its chains.

    joints: by camera and frame, [px] in the image as it was taken; layouts: of each camera's. None where no frame has all of a
    chain in two cameras.
    """
    every = sorted({frame for frames in joints.values() for frame in frames})
    chosen = (
        [every[i] for i in np.unique(np.linspace(0, len(every) - 1, _MOST).astype(int))]
        if every
        else []
    )
    lengths = []
    for frame in chosen:
        seen = {name: frames[frame] for name, frames in joints.items() if frame in frames}
        for chain in subject.chains:
            points = [
                _point(rig, {n: p[layouts[n].points[joint], :2] for n, p in seen.items()})
                for joint in chain
            ]
            if all(point is not None for point in points):
                lengths.append(
                    float(np.linalg.norm(np.diff(np.array(points), axis=0), axis=1).sum())
                )
    return float(np.median(lengths)) if lengths else None


def _point(rig: CameraRig, pixels: Mapping[str, Floats[K]]) -> Floats[D3] | None:
    """Return where viewing rays come nearest to each other."""
    total, right = np.zeros((3, 3)), np.zeros(3)
    for name, pixel in pixels.items():
        ray = rig[name].rays(pixel)
        if np.isfinite(ray).all():
            across = np.eye(3) - np.outer(ray, ray)
            total, right = total + across, right + across @ rig[name].centre
    if np.linalg.eigvalsh(total)[0] < _PARALLEL:
        return None
    return np.linalg.solve(total, right)
