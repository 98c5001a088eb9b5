"""A hand's bones and the ellipsoids about them, as hand26 names them, from skinned meshes brought to its zero pose."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from handtrack.arrays import D3, Array, Floats, N
from handtrack.model.articulated import FINGERS as NAMES
from tests.experiments.honesty.meshes import FINGERS, HINGES, HandMesh

LENGTH_MM = 187.0
DEPTH_MM = 1.3
"""by which a finger's joint centres lie nearer to its back than to its pulp, of a hand of that length: 3 mm of skin and tendon and
half of a head 8 to 9 mm high, of a finger 17 to 18 mm deep"""
_POINTS = 4000
_CUFF_MM = 12.0
"""behind the wrist, of what is looked at"""
CHAINS = tuple(
    tuple(f"{name}_{p}" for p in (("metacarpal", "proximal", "distal") if name == "thumb" else ("proximal", "intermediate", "distal")))
    for name in NAMES
)  # fmt: skip
"""the moving bones of each finger"""
Bones = dict[str, dict[str, Any]]


@dataclass(frozen=True, eq=False)
class Flat:
    """A hand in hand26's zero pose and axes, 187 mm long [mm]."""

    name: str
    length_mm: float
    """as it was"""
    points: Floats[N, D3]
    """on its surface, equally dense"""
    finger: Array[N]
    """0 … 4, -1 the palm"""
    joints: Floats
    """(5, 4, 3) of each finger, tips last"""
    bend: Floats
    """(5, 3, 3) unit: the axes about which a finger's bones bend"""


def bones_of(definition: dict[str, Any]) -> Bones:
    return {b["name"]: b for b in definition["bone"]}


def flat(mesh: HandMesh, definition: dict[str, Any], rng: np.random.Generator) -> Flat:
    """Return the hand straightened: fingers and thumb along the bones of the definition's zero pose."""
    bones = bones_of(definition)
    knuckles = np.array([[0.0, 0, 0], *(bones[c[0]]["head"] for c in CHAINS[1:])])
    ours = np.array(
        [[_unit(np.subtract(bones[b]["tail"], bones[b]["head"])) for b in c] for c in CHAINS]
    )
    own = mesh.keypoints[[0, 5, 9, 13, 17]]
    u, _, v = np.linalg.svd(own.T @ knuckles)  # about the wrist
    turn = (u @ np.diag([1, 1, np.linalg.det(u @ v)]) @ v).T

    def off(x: Floats) -> Floats:
        _, points = mesh.posed(x.reshape(FINGERS, HINGES))
        along = np.diff(points[1:].reshape(FINGERS, 4, 3), axis=1)
        along /= np.linalg.norm(along, axis=2, keepdims=True)
        return np.concatenate([(along @ turn.T - ours).ravel(), 0.02 * x])

    angles = least_squares(off, np.zeros(FINGERS * HINGES)).x.reshape(FINGERS, HINGES)
    vertices, points = mesh.posed(angles)
    frames = mesh._frames(_as_hinges(mesh, angles))
    bend = np.array(
        [
            [
                frames[3 * f + k, :3, :3] @ mesh.axes[f, k if f or k > 1 else 1 - mesh.palmar]
                for k in (1, 2, 3)
            ]
            for f in range(FINGERS)
        ]
    )
    joints = points[1:].reshape(FINGERS, 4, 3) @ turn.T * 1e3
    length = float(
        np.linalg.norm(joints[2, 0]) + np.linalg.norm(np.diff(joints[2], axis=0), axis=1).sum()
    )
    scale = LENGTH_MM / length
    triangle = (vertices @ turn.T * 1e3 * scale)[mesh.triangles]
    area = np.linalg.norm(
        np.cross(triangle[:, 1] - triangle[:, 0], triangle[:, 2] - triangle[:, 0]), axis=1
    )
    chosen = rng.choice(len(area), _POINTS, p=area / area.sum())
    share = rng.dirichlet(np.ones(3), _POINTS)
    found = np.einsum("nk,nkc->nc", share, triangle[chosen])
    weight = np.einsum("nk,nkw->nw", share, mesh.weights[mesh.triangles[chosen]])
    part = (
        np.argmax(
            np.column_stack(
                [
                    weight[:, 0],
                    *(weight[:, 3 * f + 1 : 3 * f + 4].sum(axis=1) for f in range(FINGERS)),
                ]
            ),
            axis=1,
        )
        - 1
    )
    keep = found[:, 1] > -_CUFF_MM
    return Flat(mesh.name, length, found[keep], part[keep], joints * scale, bend @ turn.T)


