"""The hierarchy of a BVH file, joints with offsets and channels; and it → definition: BVH has no shapes and no limits, so both are made up."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from handtrack.arrays import D3, Floats
from handtrack.errors import HandtrackError
from handtrack.files.text_files import read_text
from handtrack.geometry.rotation import axes_along
from handtrack.model.others.tree import Hinge, Link, Shape, definition_of, rigid

# ---- The hierarchy


@dataclass(frozen=True)
class BvhJoint:
    name: str
    parent: int
    """its index; -1 of a root"""
    offset: Floats[D3]
    """in its parent, in the file's unit"""
    channels: tuple[str, ...]
    """in small letters"""
    first: int
    """its first column among the frame's numbers"""


def read_hierarchy(lines: list[str], path: Path) -> tuple[list[BvhJoint], int]:
    """Return the joints, parents first (an end site is `<joint>_end`), and the line of MOTION. Raises HandtrackError naming the line."""
    joints: list[BvhJoint] = []
    open_joints: list[int] = []
    column = 0
    for number, line in enumerate(lines):
        words = line.split()
        if not words or words[0] in ("HIERARCHY", "{"):
            continue
        if words[0] == "MOTION":
            if joints and not open_joints:
                return joints, number
            raise wrong_line(path, number, "MOTION after a closed HIERARCHY", line)
        if words[0] in ("ROOT", "JOINT", "End"):
            parent = open_joints[-1] if open_joints else -1
            name = f"{joints[parent].name}_end" if words[0] == "End" else " ".join(words[1:])
            open_joints.append(len(joints))
            joints.append(BvhJoint(name, parent, np.zeros(3), (), column))
        elif words[0] == "}" and open_joints:
            open_joints.pop()
        elif words[0] == "OFFSET" and open_joints:
            offset = np.array(numbers_of(words[1:], 3, path, number, line))
            joints[open_joints[-1]] = replace(joints[open_joints[-1]], offset=offset)
        elif words[0] == "CHANNELS" and open_joints:
            channels = tuple(word.lower() for word in words[2:])
            odd = [
                c for c in channels if c[:1] not in "xyz" or c[1:] not in ("position", "rotation")
            ]
            if odd or len(words) < 2 or words[1] != str(len(channels)):
                raise wrong_line(
                    path, number, "CHANNELS, their number, and Xposition … Zrotation", line
                )
            joints[open_joints[-1]] = replace(
                joints[open_joints[-1]], channels=channels, first=column
            )
            column += len(channels)
        else:
            raise wrong_line(
                path, number, "ROOT, JOINT, End Site, OFFSET, CHANNELS, braces or MOTION", line
            )
    raise HandtrackError(f"{path}: no line MOTION; is this a whole BVH file?")


def numbers_of(words: list[str], count: int, path: Path, number: int, line: str) -> list[float]:
    try:
        values = [float(word) for word in words]
    except ValueError:
        raise wrong_line(path, number, f"{count} numbers", line) from None
    if len(values) != count:
        raise wrong_line(path, number, f"{count} numbers", line)
    return values


def wrong_line(path: Path, number: int, expected: str, line: str) -> HandtrackError:
    return HandtrackError(
        f"{path}, line {number + 1}: expected {expected}; found '{line.strip()[:60]}'."
    )


# ---- A definition of it


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
