"""Move and turn the whole hand along the axes of the view that the user looks from."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from handtrack.arrays import Floats
from handtrack.geometry.rotation import rotation_matrix, rotation_vector

ROOT = ("root_tx", "root_ty", "root_tz", "root_rx", "root_ry", "root_rz")


class Nudge(NamedTuple):
    """A step along a view's axes: to the right, down, away from the viewer; moved by a length or turned by an angle."""

    move: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0)


NUDGES: dict[str, Nudge] = {
    "left": Nudge(move=(-1, 0, 0)),
    "right": Nudge(move=(1, 0, 0)),
    "up": Nudge(move=(0, -1, 0)),
    "down": Nudge(move=(0, 1, 0)),
    "nearer": Nudge(move=(0, 0, -1)),
    "farther": Nudge(move=(0, 0, 1)),
    "roll left": Nudge(turn=(0, 0, -1)),
    "roll right": Nudge(turn=(0, 0, 1)),
    "tilt up": Nudge(turn=(-1, 0, 0)),
    "tilt down": Nudge(turn=(1, 0, 0)),
    "turn left": Nudge(turn=(0, 1, 0)),
    "turn right": Nudge(turn=(0, -1, 0)),
}


def nudged(
    root: Floats, nudge: Nudge, view: Floats, pivot: Floats, step_m: float, step_rad: float
) -> dict[str, float]:
    """Return root parameters by name after a nudge.

    root: (6,) [m, rad]. view: (3, 3) rotation from the view's axes (x right, y down, z away) to the world.
    pivot: (3,) world [m], the point that stays when the hand turns.
    """
    rotation = rotation_matrix(view @ np.array(nudge.turn, dtype=float) * step_rad)
    moved = view @ np.array(nudge.move, dtype=float) * step_m
    place = pivot + rotation @ (root[:3] - pivot) + moved
    turned = rotation_vector(rotation @ rotation_matrix(root[3:6]))
    return dict(zip(ROOT, [*place.tolist(), *turned.tolist()], strict=True))
