"""A robot or a skeleton as other programs describe it: links on joints, with ellipsoids for their shapes, from which a definition is made."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from handtrack.arrays import D3, D4, Axes, Floats, K
from handtrack.errors import HandtrackError
from handtrack.files.text_files import read_xml
from handtrack.geometry.rotation import axes_along, rotation_vector

_SHORTEST_M = 1e-4
"""between two joints, for the line between them to be a bone's direction"""
_STUB_M = 0.01
"""of a bone on which nothing stands, and which has no shape"""


def rigid(place: Floats[D3], turn: Floats[D3, D3] = np.eye(3)) -> Floats[D4, D4]:
    """Return the transform that turns, then moves by a place [m]."""
    frame = np.eye(4)
    frame[:3, :3], frame[:3, 3] = turn, place
    return frame


@dataclass(frozen=True)
class Shape:
    """An ellipsoid on a link."""

    frame: Floats[D4, D4]
    """its axes → the link's frame [m]"""
    radii: Floats[D3]
    """[m]"""


@dataclass
class Link:
    """A rigid body, and the hinges by which it turns on its parent."""

    name: str
    parent: str | None
    frame: Floats[D4, D4]
    """link → parent, hinges at zero [m]"""
    hinges: Sequence[Hinge] = ()
    """in the order in which they act: the second about the axis that the first carried along"""
    shapes: list[Shape] = field(default_factory=list)
    label: str = ""
    """what the joint is called; the link's name where it has none"""


@dataclass(frozen=True)
class Hinge:
    """One freedom; about an axis through the link's origin."""

    name: str
    axis: Floats[D3]
    """in the link's frame, of any length"""
    limits: tuple[float, float] = (-np.pi, np.pi)
    """[rad]"""
    follows: tuple[str, float] | None = None
    """another hinge and the ratio, where it follows one"""


def definition_of(name: str, links: Sequence[Link], where: str) -> dict[str, Any]:
    """Return a definition's tables (docs/reference/definitions.md), the root link's frame as the
    hand's.

    Parents come first.

    Links that cannot turn belong to what they stand on; those without a shape are named joints
    there, as fingertips are in many files.

    Parameters
    ----------
    where
        Names the file in errors.

    Raises
    ------
    HandtrackError
        Where nothing turns, or nothing has a shape; for an axis of no length, and limits that are exchanged.
    """
    _check(links, where)
    frames, carrier = _zero_pose(links)
    bones, ellipsoids, joints = [], [], dict[str, Any]()
    for link in (link for link in links if link.parent is None or link.hinges):
        here, turn = frames[link.name][:3, 3], frames[link.name][:3, :3]
        own = [one for one in links if carrier[one.name] == link.name]
        above = [one for one in links if one.parent and carrier[one.parent] == link.name]
        ahead = [frames[one.name][:3, 3] for one in above]
        shapes = [(frames[one.name] @ s.frame, s.radii) for one in own for s in one.shapes]
        tail = _tail(link, here, turn, ahead, [frame[:3, 3] for frame, _ in shapes])
        up = _across(tail - here, turn)
        axes = np.eye(3) if link.parent is None else axes_along(tail - here, up)
        to_bone = np.linalg.inv(rigid(here, axes))
        bones.append(_bone(link, carrier, here, tail, up, to_bone[:3, :3] @ turn))
        for frame, radii in shapes:
            placed = to_bone @ frame
            ellipsoids.append(
                {
                    "bone": link.name,
                    "centre": _mm(placed[:3, 3]),
                    "radii": _mm(radii),
                    "rotation_deg": _rounded(np.rad2deg(rotation_vector(placed[:3, :3]))),
                }
            )
        joints[link.label or link.name] = [link.name, "head"]
        for one in own:
            if one is not link and not one.shapes:
                joints[one.name] = [link.name, _mm((to_bone @ frames[one.name])[:3, 3])]
        if not ahead and link.parent is not None:
            joints[f"{link.name}_tip"] = [link.name, "tail"]
    if not ellipsoids:
        raise HandtrackError(
            f"{where}: no link has a shape that is read (sphere, capsule, cylinder, box, ellipsoid, or a mesh that is there), so "
            "nothing of it would be seen in a silhouette. Add a <visual> to each."
        )
    follows = [
        {"name": hinge.name, "leader": hinge.follows[0], "ratio": hinge.follows[1]}
        for link in links
        for hinge in link.hinges
        if hinge.follows
    ]
    reach = max(float(np.linalg.norm(frame[:3, 3])) for frame in frames.values())
    table = {
        "format": 1,
        "name": name,
        "kind": "hand",
        "length_mm": max(round(1e3 * reach, 3), 1.0),
        "bone": bones,
        "joints": joints,
        "ellipsoids": {"fine": ellipsoids, "metaballs": ellipsoids},
    }
    return table | ({"couplings": {"21": follows}} if follows else {})


