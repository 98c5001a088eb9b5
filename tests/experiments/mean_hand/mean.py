"""The mean hand: python -m tests.experiments.mean_hand.mean DEFINITION.toml MAKEHUMAN OUT.toml

DEFINITION: hand26 as it was before (commit a27e47e): bones and finger breadths from published measurements. OUT.toml: today's hand26 with
the bones' ends and ellipsoids that are found. MAKEHUMAN: the git folder of a copy of makehumancommunity/makehuman (its meshes are CC0).

Bones stay as measured; the thumb's base is put at the joint line. Ellipsoids of fingers and palm: fitted to the breadths measured and to
MakeHuman's surfaces together; then palm and wrist are given the mean of their breadth and circumferences and those of ANSUR II's people.
Ellipsoids of the thenar stay where they are in the hand: MakeHuman has its thumb 12 mm further back, so they fit no better about our bone.
WebXR's hand is in none of it: it is what the product is judged by.

The committed hand26.toml is what this program writes, to the byte.
"""

from __future__ import annotations

import copy
import re
import sys
import tomllib
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull

from handtrack.arrays import D3, Floats, N
from tests.experiments.mean_hand.fit import (
    Flat,
    Surface,
    bones_of,
    fitted,
    flat,
    frame,
    measured,
)
from tests.experiments.mean_hand.makehuman import Base, people

BREADTH_MM, AROUND_MM, WRIST_MM = 83.0, 198.8, 164.8
"""of ANSUR II's individuals (Gordon et al. 2014), women and men alike: hand breadth, hand and wrist circumference; their hands are 187 mm long"""
_KNUCKLES_MM = 80.0
_FINGERS_SHARE = 0.6
"""of a hand's surface"""
_THUMB_METACARPAL_MM = 40.0
"""from its head's centre to the joint line of its base: the thumb bends about an axis in the trapezium and spreads about one in the metacarpal
(Hollister et al. 1992, J. Orthop. Res. 10), so one centre for both lies between"""
_THENAR = ("thumb_carpal", "thumb_metacarpal")


def families(definition: dict[str, Any], makehuman: Path) -> dict[str, list[Flat]]:
    """Return the hands that the product's is made of, straightened; `measured` has fingers only."""
    rng, base = np.random.default_rng(26), Base.read(makehuman)
    people_ = [flat(base.hand(r), definition, rng) for r in people()]
    return {"measured": [measured(definition, rng)], "makehuman": people_}


def mean_definition(
    definition: dict[str, Any], hands: dict[str, list[Flat]], report: bool = False
) -> dict[str, Any]:
    start = with_thumb_base(definition, _THUMB_METACARPAL_MM)
    weighted = [
        (h, (_FINGERS_SHARE if name == "measured" else 1.0) / len(own))
        for name, own in hands.items()
        for h in own
    ]
    found = copy.deepcopy(start)
    rows = start["ellipsoids"]["fine"]
    moved = fitted(rows, Surface.of(weighted, start), report=report)
    found["ellipsoids"]["fine"] = [
        old if old["bone"] in _THENAR else new for old, new in zip(rows, moved, strict=True)
    ]
    _to_people(found, report)
    _to_skin(found, hands["makehuman"])
    found["ellipsoids"]["metaballs"] = _metaballs(start, found)
    return found


def with_thumb_base(definition: dict[str, Any], length: float) -> dict[str, Any]:
    """Return the definition with a thumb metacarpal of this length [mm] that ends where it did; ellipsoids stay where they are in the hand."""
    found = copy.deepcopy(definition)
    bones = bones_of(found)
    before = {name: frame(bones[name]) for name in _THENAR}
    _, axes, _ = before["thumb_metacarpal"]
    base = (bones["thumb_metacarpal"]["tail"] - length * axes[:, 1]).tolist()
    bones["thumb_carpal"]["tail"] = bones["thumb_metacarpal"]["head"] = base
    for row in (r for rows in found["ellipsoids"].values() for r in rows):
        if row["bone"] in _THENAR:
            head, axes, _ = before[row["bone"]]
            new_head, new_axes, _ = frame(bones[row["bone"]])
            row["centre"] = ((axes @ row["centre"] + head - new_head) @ new_axes).tolist()
    return found


