"""URDF → definition: a robot hand that is tracked by its own model."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from handtrack.arrays import D4, Floats
from handtrack.errors import HandtrackError
from handtrack.model.others.tree import (
    Hinge,
    Link,
    Shape,
    definition_of,
    ellipsoid_radii,
    mesh_shapes,
    numbers,
    read_root,
    rigid,
)

_TURNING = ("revolute", "continuous")
_LONG = {"radius": 1.0, "length": 0.5}
_SIZES = {"sphere": {"radius": 1.0}, "box": {"size": 0.5}, "cylinder": _LONG, "capsule": _LONG}
"""of shapes, by attribute: how much of it is what `ellipsoid_radii` takes"""
_Element = ElementTree.Element


def read_urdf(path: Path) -> dict[str, Any]:
    """Return the definition of a robot's URDF. Raises HandtrackError for what is none, or slides."""
    robot = read_root(path, "robot", "URDF (xacro expands it)")
    return definition_of(robot.get("name", path.stem), _links(robot, path), str(path))


def _links(robot: _Element, path: Path) -> list[Link]:
    """Return the links, parents first."""
    bodies = {_name(link, path): link for link in robot.iter("link")}
    joints = {_child(joint, "child", "link", path): joint for joint in robot.findall("joint")}
    above = {child: _child(joint, "parent", "link", path) for child, joint in joints.items()}
    for link in (*joints, *above.values()):
        if link not in bodies:
            raise HandtrackError(f"{path}: a joint names the link '{link}', which is not there.")
    roots = [name for name in bodies if name not in joints]
    if len(roots) != 1:
        raise HandtrackError(
            f"{path}: {len(roots)} links hang on no joint ({', '.join(roots[:5])}); expected one, the base."
        )
    ordered, waiting = list[Link](), [roots[0]]
    below: dict[str, list[str]] = {}
    for child, parent in above.items():
        below.setdefault(parent, []).append(child)
    while waiting:
        name = waiting.pop()
        ordered.append(_link(name, bodies[name], joints.get(name), above.get(name), path))
        waiting += reversed(below.get(name, []))
    return ordered


def _link(
    name: str, body: _Element, joint: _Element | None, parent: str | None, path: Path
) -> Link:
    seen = body.findall("visual") or body.findall("collision")
    shapes = [shape for visual in seen for shape in _shapes(visual, path)]
    if joint is None:
        return Link(name, None, np.eye(4), (), shapes)
    frame, label, kind = _origin(joint, path), _name(joint, path), joint.get("type", "")
    if kind == "fixed":
        return Link(name, parent, frame, (), shapes)
    if kind not in _TURNING:
        raise HandtrackError(
            f"{path}: joint '{label}' is {kind or 'of no type'}; expected revolute, continuous or fixed: this program's joints "
            "turn."
        )
    return Link(name, parent, frame, (_hinge(joint, label, kind, path),), shapes, label)


def _hinge(joint: _Element, label: str, kind: str, path: Path) -> Hinge:
    axis, limit, mimic = joint.find("axis"), joint.find("limit"), joint.find("mimic")
    about = numbers({} if axis is None else axis.attrib, "xyz", (1.0, 0.0, 0.0), path)
    low, high = -np.pi, np.pi
    if kind == "revolute":
        if limit is None:
            raise HandtrackError(
                f"{path}: joint '{label}' is revolute and has no <limit>; URDF asks for lower and upper [rad]."
            )
        low, high = (float(numbers(limit.attrib, k, (0.0,), path)[0]) for k in ("lower", "upper"))
    follows = None
    if mimic is not None:
        ratio, offset = (
            float(numbers(mimic.attrib, k, (d,), path)[0])
            for k, d in (("multiplier", 1.0), ("offset", 0.0))
        )
        if offset:
            raise HandtrackError(
                f"{path}: joint '{label}' follows another with an offset of {offset:g} rad; expected 0: move its origin instead."
            )
        follows = (mimic.get("joint", ""), ratio)
    return Hinge(label, about, (low, high), follows)


def _shapes(visual: _Element, path: Path) -> list[Shape]:
    frame, geometry = _origin(visual, path), visual.find("geometry")
    kind = geometry[0] if geometry is not None and len(geometry) else None
    if kind is None:
        return []
    if kind.tag == "mesh":
        file = path.parent / kind.get("filename", "").split("://")[-1]
        scale = numbers(kind.attrib, "scale", (1.0, 1.0, 1.0), path, 3)
        return mesh_shapes(file, scale, frame)
    if kind.tag not in _SIZES:
        return []
    size = [
        half * numbers(kind.attrib, key, None, path, 3 if key == "size" else 1)
        for key, half in _SIZES[kind.tag].items()
    ]
    return [Shape(frame, ellipsoid_radii(kind.tag, np.concatenate(size)))]


def _origin(element: _Element, path: Path) -> Floats[D4, D4]:
    origin = element.find("origin")
    given: Mapping[str, str] = {} if origin is None else origin.attrib
    turn = Rotation.from_euler("xyz", numbers(given, "rpy", (0.0, 0.0, 0.0), path, 3)).as_matrix()
    return rigid(numbers(given, "xyz", (0.0, 0.0, 0.0), path, 3), turn)


def _name(element: _Element, path: Path) -> str:
    name = element.get("name", "")
    if not name:
        raise HandtrackError(f"{path}: a <{element.tag}> has no name.")
    return name


def _child(joint: _Element, tag: str, key: str, path: Path) -> str:
    child = joint.find(tag)
    if child is None or not child.get(key):
        raise HandtrackError(f"{path}: joint '{joint.get('name', '')}' has no <{tag} {key}=…>.")
    return str(child.get(key))
