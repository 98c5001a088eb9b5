"""Benchmark: time of an interpretation tree of 1024 leaves, beside a plain loop over its leaves."""

from __future__ import annotations

import itertools
import json
import math
from typing import Any

import numpy as np

from handtrack.arrays import Floats, P, indices
from handtrack.bench.measuring import alternating_medians
from handtrack.geometry.camera import Camera
from handtrack.model.articulated import ArticulatedModel, HandScale
from handtrack.model.model_file import load_model, model_from_definition
from handtrack.sampling.chains import Chain, chain_along, chains_of
from handtrack.sampling.interpretation_tree import interpretation_tree

LIMBS, LENGTH_M = 5, 0.25
Vector = tuple[float, float, float]
_X, _Y, _Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


def jump_tree_1024() -> dict[str, Any]:
    """Return ratio, ours_ms, reference_ms: one unbranched chain of ten links, all 2¹⁰ leaves within limits.

    No leaf is had as a combination of smaller trees; what that brings for a whole body is reported beside it.
    """
    model, camera = tentacle(), _camera()
    chain = chain_along(model, "tentacle", model.joint_names)
    params = _pose(model)
    body = load_model("body34")
    limbs = chains_of(body)
    standing = body.rest_params()

    def ours() -> Floats:
        return interpretation_tree(model, params, [chain], camera)

    def whole_body() -> Floats:
        return interpretation_tree(body, standing, limbs, camera)

    def reference() -> list[list[float]]:
        return leaves_one_by_one(model, params, chain, camera)

    found, known = ours(), np.array(reference())
    assert found.shape == known.shape == (1024, len(params)), (found.shape, known.shape)
    off = float(np.abs(_sorted(found) - _sorted(known)).max())
    own, loop, bodies = alternating_medians([ours, reference, whole_body], 5, 1)
    return {
        "ratio": own / loop,
        "ours_ms": own,
        "reference_ms": loop,
        "largest_difference_rad": off,
        "body34_five_limbs_ms": bodies,
        "body34_five_limbs_leaves": len(whole_body()),
        "reference": (
            "plain Python, leaf after leaf of 1024, the limbs of each from its root to its end: rays and spheres, both "
            "closed-form solutions of every ball and hinge, limits; floats and tuples, which is quicker than small "
            "arrays; ours with the given pose's kinematics and projection"
        ),
    }


def tentacle() -> ArticulatedModel:
    """Return five limbs of a ball joint and a hinge, one at the other's end, with limits."""
    names = ["base", *(f"{part}_{limb}" for limb in range(LIMBS) for part in ("upper", "lower"))]
    turns = {
        "upper": {"flex": (_X, -180, 180), "abd": (_Z, -89, 89), "twist": (_Y, -180, 180)},
        "lower": {"elbow": (_X, 0, 160)},
    }
    bones: list[dict[str, Any]] = []
    for at, name in enumerate(names, start=-1):
        part, _, limb = name.partition("_")
        begin = 1e3 * LENGTH_M * max(at, 0)
        bone = {"name": name, "group": "arm", "head": (0, begin, 0), "up": _Z}
        bone["tail"] = (0, begin + 1e3 * LENGTH_M, 0)
        bone |= {"parent": names[at]} if at >= 0 else {}
        bone["freedoms"] = [
            {"name": f"{turn}_{limb}", "axis": axis, "limits_deg": limits}
            for turn, (axis, *limits) in turns.get(part, {}).items()
        ]
        bones.append(bone)
    table = {
        "name": "tentacle",
        "length_mm": 1.0,
        "bone": bones,
        "joints": {name: (name, "head") for name in names[1:]} | {"tip": (names[-1], "tail")},
        "ellipsoids": {},
    }
    return model_from_definition(json.dumps(table), "right", HandScale(), False, "tentacle")


