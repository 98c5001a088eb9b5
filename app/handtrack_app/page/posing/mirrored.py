"""A pose as in a mirror: left and right, as they are seen, change places."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from handtrack.arrays import D3, Floats, S
from handtrack.geometry.rotation import rotation_matrix, rotation_vector

_ACROSS = np.diag([-1.0, 1.0, 1.0])
"""of a hand's and a body's own axes: x goes from side to side"""
_SIGNED = ("lean", "twist")
"""motions of the trunk to one side; limbs have them away from the middle, alike on both sides"""


def mirrored(
    names: Sequence[str], values: Floats[S], right: Floats[D3], middle: Floats[D3]
) -> dict[str, float]:
    """Return joint parameters by name of the mirror image in the plane through a point.

    values: [m, rad]. right: unit vector to the viewer's right, world; the plane is upright to it. middle: world [m]. A hand keeps
    its fingers' values, which on the other side's hand would be the image's; of a body the limbs change sides.
    """
    mirror = np.eye(3) - 2.0 * np.outer(right, right)
    root = dict(zip(names, values.tolist(), strict=True))
    place = middle + mirror @ (values[:3] - middle)
    turn = rotation_vector(mirror @ rotation_matrix(values[3:6]) @ _ACROSS)
    found = dict(zip(names[:6], [*place.tolist(), *turn.tolist()], strict=True))
    for name in names[6:]:
        side, _, rest = name.partition("_")
        other = {"left": "right", "right": "left"}.get(side)
        if other is not None:
            found[f"{other}_{rest}"] = root[name]
        else:
            trunk = side in ("spine", "neck") and name.endswith(_SIGNED)
            found[name] = -root[name] if trunk else root[name]
    return found
