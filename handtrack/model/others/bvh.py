"""The hierarchy of a BVH → definition. Its motion is not read; BVH has no shapes and no limits, so both are made up."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from handtrack.files.bvh_hierarchy import read_hierarchy
from handtrack.files.text_files import read_text
from handtrack.model.others.tree import Hinge, Link, Shape, definition_of

UNIT_M = 0.01
"""of offsets, as most programs write BVH"""
_THICKNESS = 0.2
"""of the ellipsoid on a bone, beside its length: as fingers have it (16 mm of 40 mm, half of each); to be changed by hand"""


def read_bvh(path: Path) -> dict[str, Any]:
    """Return the definition of a BVH's skeleton, its root in the root's frame. Raises HandtrackError for what is none."""
    joints, _ = read_hierarchy(read_text(path, "a BVH").splitlines(), path)
    links = list[Link]()
    for joint in joints:
        parent = joints[joint.parent].name if joint.parent >= 0 else None
        turns = [c[0] for c in joint.channels if c.endswith("rotation")] if parent else []
        hinges = [Hinge(f"{joint.name}_{axis}", np.eye(3)["xyz".index(axis)]) for axis in turns]
        links.append(Link(joint.name, parent, UNIT_M * joint.offset, np.eye(3), hinges=hinges))
    by_name = {link.name: link for link in links}
    for link in links:
        if link.parent is not None:
            _add_ellipsoid(by_name[link.parent], link)
    return definition_of(path.stem, links, str(path))


def _add_ellipsoid(link: Link, child: Link) -> None:
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
