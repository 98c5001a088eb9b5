"""Where a camera's images are expected to show the hand, by the joints that were found in them."""

from __future__ import annotations

import numpy as np

from handtrack.arrays import D2, Floats
from handtrack.capture.masks.hand_seeds import HandSeeds, seeds_of_joints
from handtrack.session.seen.seen_keypoints import KeypointFiles

_BRIDGED = 3
"""frames without joints up to so many before or behind one with them: a tenth of a second at usual rates"""


class JointSeeds:
    """A camera's own frame → seeds; joints are taken on a straight way through short gaps."""

    def __init__(self, files: KeypointFiles) -> None:
        self._files = files

    def __call__(self, own_frame: int) -> HandSeeds | None:
        """Return the frame's seeds; None where the hand was not found, nor shortly before and after."""
        joints = self._files.as_taken(own_frame)
        if not joints:
            joints = self._bridged(own_frame)
        return seeds_of_joints(joints, self._files.camera.size)

    def _bridged(self, own_frame: int) -> dict[str, Floats[D2]]:
        ends = []
        for way in (-1, 1):
            near = [own_frame + way * step for step in range(1, _BRIDGED + 1)]
            found = [(n, joints) for n in near if (joints := self._files.as_taken(n))]
            if not found:
                return {}
            ends.append(found[0])
        (first, before), (last, after) = ends
        share = (own_frame - first) / (last - first)
        return {
            n: np.asarray((1 - share) * before[n] + share * after[n])
            for n in before.keys() & after.keys()
        }
