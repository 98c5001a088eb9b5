"""Joint parameters by their anatomical names, each with a small picture of what it turns."""

from __future__ import annotations

import math
from collections.abc import Callable

from handtrack_app.page.time.drawing import INK, Area, Line, Part, Point, Words
from handtrack_app.protocol.palette import colour_of, finger_of, limb_of

_JOINTS = {
    "cmc": "saddle joint", "mcp": "knuckle", "pip": "middle joint", "dip": "end joint", "ip": "end joint",
}  # fmt: skip
_MOTIONS = {
    "flex": "flexion", "abd": "abduction", "twist": "axial rotation", "dev": "deviation", "lean": "lateral flexion",
    "elevate": "elevation", "protract": "protraction",
}  # fmt: skip
_ROOT = {
    "root_tx": "Place along x", "root_ty": "Place along y", "root_tz": "Place along z",
    "root_rx": "Turn about x", "root_ry": "Turn about y", "root_rz": "Turn about z",
}  # fmt: skip
_ARC = "#d55e00"
_FINGERS = ("thumb", "index", "middle", "ring", "little")


def anatomical(name: str) -> str:
    """Return what a parameter is: `Index finger, middle joint (PIP), flexion`."""
    if name in _ROOT:
        return _ROOT[name]
    first, *joint, motion = name.split("_")
    moves = _MOTIONS.get(motion, motion)
    if limb_of(name) is not None or first == "spine" or not joint:
        return f"{' '.join([first, *joint]).capitalize()}, {moves}"
    whose = first.capitalize() + (" finger" if first in _FINGERS[1:] else "")
    where = " ".join(f"{_JOINTS[part]} ({part.upper()})" if part in _JOINTS else part for part in joint)  # fmt: skip
    return f"{whose}, {where}, {moves}"


def unit_of(name: str) -> tuple[float, str]:
    """Return what a parameter is to be divided by to be shown [m, rad], and its unit."""
    return (1e-3, "mm") if name.startswith("root_t") else (math.pi / 180, "°")


def angle_parts(name: str, x: float, y: float, size: float) -> list[Part]:
    """Return a small picture of what a parameter turns, with its upper left corner at a point: the finger from its side for
    flexion, the hand from its back for the rest; an arc where it turns.
    """

    def at(across: float, down: float) -> Point:
        return x + across * size, y + down * size

    finger, motion = finger_of(name), name.rpartition("_")[2]
    colour = "#{:02x}{:02x}{:02x}".format(*colour_of(name))
    if name.startswith("root_"):
        return _axis(name, at, size)
    if limb_of(name) is not None or finger == "palm":
        return _bend([at(0.15, 0.85), at(0.5, 0.5), at(0.85, 0.75)], at(0.5, 0.5), size, colour)
    if motion == "flex":
        chain = [at(0.04, 0.72), at(0.34, 0.45), at(0.6, 0.34), at(0.8, 0.5), at(0.84, 0.76)]
        joint = name.split("_")[1]
        place = {"cmc": 0, "mcp": 1, "pip": 2, "dip": 3, "ip": 3}.get(joint, 1)
        if finger == "thumb":
            place = {"cmc": 1, "mcp": 2, "ip": 3}.get(joint, 1)
        return _bend(chain, chain[place], size, colour)
    parts: list[Part] = [Area([at(0.3, 0.95), at(0.24, 0.55), at(0.74, 0.55), at(0.7, 0.95)], "#8c8780", 0.5)]  # fmt: skip
    for n, one in enumerate(_FINGERS):
        base, tip = (
            at(0.27 + 0.15 * (n - 1), 0.55),
            at(0.2 + 0.2 * (n - 1), 0.15 + 0.03 * abs(n - 2)),
        )
        if one == "thumb":
            base, tip = at(0.27, 0.8), at(0.03, 0.5)
        own = one == finger
        parts.append(Line([base, tip], colour if own else "#8c8780", 3.0 if own else 1.5))
        if own:
            parts.append(_arc(base, tip, size, full=0.9))
    return parts


def _bend(chain: list[Point], joint: Point, size: float, colour: str) -> list[Part]:
    after = chain[min(chain.index(joint) + 1, len(chain) - 1)]
    before = chain[max(chain.index(joint) - 1, 0)]
    straight = (2 * joint[0] - before[0], 2 * joint[1] - before[1])
    dot = 0.05 * size
    ring = [(joint[0] + dot * math.cos(a), joint[1] + dot * math.sin(a)) for a in _around(12)]
    return [
        Line(chain, colour, 3.0), Line([joint, _shortened(joint, straight, 0.26 * size)], INK, 1.0, dashed=True),
        _arc(joint, after, size, straight), Area(ring, _ARC),
    ]  # fmt: skip


def _arc(
    centre: Point, to: Point, size: float, begin: Point | None = None, full: float = 0.0
) -> Line:
    """Return an arc about a joint: from the straight way to where it goes, or `full` radians about that."""
    end = math.atan2(to[1] - centre[1], to[0] - centre[0])
    first = end - full / 2 if begin is None else math.atan2(begin[1] - centre[1], begin[0] - centre[0])  # fmt: skip
    last = end + full / 2
    turn = (last - first + math.pi) % (2 * math.pi) - math.pi
    radius = (0.2 if begin is not None else 0.34) * size
    steps = [first + turn * n / 8 for n in range(9)]
    return Line([(centre[0] + radius * math.cos(a), centre[1] + radius * math.sin(a)) for a in steps], _ARC, 2.0)  # fmt: skip


def _axis(name: str, at: Callable[[float, float], Point], size: float) -> list[Part]:
    ends = {"x": at(0.92, 0.7), "y": at(0.4, 0.08), "z": at(0.08, 0.92)}
    origin = at(0.4, 0.7)
    parts: list[Part] = []
    for axis, end in ends.items():
        own = name.endswith(axis)
        parts.append(Line([origin, end], _ARC if own else "#8c8780", 2.5 if own else 1.2))
        if own:
            parts.append(Words(end[0], end[1] + (10 if axis != "y" else 4), axis, 9, "end"))
            if "_r" in name:
                middle = ((origin[0] + end[0]) / 2, (origin[1] + end[1]) / 2)
                radius = 0.14 * size
                parts.append(Line([(middle[0] + radius * math.cos(a), middle[1] + 0.6 * radius * math.sin(a)) for a in _around(12)[:10]], _ARC, 1.5))  # fmt: skip
    return parts


def _shortened(start: Point, end: Point, length: float) -> Point:
    dx, dy = end[0] - start[0], end[1] - start[1]
    share = length / max(math.hypot(dx, dy), 1e-9)
    return start[0] + share * dx, start[1] + share * dy


def _around(count: int) -> list[float]:
    return [2 * math.pi * n / count for n in range(count)]
