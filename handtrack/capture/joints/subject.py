"""How large what is tracked is, a hand or a body: what a calibration's unit can be told by."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from handtrack.arrays import D3, Floats, K, evenly_spread
from handtrack.capture.images.openpose import Layout
from handtrack.geometry.camera import CameraRig
from handtrack.geometry.triangulation import triangulated

_MOST = 60  # frames that are asked
_LEAST_ANGLE = 0.045  # [rad] between rays


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

    @property
    def range_words(self) -> str:
        """The same in words."""
        low, high = (100 * length for length in self.range_m)
        return f"{low:.0f} to {high:.0f} cm" + (
            ", ankle to shoulder" if self.word == "body" else ""
        )

    def fits(self, length_m: float) -> bool:
        """Return whether somebody may be so long."""
        return self.range_m[0] <= length_m <= self.range_m[1]


HAND = Subject(
    "hand",
    0.18,
    (("wrist", "middle_mcp", "middle_pip", "middle_dip", "middle_tip"),),
    0.18,
    (0.06, 0.25),
)
# from ankle to shoulder along the bones is 0.78 of stature in body34 (de Leva 1996); statures of 0.75 to 2.2 m
BODY = Subject(
    "body",
    1.75,
    tuple((f"{s}_ankle", f"{s}_knee", f"{s}_hip", f"{s}_shoulder") for s in ("left", "right")),
    1.36,
    (0.58, 1.72),
)


def subject_length(
    rig: CameraRig,
    joints: Mapping[str, Mapping[int, Floats[K, D3]]],
    layouts: Mapping[str, Layout],
    subject: Subject,
) -> float | None:
    """Return its length along the bones, in the rig's unit, the median of some frames and of its
    chains.

    None where no frame has all of a chain in two cameras.

    Parameters
    ----------
    joints
        By camera and frame, [px] in the image as it was taken.
    layouts
        Of each camera's.
    """
    every = sorted({frame for frames in joints.values() for frame in frames})
    lengths = []
    for frame in (every[i] for i in evenly_spread(len(every), _MOST)):
        seen = {name: frames[frame] for name, frames in joints.items() if frame in frames}
        for chain in subject.chains:
            rows = {name: [layouts[name].points[joint] for joint in chain] for name in seen}
            pixels = np.array([points[rows[name], :2] for name, points in seen.items()])
            placed = triangulated([rig[name] for name in seen], pixels, _LEAST_ANGLE)
            if np.isfinite(placed).all():
                lengths.append(float(np.linalg.norm(np.diff(placed, axis=0), axis=1).sum()))
    return float(np.median(lengths)) if lengths else None
