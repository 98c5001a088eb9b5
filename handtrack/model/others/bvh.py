"""The hierarchy of a BVH → definition. Its motion is not read; BVH has no shapes and no limits, so both are made up."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from handtrack.errors import HandtrackError
from handtrack.files.text_files import read_text
from handtrack.model.others.tree import Hinge, Link, Shape, definition_of

UNIT_M = 0.01
"""of offsets, as most programs write BVH"""
_THICKNESS = 0.2
"""of the ellipsoid on a bone, beside its length: as fingers have it (16 mm of 40 mm, half of each); to be changed by hand"""
_AXES = {"X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0)}


def read_bvh(path: Path) -> dict[str, Any]:
    """Return the definition of a BVH's skeleton, its root in the root's frame. Raises HandtrackError for what is none."""
    words = read_text(path, "a BVH").partition("MOTION")[0].split()
    links, stack, i = list[Link](), list[Link](), 0
    if words[:1] != ["HIERARCHY"]:
        raise HandtrackError(f"{path}: it does not begin with HIERARCHY; expected a BVH.")
    try:
        while (i := i + 1) < len(words):
            word = words[i]
            if word in ("ROOT", "JOINT", "End"):
                name = words[i + 1] if word != "End" else f"{stack[-1].name}_end"
                parent = stack[-1].name if stack else None
                links.append(Link(name, parent, np.zeros(3), np.eye(3)))
                stack.append(links[-1])
                i += 2  # the name, and the brace
            elif word == "OFFSET":
                stack[-1].place = UNIT_M * np.array([float(n) for n in words[i + 1 : i + 4]])
                i += 3
            elif word == "CHANNELS":
                count = int(words[i + 1])
                turns = [c for c in words[i + 2 : i + 2 + count] if c.endswith("rotation")]
                if stack[-1].parent is not None:
                    own = stack[-1].name
                    stack[-1].hinges = [Hinge(f"{own}_{t[0].lower()}", np.array(_AXES[t[0]])) for t in turns]  # fmt: skip
                i += 1 + count
            elif word == "}":
                stack.pop()
            else:
                raise ValueError(word)
    except (ValueError, IndexError, KeyError) as error:
        raise HandtrackError(f"{path}: its hierarchy cannot be read near {error}; expected ROOT, JOINT, End Site, OFFSET, CHANNELS.") from None  # fmt: skip
    by_name = {link.name: link for link in links}
    for link in links:
        if link.parent is not None:
            _add_flesh(by_name[link.parent], link)
    return definition_of(path.stem, links, str(path))


def _add_flesh(link: Link, child: Link) -> None:
    """Add an ellipsoid from a link's joint to a child's."""
    half = 0.5 * float(np.linalg.norm(child.place))
    if half <= 0:
        return
    along = child.place / (2 * half)
    side = np.eye(3)[int(np.argmin(np.abs(along)))]
    across = np.cross(along, side)
    across /= np.linalg.norm(across)
    turn = np.stack([across, along, np.cross(across, along)], axis=1)
    radii = half * np.array([2 * _THICKNESS, 1.0, 2 * _THICKNESS])
    link.shapes.append(Shape(child.place / 2, turn, radii))
