"""Right hands of MakeHuman's people (CC0), read from a git copy of makehumancommunity/makehuman."""

from __future__ import annotations

import json
import subprocess
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from handtrack.arrays import D3, Array, Floats, N, T, V
from tests.experiments.honesty.meshes import FINGERS, HandMesh, _made, _skin_point, _upright
from tests.experiments.mean_hand.fit import DEPTH_MM, LENGTH_MM

_DATA = "makehuman/data"
_CUFF_M = 0.022
"""of the forearm that stays with the hand"""
_JOINT_M = (0.008, 0.005, 0.004)
"""half of what bends about a finger's joints, from the palm out"""
_SECTION_M = 0.004
KNUCKLE_MM = 10.7
"""by which a knuckle's centre lies under the skin of the back of such a hand: the same 3 mm and half of a metacarpal's head 15 to 16 mm high"""
_UP = np.array([[-0.73, -0.47, 0.49], *[[0.0, 0, 1]] * 4])
"""backs of thumb and fingers, in the hand's axes"""
LENGTHS = np.array(
    [
        [40.0, 33.0, 28.5],
        [42.0, 23.5, 22.0],
        [47.0, 27.5, 24.0],
        [43.5, 26.5, 23.5],
        [34.0, 19.5, 22.0],
    ]
)
"""of the bones of a hand of that length, thumb first, from joint centre to joint centre [mm]: MakeHuman's own rig has its knuckles
at the webs, 13 mm beyond the heads of the metacarpals"""


@dataclass(frozen=True)
class Recipe:
    """One of MakeHuman's people: mixtures of its targets, each with its weight."""

    name: str
    targets: tuple[tuple[str, float], ...]


def people() -> list[Recipe]:
    """Return adults of both sexes, young and old, thin to heavy, slack to muscular, of three origins, with hands of other shares."""
    found = []
    hand = {
        "": (),
        "slim": (("armslegs/r-hand-fingers-diameter-decr", 0.5),),
        "thick": (("armslegs/r-hand-fingers-diameter-incr", 0.5),),
    }
    rows = [
        ("female", "young", "average", "average", "caucasian", ""),
        ("female", "young", "average", "min", "asian", "slim"),
        ("female", "old", "average", "max", "african", ""),
        ("female", "young", "max", "average", "caucasian", "thick"),
        ("male", "young", "average", "average", "caucasian", ""),
        ("male", "young", "average", "min", "african", "slim"),
        ("male", "old", "average", "max", "asian", ""),
        ("male", "young", "max", "average", "caucasian", "thick"),
    ]
    for sex, age, muscle, weight, origin, more in rows:
        name = "_".join(
            filter(None, (sex, age, f"{muscle}muscle", f"{weight}weight", origin, more))
        )
        body = f"macrodetails/universal-{sex}-{age}-{muscle}muscle-{weight}weight"
        targets = ((f"macrodetails/{origin}-{sex}-{age}", 1.0), (body, 1.0), *hand[more])
        found.append(Recipe(name, targets))
    return found


