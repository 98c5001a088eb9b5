"""The form of a model definition: which tables and keys a definition (.toml) has, and of which kinds they are.

What the numbers mean stands at the head of definitions/hand26.toml and body34.toml.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal, NotRequired, TypedDict, TypeGuard

from msgspec import Meta

Number = Annotated[float, Meta(ge=-1e6, le=1e6)]
Point = tuple[Number, Number, Number]
Name = Annotated[str, Meta(min_length=1)]


class Freedom(TypedDict):
    """One hinge of a bone."""

    name: Name
    axis: Point
    limits_deg: tuple[Number, Number]
    rest_deg: NotRequired[Number]
    stabilise_deg: NotRequired[Number]


class Bone(TypedDict):
    """A bone in the zero pose [mm]; parents come first."""

    name: Name
    parent: NotRequired[Name]
    group: Name
    head: Point
    tail: Point
    up: Point
    freedoms: NotRequired[list[Freedom]]
    only_with: NotRequired[Literal["forearm"]]


class EllipsoidRow(TypedDict):
    """One ellipsoid in its bone's frame [mm]."""

    bone: Name
    centre: Point
    radii: Point
    rotation_deg: NotRequired[Point]


class Coupling(TypedDict):
    """name = ratio × leader."""

    name: Name
    leader: Name
    ratio: Number


class Proportion(TypedDict):
    """What one standard deviation of a person's proportion changes; keys are bones, `*` stands for any characters."""

    name: Name
    sigma_mm: NotRequired[Number]
    """of `moves`, 1 unless given"""
    moves: NotRequired[dict[str, Point]]
    """directions in which bones' heads move, in the hand's or body's frame"""
    stretch: NotRequired[dict[str, Point]]
    """logarithms of scale factors along a bone's own axes: width, length, depth"""
    shift: NotRequired[dict[str, Point]]
    """of a bone's ellipsoids, in its own frame [mm]"""


class Narrowing(TypedDict):
    """Limits that shrink with another joint's flexion."""

    pairs: list[tuple[Name, Name]]
    at_deg: Number
    to: Number


class Definition(TypedDict):
    """A whole model definition."""

    name: Name
    kind: NotRequired[Literal["hand", "body"]]
    length_mm: Annotated[float, Meta(gt=0, le=1e6)]
    bone: Annotated[list[Bone], Meta(min_length=1)]
    joints: dict[str, tuple[Name, Literal["head", "tail"] | Point]]
    ellipsoids: dict[str, list[EllipsoidRow]]
    couplings: NotRequired[dict[str, list[Coupling]]]
    narrowing: NotRequired[Narrowing]
    proportion: NotRequired[list[Proportion]]
    superquadric: NotRequired[list[dict[str, Any]]]


def extended(base: Mapping[str, Any], more: Mapping[str, Any]) -> dict[str, Any]:
    """Return a definition's tables as another one changes and adds to them: what `extends` means.

    Tables are merged key by key; rows that have a name (bones, freedoms, proportions) row by row, new ones at the end. All else
    that `more` has takes the place of what was there: numbers, texts, rows without a name such as ellipsoids.
    """
    merged = dict(base)
    for key, value in more.items():
        before = merged.get(key)
        if isinstance(before, Mapping) and isinstance(value, Mapping):
            merged[key] = extended(before, value)
        elif _are_named(before) and _are_named(value):
            rows = {row["name"]: row for row in before}
            for row in value:
                rows[row["name"]] = extended(rows.get(row["name"], {}), row)
            merged[key] = list(rows.values())
        else:
            merged[key] = value
    return merged


def _are_named(rows: Any) -> TypeGuard[Sequence[Mapping[str, Any]]]:
    return (
        isinstance(rows, list)
        and bool(rows)
        and all(isinstance(row, Mapping) and "name" in row for row in rows)
    )