def _to_people(definition: dict[str, Any], report: bool) -> None:
    """Change the radii of palm and wrist to the mean of their own breadth and circumferences and of people's."""
    rows = definition["ellipsoids"]["fine"]
    palm = [r for r in rows if "carpal" in r["bone"] and not r["bone"].startswith("thumb")]
    own = np.array(_section(definition, palm, _KNUCKLES_MM))
    aim = 0.5 * (own + (BREADTH_MM, AROUND_MM))
    for _ in range(8):
        breadth, around = _section(definition, palm, _KNUCKLES_MM)
        thick, wanted = ((c - 2 * b) / (np.pi - 2) for b, c in ((breadth, around), aim))
        for row in palm:
            x, y, z = row["radii"]
            row["radii"] = [x + 0.25 * (aim[0] - breadth), y, z + 0.25 * (wanted - thick)]
    root = next(r for r in rows if r["bone"] == "root")
    _, wrist = _section(definition, [root], 0.0)
    factor = 0.5 * (1 + WRIST_MM / wrist)
    root["radii"] = [root["radii"][0] * factor, root["radii"][1], root["radii"][2] * factor]
    if report:
        print(
            f"  palm {own[0]:.1f} → {breadth:.1f} mm broad, {own[1]:.1f} → {around:.1f} round; wrist {wrist:.1f} round, × {factor:.3f}"
        )


def _to_skin(definition: dict[str, Any], people_: list[Flat]) -> None:
    """Give the palm's ellipsoids the height of people's back and palm above and below their own middles.

    Ellipsoids beside each other that fit a skin by distance lie outside it at their crests and inside it between: silhouettes show crests.
    An ellipsoid that does not reach the surface there stays as it is. The thenar counts as surface: without its skin, what lies behind it
    (the web, the index metacarpal) would seem as thin as the back of the hand there.
    """
    rows, bones = definition["ellipsoids"]["fine"], bones_of(definition)
    palm = [r for r in rows if "carpal" in r["bone"] and not r["bone"].startswith("thumb")]
    shown = [r for r in rows if r["bone"] != "forearm"]

    def middle(row: dict[str, Any]) -> Floats[D3]:
        head, axes, _ = frame(bones[row["bone"]])
        return axes @ row["centre"] + head

    def heights(points: Floats[N, D3], at: Floats[D3]) -> Floats:
        near = points[(np.abs(points[:, 0] - at[0]) < 5) & (np.abs(points[:, 1] - at[1]) < 3), 2]
        return np.array([near.max(), near.min()])

    aims = [np.mean([heights(h.points, middle(row)) for h in people_], axis=0) for row in palm]
    for _ in range(12):
        points = _points(definition, shown)
        for row, (back, front) in zip(palm, aims, strict=True):
            at, (x, y, z) = middle(row), row["radii"]
            top, low = heights(points, at)
            above = 0.4 * (top - back) if top - (at[2] + z) < 1 else 0.0
            below = 0.4 * (front - low) if at[2] - z - low < 1 else 0.0
            row["radii"] = [x, y, z - 0.5 * (above + below)]
            row["centre"] = [*row["centre"][:2], row["centre"][2] - 0.5 * (above - below)]