@dataclass(frozen=True, eq=False)
class Base:
    """The mesh of everybody, with its skeleton."""

    git: Path
    vertices: Floats[N, D3]
    faces: Array
    joints: dict[str, list[int]]
    weights: dict[str, list]

    @classmethod
    def read(cls, git: Path) -> Base:
        """git: the git folder of a copy of the repository."""
        vertices, faces, in_body = [], [], False
        for line in file_of(git, f"{_DATA}/3dobjs/base.obj").splitlines():
            kind, _, rest = line.partition(" ")
            if kind == "v":
                vertices.append([float(x) for x in rest.split()])
            elif kind == "g":
                in_body = rest.strip() == "body"
            elif kind == "f" and in_body:
                corner = [int(x.split("/")[0]) - 1 for x in rest.split()]
                faces += [[corner[0], *corner[k : k + 2]] for k in range(1, len(corner) - 1)]
        skeleton = json.loads(file_of(git, f"{_DATA}/rigs/default.mhskel"))
        weights = json.loads(file_of(git, f"{_DATA}/rigs/default_weights.mhw"))["weights"]
        return cls(git, np.array(vertices), np.array(faces), skeleton["joints"], weights)

    def hand(self, recipe: Recipe, arm_m: float = _CUFF_M) -> HandMesh:
        """Return somebody's right hand, with so much of the arm, as a mesh that can be posed."""
        points = self.vertices.copy()
        for name, share in recipe.targets:
            rows = _target(self.git, name)
            np.add.at(points, rows[:, 0].astype(int), share * rows[:, 1:])
        points *= 0.1  # decimetres

        def at(bone: str, end: str) -> Floats[D3]:
            return points[self.joints[f"{bone}.R____{end}"]].mean(axis=0)

        wrist = at("wrist", "head")
        metacarpal = [
            at("wrist", "head"),
            *(at(f"metacarpal{f}", "head") for f in range(1, FINGERS)),
        ]
        chains = [[f"finger{f + 1}-{k + 1}" for k in range(3)] for f in range(FINGERS)]
        rig = np.array([[at(b, "head") for b in c] for c in chains])
        turn = _upright(np.array([wrist, rig[1, 0], rig[2, 0], rig[4, 0]]))
        share = np.zeros(
            (len(points), FINGERS + 1)
        )  # of the palm, and of each finger with its metacarpal
        for bone, rows in self.weights.items():
            own, _, side = bone.partition(".")
            if side != "R" or not own.startswith(("wrist", "metacarpal", "lowerarm", "finger")):
                continue
            part = int(own[6]) if own.startswith("finger") else 0
            if own.startswith("metacarpal"):
                part = int(own[10]) + 1
            vertex, weight = np.array(rows).T
            share[vertex.astype(int), part] += weight
        near = (points - wrist) @ turn[1] > -arm_m
        mine = (share.sum(axis=1) > 0.5) & near
        kept = self.faces[mine[self.faces].all(axis=1)]
        used, triangles = np.unique(kept, return_inverse=True)
        vertices, share = points[used], share[used] / share[used].sum(axis=1, keepdims=True)
        tips = [
            _skin_point(vertices, p[-1], at(c[-1], "tail") - p[-1])
            for p, c in zip(rig, chains, strict=True)
        ]
        lines = [np.array([m, *p, t]) for m, p, t in zip(metacarpal, rig, tips, strict=True)]
        size = np.linalg.norm(rig[2, 0] - wrist) + _lengths(lines[2])[1:].sum()
        chain = [
            _from_tip(line, size * own)
            for line, own in zip(lines, LENGTHS / LENGTH_MM, strict=True)
        ]
        skin = vertices[triangles.reshape(-1, 3)]
        own = [vertices[share[:, f + 1] > 0.5] for f in range(FINGERS)]
        chain = [
            _centred(p, t, v, turn.T @ up, size / LENGTH_MM)
            for p, t, v, up in zip(chain, tips, own, _UP, strict=True)
        ]
        for line, up in zip(chain[1:], _UP[1:], strict=True):
            z = _across(line[1] - line[0], turn.T @ up)
            line[0] += (_out(skin, line[0], z) - KNUCKLE_MM * size / LENGTH_MM) * z
        weights = np.zeros((len(vertices), 1 + 3 * FINGERS))
        weights[:, 0] = share[:, 0]
        for f, joints in enumerate(chain):
            weights[:, [0, *range(3 * f + 1, 3 * f + 4)]] += share[:, f + 1, None] * _skinned(
                vertices, np.array([*joints, tips[f]])
            )
        keypoints = [wrist, *(x for p, t in zip(chain, tips, strict=True) for x in (*p, t))]
        axes = np.array(
            [_axes(p, t, turn, f == 0) for f, (p, t) in enumerate(zip(chain, tips, strict=True))]
        )
        pivots = np.array([[p[0], *p] for p in chain])
        return _made(
            recipe.name, vertices, triangles.reshape(-1, 3), weights, pivots, axes, keypoints, turn
        )


def _lengths(line: Floats) -> Floats:
    return np.linalg.norm(np.diff(line, axis=0), axis=1)