def measured(definition: dict[str, Any], rng: np.random.Generator) -> Flat:
    """Return the fingers and thumb of a definition as points on its ellipsoids: what was measured with callipers stands in it.

    Callipers say how broad and deep a finger is, not where its bones lie in it: that is `DEPTH_MM`, as of MakeHuman's joints.
    """
    bones, joints = bones_of(definition), joints_of(definition)
    points, fingers = [], []
    for f, chain in enumerate(CHAINS):
        rows = [
            r for r in definition["ellipsoids"]["fine"] if r["bone"] in (chain if f else chain[1:])
        ]
        placed = [
            (
                *frame(bones[r["bone"]])[:2],
                np.array([*r["centre"][:2], -DEPTH_MM], float),
                np.array(r["radii"], float),
            )
            for r in rows
        ]
        own = []
        for head, axes, centre, radii in placed:
            ball = rng.normal(size=(int(_POINTS * radii[0] * radii[1] / 8000), 3))
            ball /= np.linalg.norm(ball, axis=1, keepdims=True)
            own.append((centre + ball * radii) @ axes.T + head)
        own = np.concatenate(own)
        inside = np.min(
            [((((own - h) @ a - c) / r) ** 2).sum(axis=1) for h, a, c, r in placed], axis=0
        )
        points.append(own[inside > 0.999])
        fingers.append(np.full(len(points[-1]), f))
    return Flat(
        "measured",
        LENGTH_MM,
        np.concatenate(points),
        np.concatenate(fingers),
        joints,
        np.zeros((FINGERS, 3, 3)),
    )


def _as_hinges(mesh: HandMesh, angles: Floats) -> Floats:
    if mesh.palmar:
        angles = angles.copy()
        angles[0, :2] = angles[0, 1::-1]
    return angles


def with_joints(definition: dict[str, Any], joints: Floats) -> dict[str, Any]:
    """Return the definition with these knuckles, and these lengths of fingers' bones, straight as in its zero pose (5, 4, 3) [mm]."""
    found = copy.deepcopy(definition)
    bones, before = bones_of(found), bones_of(definition)
    for f, chain in enumerate(CHAINS):
        head = np.array(joints[f, 0])
        if f:
            base, tail = (
                np.array(before[f"{NAMES[f]}_metacarpal"][e], float) for e in ("head", "tail")
            )
            turn = _between(tail, head)
            start = turn @ base * np.linalg.norm(head) / np.linalg.norm(tail)
            bones[f"{NAMES[f]}_carpal"]["tail"] = bones[f"{NAMES[f]}_metacarpal"]["head"] = (
                start.tolist()
            )
            bones[f"{NAMES[f]}_metacarpal"]["tail"] = head.tolist()
        else:
            bones["thumb_carpal"]["tail"] = head.tolist()
        for k, bone in enumerate(chain):
            along = _unit(np.subtract(before[bone]["tail"], before[bone]["head"]))
            bones[bone]["head"] = head.tolist()
            head = head + along * np.linalg.norm(joints[f, k + 1] - joints[f, k])
            bones[bone]["tail"] = head.tolist()
    return found


def joints_of(definition: dict[str, Any]) -> Floats:
    """Return the joints (5, 4, 3) [mm] of a definition's zero pose."""
    bones = bones_of(definition)
    return np.array([[*(bones[b]["head"] for b in c), bones[c[-1]]["tail"]] for c in CHAINS], float)


def frame(bone: dict[str, Any]) -> tuple[Floats[D3], Floats[D3, D3], float]:
    """Return origin, axes (columns) and length of a bone's own frame."""
    head, tail = np.array(bone["head"], float), np.array(bone["tail"], float)
    y = _unit(tail - head)
    z = np.array(bone["up"], float)
    z = _unit(z - y * (y @ z))
    return head, np.stack([np.cross(y, z), y, z], axis=1), float(np.linalg.norm(tail - head))


@dataclass(frozen=True, eq=False)
class Surface:
    """Surface points of one or more hands, in the bones' frames of one definition [mm]."""

    local: dict[str, Floats]
    """of each bone (N, 3)"""
    finger: Array
    weight: Floats

    @classmethod
    def of(cls, hands: list[tuple[Flat, float]], definition: dict[str, Any]) -> Surface:
        """hands: each with its weight. A hand's fingers are about its own bones, and along them points are scaled to the definition's; its
        palm is one part: where rigs have their metacarpals in it says little.
        """
        mean = bones_of(definition)
        parts, fingers, weights = [], [], []
        for hand, weight in hands:
            own = bones_of(with_joints(definition, hand.joints))
            local = {}
            for name, bone in own.items():
                if name == "root" or ("carpal" in name and name != CHAINS[0][0]):
                    bone = mean[name]
                head, axes, length = frame(bone)
                factor = frame(mean[name])[2] / length if name not in ("root", "forearm") else 1.0
                local[name] = (hand.points - head) @ axes * np.array([1.0, factor, 1.0])
            parts.append(local)
            fingers.append(hand.finger)
            weights.append(np.full(len(hand.points), weight / len(hand.points)))
        weight = np.concatenate(weights)
        joined = {name: np.concatenate([p[name] for p in parts]) for name in parts[0]}
        return cls(joined, np.concatenate(fingers), weight / weight.mean())