def leaves_one_by_one(
    model: ArticulatedModel, params: Floats[P], chain: Chain, camera: Camera
) -> list[list[float]]:
    """Return the leaves' parameters by the plain loop. The tentacle's zero pose has all frames parallel to the world."""
    bones = model.bones(params)
    first, *ends = indices(model.joint_names, chain.joints)
    places = model.joint_positions(bones)
    start = tuple(float(x) for x in places[first])
    carrier = [[float(x) for x in row] for row in bones.rotation[chain.carrier]]
    centre = tuple(float(x) for x in camera.centre)
    directions = camera.rays(camera.project(places))[ends]
    directions = [tuple(float(x) for x in ray) for ray in directions]
    axes = [
        [tuple(float(x) for x in chain.turns.axes[h]) for h in chain.hinges(i)]
        for i in range(len(directions))
    ]
    interval = [
        [tuple(map(float, chain.turns.interval[h])) for h in chain.hinges(i)]
        for i in range(len(directions))
    ]
    leaves = []
    for sides in itertools.product((-1.0, 1.0), repeat=len(directions)):
        frame, joint, angles = carrier, start, []
        for link, side in enumerate(sides):
            found = _link(frame, joint, centre, directions[link], side, axes[link], interval[link])
            if found is None:
                break
            pair, frame, joint = found
            angles += pair
        else:
            leaves.append([*(float(x) for x in params[:6]), *angles])
    return leaves


def _link(
    frame: list[list[float]],
    start: Any,
    centre: Any,
    ray: Any,
    side: float,
    axes: list[Any],
    interval: list[Any],
) -> tuple[list[float], list[list[float]], Vector] | None:
    arm = _minus(start, centre)
    along = _dot(arm, ray)
    inside = LENGTH_M**2 - (_dot(arm, arm) - along**2)
    if inside < 0:
        return None
    depth = along + side * math.sqrt(inside)
    end = (centre[0] + depth * ray[0], centre[1] + depth * ray[1], centre[2] + depth * ray[2])
    way = _minus(end, start)
    d = tuple(sum(frame[i][j] * way[i] for i in range(3)) for j in range(3))
    a, b = axes
    v = (0.0, LENGTH_M, 0.0)
    c, p, q = _dot(a, b), _dot(a, d), _dot(b, v)
    x, y = (p - c * q) / (1 - c * c), (q - c * p) / (1 - c * c)
    left = (_dot(v, v) - x * x - y * y - 2 * x * y * c) / (1 - c * c)
    if left < 0:
        return None
    n = _cross(a, b)
    for sign in (1.0, -1.0):
        w = sign * math.sqrt(left)
        z = (
            x * a[0] + y * b[0] + w * n[0],
            x * a[1] + y * b[1] + w * n[1],
            x * a[2] + y * b[2] + w * n[2],
        )
        pair = [_angle(a, z, d), _angle(b, v, z)]
        if all(low <= t <= high for t, (low, high) in zip(pair, interval, strict=True)):
            turned = [_turn(a, pair[0], _turn(b, pair[1], e)) for e in (_X, _Y, _Z)]
            new = [
                [sum(frame[i][k] * turned[j][k] for k in range(3)) for j in range(3)]
                for i in range(3)
            ]
            return pair, new, end
    return None


def _dot(a: Any, b: Any) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Any, b: Any) -> Vector:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def _minus(a: Any, b: Any) -> Vector:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def _angle(axis: Any, v: Any, d: Any) -> float:
    return math.atan2(_dot(axis, _cross(v, d)), _dot(v, d) - _dot(axis, v) * _dot(axis, d))


def _turn(axis: Vector, angle: float, v: Vector) -> Vector:
    s, c = math.sin(angle), math.cos(angle)
    k, n = (1.0 - c) * _dot(axis, v), _cross(axis, v)
    return (
        c * v[0] + s * n[0] + k * axis[0],
        c * v[1] + s * n[1] + k * axis[1],
        c * v[2] + s * n[2] + k * axis[2],
    )


def _sorted(leaves: Floats) -> Floats:
    return leaves[np.lexsort(np.round(leaves, 6).T[::-1])]


def _camera() -> Camera:
    """Return a camera so far off that no flip puts a link out of reach of its viewing ray."""
    matrix = np.array([[4000.0, 0.0, 640.0], [0.0, 4000.0, 960.0], [0.0, 0.0, 1.0]])
    pose = np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.9, 12.0])
    return Camera("camera", (1280, 1920), matrix, np.zeros(5), *pose)


def _pose(model: ArticulatedModel) -> Floats:
    """Return a pose that zigzags upwards, its links leaning about 35° towards the camera or away from it."""
    rng = np.random.default_rng(3)
    params = np.zeros(len(model.parameter_names))
    flex, abd, twist, elbow = (params[6 + k :: 4] for k in range(4))
    flex[:] = -1.2
    flex[0] = -0.6
    abd[:] = 0.05 * rng.normal(size=LIMBS)
    twist[:] = 0.05 * rng.normal(size=LIMBS)
    elbow[:] = 1.2 + 0.05 * rng.normal(size=LIMBS)
    return params