def _from_tip(line: Floats, own: Floats) -> Floats[D3, D3]:
    """Return a finger's joints on its line (metacarpal's base … tip), at the sums of its bones' lengths (from the palm out) from the tip."""
    along = np.concatenate([[0.0], np.cumsum(_lengths(line))])
    at = along[-1] - np.cumsum(own[::-1])[::-1]
    start = line[0] + np.minimum(at, 0.0)[:, None] * (line[1] - line[0]) / along[1]
    found = np.stack([np.interp(at, along, c) for c in line.T], axis=1)
    return np.where((at < 0)[:, None], start, found)


def _centred(
    joints: Floats[D3, D3], tip: Floats[D3], vertices: Floats[V, D3], up: Floats[D3], size: float
) -> Floats[D3, D3]:
    """Return a finger's joints where they lie in its breadth and depth: MakeHuman's are right below the skin of its back.

    Its base follows the next joint. size: [m] of one mm of a hand of `LENGTH_MM`.
    """
    line = np.array([*joints, tip])
    moves = np.zeros((3, 3))
    for k in (1, 2):
        along = (line[k + 1] - line[k - 1]) / np.linalg.norm(line[k + 1] - line[k - 1])
        z = _across(along, up)
        off = vertices - line[k]
        near = off[np.abs(off @ along) < _SECTION_M]
        for axis, place in ((z, DEPTH_MM * size), (np.cross(along, z), 0.0)):
            reach = near @ axis
            moves[k] += (0.5 * (reach.min() + reach.max()) + place) * axis
    moves[0] = moves[1]
    return joints + moves


def _across(along: Floats[D3], up: Floats[D3]) -> Floats[D3]:
    """Return the unit vector across a bone, nearest to up."""
    z = up - along * (along @ up) / (along @ along)
    return z / np.linalg.norm(z)


def _out(skin: Floats[T, D3, D3], point: Floats[D3], way: Floats[D3]) -> float:
    """Return how far from a point along a direction the skin's last triangle is met [m]."""
    a, b, c = np.swapaxes(skin, 0, 1)
    sides = np.stack([b - a, c - a, np.broadcast_to(-way, a.shape)], axis=2)
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v, t = np.linalg.solve(sides, (point - a)[:, :, None])[..., 0].T
    return float(t[(u >= 0) & (v >= 0) & (u + v <= 1)].max())


def _skinned(vertices: Floats[V, D3], line: Floats) -> Floats:
    """Return how much each vertex moves with palm and three bones: it goes over at each joint, within the joint's width."""
    weights, rest = np.zeros((len(vertices), 4)), np.ones(len(vertices))
    before = 2 * line[0] - line[1]
    for k in (2, 1, 0):
        back = line[k - 1] if k else before
        along = (line[k + 1] - line[k]) / np.linalg.norm(line[k + 1] - line[k])
        along = along + (line[k] - back) / np.linalg.norm(line[k] - back)
        off = (vertices - line[k]) @ (along / np.linalg.norm(along))
        t = np.clip(0.5 + off / (2 * _JOINT_M[k]), 0.0, 1.0)
        gone = rest * t * t * (3 - 2 * t)
        weights[:, k + 1], rest = gone, rest - gone
    weights[:, 0] = rest
    return weights


def _axes(chain: Floats, tip: Floats, turn: Floats, is_thumb: bool) -> Floats:
    """Return a finger's axes: the normal of its bent plane for the bends, and across it for the spread."""
    points = np.array([*chain, tip])
    middle = points - points.mean(axis=0)
    normal = np.linalg.svd(middle)[2][2]
    if not is_thumb and abs(normal @ turn[0]) < 0.8:  # straight: no plane of its own
        normal = turn[0]
    along = points[-1] - points[0]
    along /= np.linalg.norm(along)
    normal = normal - along * (along @ normal)
    normal /= np.linalg.norm(normal)
    return np.array([np.cross(normal, along), normal, normal, normal])


@cache
def _target(git: Path, name: str) -> Floats:
    rows = [x.split() for x in file_of(git, f"{_DATA}/targets/{name}.target").splitlines()]
    return np.array(
        [[float(v) for v in r] for r in rows if len(r) == 4 and r[0].isdigit()]
    ).reshape(-1, 4)


def file_of(git: Path, path: str) -> str:
    """Return a text of a git folder that may have no work tree."""
    return subprocess.run(
        ["git", "-C", str(git), "show", f"HEAD:{path}"], capture_output=True, text=True, check=True
    ).stdout  # fmt: skip
