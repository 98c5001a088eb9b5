"""A pose, or a part of one, that was copied: kept as a file of the user's, so that another recording's page can paste it.

A left hand has the same parameter values for the mirrored pose (contracts §1), so what was copied from one side is mirrored by
being pasted to the other.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass

from handtrack.files.atomic import replace_text
from handtrack.files.user_folder import user_data_folder
from handtrack_app.page.panels.pose_words import group_of

ALL = "all"
"""what is copied of a whole pose; else one of the groups of sliders"""
_FILE = "copied_pose.json"
_MOST_M = 100.0  # nobody's hand is further from the world's origin; angles are far smaller


@dataclass(frozen=True)
class CopiedPose:
    """Joint parameters by name, and where they are from."""

    part: str
    """`ALL`, or a group: a finger, a limb"""
    session: str
    """the folder that the frame is of"""
    frame: int
    parameters: dict[str, float]
    """[m, rad]"""

    def pasted(self, names: Sequence[str], part: str, with_place: bool = False) -> dict[str, float]:
        """Return what it gives to a model of these parameters; empty where it has nothing that fits.

        part: `ALL`, or the group that is to get it: of a whole pose the same group's, of another finger's or the other side's
        limb joint by joint. with_place: where the hand is and how it is turned, too.
        """
        if part == ALL:
            return {
                name: value
                for name, value in self.parameters.items()
                if name in names and (with_place or not name.startswith("root_"))
            }
        source = part if self.part == ALL else self.part
        own = {name: value for name, value in self.parameters.items() if group_of(name) == source}
        given = {name.replace(_stem(source), _stem(part), 1): value for name, value in own.items()}
        return {n: value for n, value in given.items() if n in names and group_of(n) == part}


def _stem(group: str) -> str:
    """Return what the parameters of a group begin with; of a body's limbs, their side."""
    return group.lower().split()[0] + "_"


def save_copied(copied: CopiedPose) -> None:
    """Write it to the user's folder. Raises OSError."""
    user_data_folder().mkdir(parents=True, exist_ok=True)
    replace_text(user_data_folder() / _FILE, json.dumps({"format": 1, **asdict(copied)}) + "\n")


def read_copied() -> CopiedPose | None:
    """Return what was copied last, on whatever page; None where nothing was, or the file is not to be read."""
    with suppress(OSError, ValueError, TypeError, KeyError, AttributeError):
        said = json.loads((user_data_folder() / _FILE).read_text("utf-8"))
        values = {str(name): float(value) for name, value in said["parameters"].items()}
        if all(math.isfinite(v) and abs(v) < _MOST_M for v in values.values()):
            return CopiedPose(str(said["part"]), str(said["session"]), int(said["frame"]), values)
    return None