def _check(links: Sequence[Link], where: str) -> None:
    hinges = [hinge for link in links for hinge in link.hinges]
    if not hinges:
        raise HandtrackError(f"{where}: nothing in it turns; expected at least one hinge.")
    named = {"links": [link.name for link in links], "joints": [hinge.name for hinge in hinges]}
    for kind, names in named.items():
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise HandtrackError(
                f"{where}: two {kind} are called '{twice}'; expected names that differ."
            )
    for hinge in hinges:
        low, high = hinge.limits
        if np.linalg.norm(hinge.axis) < 1e-9:
            raise HandtrackError(f"{where}: joint '{hinge.name}' has an axis of length 0.")
        if low > high:
            raise HandtrackError(
                f"{where}: joint '{hinge.name}': its limits are {low:g} to {high:g} rad; expected lower ≤ upper."
            )


def _zero_pose(links: Sequence[Link]) -> tuple[dict[str, Floats], dict[str, str]]:
    """Return each link's frame, link → root, and the moving link that carries it."""
    frames, carrier = dict[str, Floats](), dict[str, str]()
    for link in links:
        frames[link.name], carrier[link.name] = np.eye(4), link.name
        if link.parent is not None:
            frames[link.name] = frames[link.parent] @ link.frame
            if not link.hinges:
                carrier[link.name] = carrier[link.parent]
    return frames, carrier


def _tail(
    link: Link, here: Floats, turn: Floats, ahead: Sequence[Floats], centres: Sequence[Floats]
) -> Floats[D3]:
    """Return where a bone ends: at the middle of what stands on it, as far beyond its shapes' middle as that is from the joint,
    or nearby. The root lies along its own y.
    """
    far = [p for p in ahead if np.linalg.norm(p - here) > _SHORTEST_M]
    end = np.mean(far, axis=0) if far else None
    if end is None and centres:
        end = here + 2.0 * (np.mean(centres, axis=0) - here)
    length = 0.0 if end is None else float(np.linalg.norm(end - here))
    if link.parent is None:
        return here + np.array([0.0, max(length, _STUB_M), 0.0])
    if end is not None and length > _SHORTEST_M:
        return end
    return here + _STUB_M * _across(turn @ link.hinges[0].axis, turn)


def _across(direction: Floats[D3], turn: Floats[D3, D3]) -> Floats[D3]:
    """Return the axis of the link's own frame, z before x before y, that is most nearly square to a direction."""
    along = np.abs(turn.T @ direction) / np.linalg.norm(direction)
    order = (2, 0, 1)
    best = min(order, key=lambda axis: (round(float(along[axis]), 6), order.index(axis)))
    return turn[:, best]


def _bone(
    link: Link, carrier: Mapping[str, str], here: Floats, tail: Floats, up: Floats, own: Floats
) -> dict[str, Any]:
    """Return a bone's table. own: link → bone."""
    if link.parent is None:
        up = np.array([0.0, 0.0, 1.0])
    row: dict[str, Any] = {"name": link.name} | (
        {"parent": carrier[link.parent]} if link.parent else {}
    )
    row |= {"group": "palm", "head": _mm(here), "tail": _mm(tail), "up": _rounded(up)}
    if link.hinges:
        row["freedoms"] = [
            {
                "name": hinge.name,
                "axis": _rounded(own @ hinge.axis / np.linalg.norm(hinge.axis)),
                "limits_deg": _rounded(np.rad2deg(hinge.limits)),
                "rest_deg": float(np.round(np.rad2deg(np.clip(0.0, *hinge.limits)), 9)),
            }
            for hinge in link.hinges
        ]
    return row