def fitted(
    rows: list[dict[str, Any]],
    surface: Surface,
    sigma: tuple[float, ...] = (3.0, 4.0, 3.0, 0.25, 0.25, 0.25),
    strength: float = 0.01,
    steps: int = 40,
    report: bool = False,
) -> list[dict[str, Any]]:
    """Return the ellipsoids moved to the surface, from where they are: σ of centres [mm] and of radii (log) about the start.

    strength: of that prior, against the mean square of the points' distances [mm²].
    """
    moved = [i for i, r in enumerate(rows) if r["bone"] != "forearm"]
    bone = [rows[i]["bone"] for i in moved]
    centre = np.array([rows[i]["centre"] for i in moved], float)
    radii = np.array([rows[i]["radii"] for i in moved], float)
    part = np.array(
        [NAMES.index(b.partition("_")[0]) if b.partition("_")[0] in NAMES else -1 for b in bone]
    )
    is_palm = np.array(["carpal" in b or b == "root" for b in bone])
    # a finger's points belong to its own ellipsoids, the palm's to the palm's and to the fingers' first bones
    first = np.array([b in [c[0] for c in CHAINS] for b in bone])
    allowed = np.where(
        surface.finger[None] >= 0, part[:, None] == surface.finger[None], (is_palm | first)[:, None]
    )
    w, count = surface.weight, len(surface.weight)
    # a phalanx lies in the middle of its finger's breadth; where a rig has it is chance
    spread = np.tile(np.array(sigma), (len(moved), 1))
    spread[[b == "root" for b in bone], 1::3] = (
        1e-3  # how far a hand goes behind its wrist is where a mask ends, no person's shape
    )
    spread[(part > 0) & ~is_palm, 0] = 0.3
    prior = strength / spread.ravel() ** 2
    x = np.zeros(6 * len(moved))

    def distance(e: int, y: Floats, mine: Array | slice = slice(None)) -> Floats:
        return _distance(surface.local[bone[e]][mine] - centre[e] - y[:3], radii[e] * np.exp(y[3:]))

    def every(x: Floats) -> Floats:
        d = np.stack([distance(e, x[6 * e : 6 * e + 6]) for e in range(len(moved))])
        return np.where(allowed, d, np.inf)

    for step in range(steps):
        d = every(x)
        nearest, off = d.argmin(axis=0), d.min(axis=0)
        if report and step in (0, steps - 1):
            print(
                f"  step {step}: mean {np.average(np.abs(off), weights=w):.2f} mm, rms {np.sqrt(np.average(off**2, weights=w)):.2f}, bias {np.average(off, weights=w):+.2f}"
            )
        robust = w / np.maximum(np.abs(off) / 3.0, 1.0)
        for e in range(
            len(moved)
        ):  # a point measures one ellipsoid: the normal equations are blocks
            mine = np.flatnonzero(nearest == e)
            y, p = x[6 * e : 6 * e + 6], prior[6 * e : 6 * e + 6]
            if len(mine) == 0:
                x[6 * e : 6 * e + 6] = 0.6 * y
                continue
            jacobian = np.stack(
                [
                    (distance(e, y + h, mine) - off[mine]) / h.max()
                    for h in np.diag([1e-2] * 3 + [1e-3] * 3)
                ],
                axis=1,
            )
            left = (jacobian * robust[mine, None]).T @ jacobian / count + np.diag(p)
            right = jacobian.T @ (robust[mine] * off[mine]) / count + p * y
            x[6 * e : 6 * e + 6] = y - 0.6 * np.linalg.solve(left, right)
    found = [dict(r) for r in rows]
    for e, i in enumerate(moved):
        found[i]["centre"] = (centre[e] + x[6 * e : 6 * e + 3]).tolist()
        found[i]["radii"] = (radii[e] * np.exp(x[6 * e + 3 : 6 * e + 6])).tolist()
    return found


def off_surface(rows: list[dict[str, Any]], surface: Surface) -> Floats:
    """Return how far each point is from the nearest of these ellipsoids [mm], negative inside."""
    near = [
        _distance(surface.local[r["bone"]] - r["centre"], np.array(r["radii"], float))
        for r in rows
        if r["bone"] != "forearm"
    ]
    return np.min(near, axis=0)


def _distance(q: Floats, r: Floats) -> Floats:
    k, length = np.sqrt(((q / r) ** 2).sum(axis=1)), np.linalg.norm(q, axis=1)
    return np.where(k > 1, (k - 1) / np.maximum(k, 1e-6) * length, (k - 1) * r.min())


def _unit(v: Any) -> Floats:
    v = np.asarray(v, float)
    return v / np.linalg.norm(v)


def _between(a: Floats, b: Floats) -> Floats[D3, D3]:
    """Return the smallest rotation from one direction to another."""
    a, b = _unit(a), _unit(b)
    axis, cosine = np.cross(a, b), float(a @ b)
    k = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.eye(3) + k + k @ k / (1 + cosine)
