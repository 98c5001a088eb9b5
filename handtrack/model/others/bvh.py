"""The hierarchy of a BVH → definition. Its motion is not read; BVH has no shapes and no limits, so both are made up."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from handtrack.files.bvh_hierarchy import read_hierarchy
from handtrack.files.text_files import read_text
from handtrack.geometry.rotation import axes_along
from handtrack.model.others.tree import Hinge, Link, Shape, definition_of, rigid

UNIT_M = 0.01
"""of offsets, as most programs write BVH"""
_THICKNESS = 0.2
"""of the ellipsoid on a bone, beside its length: as fingers have it (16 mm of 40 mm, half of each); to be changed by hand"""


def read_bvh(path: Path) -> dict[str, Any]:
    """Return the definition of a BVH's skeleton, its root in the root's frame. Raises HandtrackError for what is none."""
    joints, _ = read_hierarchy(read_text(path, "a BVH").splitlines(), path)
    links = dict[str, Link]()
    for joint in joints:
        parent = joints[joint.parent].name if joint.parent >= 0 else None
        turns = [c[0] for c in joint.channels if c.endswith("rotation")] if parent else []
        hinges = [Hinge(f"{joint.name}_{axis}", np.eye(3)["xyz".index(axis)]) for axis in turns]
        along = UNIT_M * joint.offset
        links[joint.name] = Link(joint.name, parent, rigid(along), hinges)
        if parent and along.any():
            axes = axes_along(along, np.eye(3)[int(np.argmin(np.abs(along)))])
            radii = 0.5 * np.linalg.norm(along) * np.array([2 * _THICKNESS, 1.0, 2 * _THICKNESS])
            links[parent].shapes.append(Shape(rigid(0.5 * along, axes), radii))
    return definition_of(path.stem, [*links.values()], str(path))