def _mm(metres: Floats) -> list[float]:
    return _rounded(1e3 * np.asarray(metres))


def _rounded(values: Any) -> list[float]:
    """Return numbers to nine decimals, as a file holds them; no zero has a sign."""
    return [float(value) for value in np.round(np.asarray(values, float), 9) + 0.0]


def read_root(path: Path, tag: str, what: str) -> ElementTree.Element:
    """Return a file's root element, which has this tag. Raises HandtrackError for no XML, another root, or entities."""
    root = read_xml(path, f"a robot's {what}")
    if root.tag != tag:
        raise HandtrackError(
            f"{path}: its root is <{root.tag}>; expected <{tag}>, as {what} has it."
        )
    return root


def numbers(
    given: Mapping[str, str], key: str, default: Sequence[float] | None, path: Path, count: int = 0
) -> Floats[*Axes]:
    """Return an attribute's numbers; the default where it is not given.

    Parameters
    ----------
    count
        How many are expected; 0: as many as there are.

    Raises
    ------
    HandtrackError
        For what is none.
    """
    text = given.get(key)
    if text is None:
        if default is None:
            raise HandtrackError(f"{path}: a shape has no `{key}`.")
        return np.array(default, float)
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError:
        values = np.array([np.nan])
    if not np.isfinite(values).all() or len(values) != (count or len(values)) or not len(values):
        raise HandtrackError(f'{path}: {key}="{text}"; expected {count or "finite"} numbers.')
    return values


# ---- Boxes, cylinders, capsules and meshes as the ellipsoids that stand for them: of equal volume, meshes of equal inertia


_BOX = (6.0 / np.pi) ** (1.0 / 3.0)
"""radius over half an edge: 4/3 π abc = 8 hx hy hz"""
SIZES = {"sphere": 1, "cylinder": 2, "capsule": 2, "ellipsoid": 3, "box": 3}
"""how many numbers tell how large each is: its radius; its radius and half its length along z, a capsule's without the half
spheres on its ends; half its axes, or edges"""


def ellipsoid_radii(kind: str, size: Floats[K]) -> Floats[D3]:
    """Return the radii of the ellipsoid for one of `SIZES` [m]."""
    if SIZES[kind] == 3:
        return size[:3] * (_BOX if kind == "box" else 1.0)
    radius = float(size[0])
    long = 1.5 * float(size[SIZES[kind] - 1])  # π r² 2h = 4/3 π r² a
    along = {"sphere": radius, "cylinder": long, "capsule": radius + long}
    return np.array([radius, radius, along[kind]])


def mesh_shapes(path: Path, scale: Floats[D3], frame: Floats[D4, D4]) -> list[Shape]:
    """Return the ellipsoid of the inertia of a mesh's hull; none where the file is not there or not read. frame: of the mesh."""
    import trimesh

    if not path.is_file():
        return []
    try:
        hull = trimesh.load(path, force="mesh").convex_hull  # type: ignore[union-attr]
        hull.apply_scale(scale)
        inertia, volume = np.asarray(hull.moment_inertia), float(hull.volume)
    except (ValueError, IndexError, KeyError, NotImplementedError, AttributeError, OSError):
        return []
    if not volume > 0:
        return []
    spread = (0.5 * np.trace(inertia) * np.eye(3) - inertia) / volume  # of the solid's points
    values, axes = np.linalg.eigh(spread)
    axes[:, 0] *= np.sign(np.linalg.det(axes))
    radii = np.sqrt(5.0 * np.maximum(values, 0.0))
    return [Shape(frame @ rigid(np.asarray(hull.center_mass), axes), radii)]
