"""MotionClip: joint positions over time, and which of a file's joints are the body model's."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from handtrack.arrays import D3, F, Floats, J
from handtrack.errors import unknown_name


@dataclass(frozen=True)
class MotionClip:
    """What a motion capture file says of where joints are."""

    names: tuple[str, ...]
    """(J,) of the file's joints; a second end of the same joint is `<name>_end`"""
    positions: Floats[F, J, D3]
    """[m], the file's own axes"""
    fps: float
    """frames a second"""
    turns: Floats[F, J, D3, D3] | None = None
    """how each joint is turned in the file's axes, from its zero pose; None where the file does not say it"""

    def renamed(self, names: Mapping[str, str]) -> MotionClip:
        """Return only the joints that `names` lists (new name → the file's), under their new names."""
        for name in names.values():
            if name not in self.names:
                raise unknown_name("joint", name, self.names, "the motion file")
        columns = [self.names.index(name) for name in names.values()]
        return MotionClip(tuple(names), self.positions[:, columns], self.fps)

    def resampled(self, fps: float) -> MotionClip:
        """Return the clip at another frame rate, places interpolated linearly."""
        count = int((len(self.positions) - 1) / self.fps * fps)
        at = np.arange(count) * self.fps / fps
        before = at.astype(int)
        share = (at - before)[:, None, None]
        places = (1 - share) * self.positions[before] + share * self.positions[before + 1]
        return MotionClip(self.names, places, fps)


def _both_sides(pairs: Mapping[str, tuple[str, str]]) -> dict[str, str]:
    return {
        f"{side}_{ours}": theirs[i]
        for i, side in enumerate(("left", "right"))
        for ours, theirs in pairs.items()
    }


BANDAI_JOINTS: dict[str, str] = {
    "chest": "Chest",
    "neck": "Neck",
    "head": "Head",
    **_both_sides(
        {
            "shoulder": ("UpperArm_L", "UpperArm_R"),
            "elbow": ("LowerArm_L", "LowerArm_R"),
            "wrist": ("Hand_L", "Hand_R"),
            "hip": ("UpperLeg_L", "UpperLeg_R"),
            "knee": ("LowerLeg_L", "LowerLeg_R"),
            "ankle": ("Foot_L", "Foot_R"),
            "toe": ("Toes_L", "Toes_R"),
        }
    ),
}
"""joints of body34 → those of the Bandai Namco Research motion data"""

CMU_JOINTS: dict[str, str] = {
    "chest": "upperback",
    "neck": "lowerneck",
    "head": "upperneck",
    **_both_sides(
        {
            "shoulder": ("lclavicle", "rclavicle"),
            "elbow": ("lhumerus", "rhumerus"),
            "wrist": ("lradius", "rradius"),
            "hip": ("lhipjoint", "rhipjoint"),
            "knee": ("lfemur", "rfemur"),
            "ankle": ("ltibia", "rtibia"),
            "toe": ("lfoot", "rfoot"),
        }
    ),
}
"""joints of body34 → bones of the CMU motion capture database whose ends they are"""

CMU_WRIST_JOINTS: dict[str, str] = CMU_JOINTS | _both_sides(
    {"wrist": ("lwrist", "rwrist"), "hand": ("lfingers", "rfingers")}
)
"""the same of body38: a CMU forearm is two bones in line, of which the second only rolls; the wrist bends after it"""