def _metaballs(before: dict[str, Any], after: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the coarse ellipsoids changed as the fine ones are: by breadth, depth and middle of their section about the same bone."""
    bones = bones_of(before), bones_of(after)
    found = []
    for row in before["ellipsoids"]["metaballs"]:
        row, bone = dict(row), row["bone"]
        found.append(row)
        if bone == "forearm":
            continue
        factor = frame(bones[1][bone])[2] / frame(bones[0][bone])[2]
        boxes = []
        for definition, own, y in zip(
            (before, after), bones, (row["centre"][1], row["centre"][1] * factor), strict=True
        ):
            is_palm = bone == "middle_metacarpal"
            about = [
                r for r in definition["ellipsoids"]["fine"]
                if (r["bone"] == "root" or ("carpal" in r["bone"] and "thumb" not in r["bone"]) if is_palm else r["bone"] == bone)
            ]  # fmt: skip
            head, axes, _ = frame(own[bone])
            local = (_points(definition, about) - head) @ axes
            near = local[np.abs(local[:, 1] - y) < 1.5][:, [0, 2]]
            boxes.append((near.min(axis=0), near.max(axis=0)))
        (low, high), (new_low, new_high) = boxes
        ratio, moved = (new_high - new_low) / (high - low), 0.5 * (new_low + new_high - low - high)
        x, y, z = row["centre"]
        row["centre"] = [x + moved[0], y * factor, z + moved[1]]
        row["radii"] = [
            row["radii"][0] * ratio[0],
            row["radii"][1] * factor,
            row["radii"][2] * ratio[1],
        ]
    return found


def _section(
    definition: dict[str, Any], rows: list[dict[str, Any]], y: float
) -> tuple[float, float]:
    """Return breadth and convex circumference [mm] of ellipsoids in the zero pose, across the hand."""
    points = _points(definition, rows)
    near = points[np.abs(points[:, 1] - y) < 1.5][:, [0, 2]]
    return float(np.ptp(near[:, 0])), float(ConvexHull(near).area)


def _points(definition: dict[str, Any], rows: list[dict[str, Any]]) -> Floats[N, D3]:
    bones, ball = bones_of(definition), np.random.default_rng(0).normal(size=(4000, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    placed = [(*frame(bones[r["bone"]])[:2], r) for r in rows]
    return np.concatenate(
        [(r["centre"] + ball * r["radii"]) @ axes.T + head for head, axes, r in placed]
    )


def written(text: str, definition: dict[str, Any]) -> str:
    """Return the text of a definition file with the numbers of another: ends of bones, and ellipsoids."""
    for name, bone in bones_of(definition).items():
        for end in ("head", "tail"):
            text = re.sub(
                rf'(name = "{name}"\n(?:(?!\[\[).*\n)*?{end} = )\[.*\]',
                rf"\g<1>{_numbers(bone[end])}",
                text,
            )
    for key, rows in definition["ellipsoids"].items():
        lines = [
            f'  {{ bone = "{r["bone"]}", centre = {_numbers(r["centre"])}, radii = {_numbers(r["radii"])} }},\n'
            for r in rows
        ]
        text = re.sub(
            rf"(\n{key} = \[\n)(?:  .*\n)*",
            lambda m, lines=lines: m.group(1) + "".join(lines),
            text,
        )
    return text


def _numbers(values: Any) -> str:
    return "[" + ", ".join(f"{round(float(v), 2) + 0.0:g}" for v in values) + "]"


def read_start(path: Path) -> dict[str, Any]:
    """Return the definition that a mean begins with, its coarse palm on a metacarpal, as today's is."""
    definition = tomllib.loads(path.read_text())
    bones = bones_of(definition)
    for row in definition["ellipsoids"]["metaballs"]:
        if row["bone"] == "root":
            row["bone"] = "middle_metacarpal"
            row["centre"] = np.subtract(row["centre"], bones[row["bone"]]["head"]).tolist()
    return definition


def main() -> None:
    start, makehuman, out = map(Path, sys.argv[1:4])
    definition = read_start(start)
    hands = families(definition, makehuman)
    text = resources.files("handtrack.model.definitions").joinpath("hand26.toml").read_text()
    out.write_text(written(text, mean_definition(definition, hands, report=True)))


if __name__ == "__main__":
    main()
