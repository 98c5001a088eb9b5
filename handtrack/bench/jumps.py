"""Benchmarks of jumps: interpretation trees beside a plain loop over their leaves, polishing beside SciPy."""

from __future__ import annotations

import itertools
import json
import math
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from handtrack.arrays import Floats, P, R, indices
from handtrack.bench.measuring import alone, alternating_medians
from handtrack.compiled import compiled
from handtrack.geometry.camera import Camera
from handtrack.model.articulated import ArticulatedModel, HandScale
from handtrack.model.model_file import model_from_definition
from handtrack.sampling.chains import Chain, chain_along
from handtrack.sampling.diffusion import covariance_scaled, projected
from handtrack.sampling.interpretation_tree import interpretation_tree
from handtrack.sampling.keypoint_kernels import place, pose
from handtrack.sampling.keypoint_problem import keypoint_problem
from handtrack.simulation.scenes.jump_scene import JumpScene, body_priors, full_scene
from handtrack.terms.priors import GaussianPrior

LIMBS, LENGTH_M = 5, 0.25
_SAME_RAD = 1e-6
Vector = Sequence[float]
"""(3,), of floats in a tuple or a list"""
_X, _Y, _Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


def jump_tree_1024() -> dict[str, Any]:
    """Return ratio, ours_ms, reference_ms: one unbranched chain of ten links, all 2¹⁰ leaves within limits.

    No leaf is had as a combination of smaller trees.
    """
    model, camera = tentacle(), _camera()
    chain = chain_along(model, "tentacle", model.joint_names)
    params = _zigzag(model)

    def ours() -> Floats:
        return interpretation_tree(model, params, [chain], camera)

    def reference() -> list[list[float]]:
        return leaves_one_by_one(model, params, chain, camera)

    found, known = ours(), np.array(reference())
    assert found.shape == known.shape == (1024, len(params)), (found.shape, known.shape)
    assert np.allclose(_sorted(found), _sorted(known), rtol=0.0, atol=_SAME_RAD)
    own, loop = alternating_medians([ours, reference], 5, 1)
    return {
        "ratio": own / loop,
        "ours_ms": own,
        "reference_ms": loop,
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
    carrier = bones.rotation[chain.carrier].T.tolist()
    start, centre = places[first].tolist(), camera.centre.tolist()
    directions = camera.rays(camera.project(places))[ends].tolist()
    hinges = [chain.hinges(link) for link in range(len(directions))]
    axes = [chain.axes[own].tolist() for own in hinges]
    interval = [chain.interval[own].tolist() for own in hinges]
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
            leaves.append([*params[:6].tolist(), *angles])
    return leaves


def _link(
    frame: Sequence[Vector],
    start: Vector,
    centre: Vector,
    ray: Vector,
    side: float,
    axes: Sequence[Vector],
    interval: list[Any],
) -> tuple[list[float], list[Vector], Vector] | None:
    """Return a link's two angles, its frame's axes and its end on a viewing ray; None out of reach. frame: the axes before it."""
    arm = _minus(start, centre)
    along = _dot(arm, ray)
    inside = LENGTH_M**2 - (_dot(arm, arm) - along**2)
    if inside < 0:
        return None
    end = _sum((1.0, along + side * math.sqrt(inside), 0.0), (centre, ray, ray))
    way = _minus(end, start)
    d = _dot(frame[0], way), _dot(frame[1], way), _dot(frame[2], way)
    a, b = axes
    v = (0.0, LENGTH_M, 0.0)
    c, p, q = _dot(a, b), _dot(a, d), _dot(b, v)
    x, y = (p - c * q) / (1 - c * c), (q - c * p) / (1 - c * c)
    left = (_dot(v, v) - x * x - y * y - 2 * x * y * c) / (1 - c * c)
    if left < 0:
        return None
    for w in (math.sqrt(left), -math.sqrt(left)):
        z = _sum((x, y, w), (a, b, _cross(a, b)))
        pair = [_angle(a, z, d), _angle(b, v, z)]
        if all(low <= t <= high for t, (low, high) in zip(pair, interval, strict=True)):
            turned = [_turn(a, pair[0], _turn(b, pair[1], e)) for e in (_X, _Y, _Z)]
            return pair, [_sum(e, frame) for e in turned], end
    return None


def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _minus(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def _sum(weights: Vector, vectors: Sequence[Vector]) -> Vector:
    x, y, z = weights
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = vectors
    return x * ax + y * bx + z * cx, x * ay + y * by + z * cy, x * az + y * bz + z * cz


def _angle(axis: Vector, v: Vector, d: Vector) -> float:
    return math.atan2(_dot(axis, _cross(v, d)), _dot(v, d) - _dot(axis, v) * _dot(axis, d))


def _turn(axis: Vector, angle: float, v: Vector) -> Vector:
    s, c = math.sin(angle), math.cos(angle)
    return _sum((c, s, (1.0 - c) * _dot(axis, v)), (v, _cross(axis, v), axis))


def _sorted(leaves: Floats) -> Floats:
    return leaves[np.lexsort(np.round(leaves, 6).T[::-1])]


def _camera() -> Camera:
    """Return a camera so far off that no flip puts a link out of reach of its viewing ray."""
    matrix = np.array([[4000.0, 0.0, 640.0], [0.0, 4000.0, 960.0], [0.0, 0.0, 1.0]])
    pose = np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.9, 12.0])
    return Camera("camera", (1280, 1920), matrix, np.zeros(5), *pose)


def _zigzag(model: ArticulatedModel) -> Floats:
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


@compiled
def image_rows(problem, params, want_jacobian, residual, jacobian):  # pragma: no cover
    """Fill residual (2 O,) and jacobian (2 O, P) at params (P,); joint parameters are solver parameters here."""
    rotation, at, axes, root = pose(problem, params)
    row, (first, chain) = np.empty((2, 3)), problem.chains
    turns, shifts, focals, middles = problem.cameras
    begin, camera, target, information = problem.views
    for k in range(problem.points[0].shape[0]):
        b = problem.points[0][k]
        x, y, z = place(problem.points, rotation, at, k)
        for o in range(begin[k], begin[k + 1]):
            c, scale = camera[o], np.sqrt(information[o])
            turn, shift, focal, middle = turns[c], shifts[c], focals[c], middles[c]
            depth = turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z + shift[2]
            for i in range(2):
                across = turn[i, 0] * x + turn[i, 1] * y + turn[i, 2] * z + shift[i]
                seen = focal[i] * across / depth + middle[i]
                residual[2 * o + i] = scale * (seen - target[o, i])
                for j in range(3):
                    row[i, j] = (
                        scale * focal[i] / depth * (turn[i, j] - across / depth * turn[2, j])
                    )
            if not want_jacobian:
                continue
            for i in range(2):
                n0, n1, n2 = row[i, 0], row[i, 1], row[i, 2]
                out = jacobian[2 * o + i]
                out[:] = 0.0
                out[0], out[1], out[2] = n0, n1, n2
                d0, d1, d2 = x - at[0, 0], y - at[0, 1], z - at[0, 2]
                t0, t1, t2 = d1 * n2 - d2 * n1, d2 * n0 - d0 * n2, d0 * n1 - d1 * n0
                for s in range(3):
                    lever = root[1][:, s]
                    out[3 + s] = lever[0] * t0 + lever[1] * t1 + lever[2] * t2
                for n in range(first[b], first[b + 1]):
                    h = chain[n]
                    base = problem.tree[3][h]
                    d0, d1, d2 = x - at[base, 0], y - at[base, 1], z - at[base, 2]
                    t0, t1, t2 = d1 * n2 - d2 * n1, d2 * n0 - d0 * n2, d0 * n1 - d1 * n0
                    out[6 + h] = axes[h, 0] * t0 + axes[h, 1] * t1 + axes[h, 2] * t2


STARTS, SUBSET, SCALE = 1024, 48, 4.0
_SAME = 1e-4
"""costs closer than this are the same minimum"""


@alone
def jump_polish_1024() -> dict[str, Any]:
    """Return ratio, ours_ms, reference_ms and what the reference is."""
    scene = full_scene()
    drawn = covariance_scaled(
        scene.start, scene.covariance, SCALE, STARTS, np.random.default_rng(0).standard_normal
    )
    drawn = projected(scene.model, drawn)
    scene.polished(drawn[:1])
    residual, jacobian = _dense(scene)
    for warmed in (residual, jacobian):
        warmed(drawn[0])
    begin = time.process_time()
    ours = scene.polished(drawn)
    own = 1e3 * (time.process_time() - begin)
    bounds = scene.model.bounds(scene.start)
    low, high = bounds[:, 0] - 1e-9, bounds[:, 1] + 1e-9

    def scipy(method: str, **limits: Any) -> tuple[Floats[R], float]:
        """Return the costs reached, and the time that all starts would take [ms]."""
        given: Any = {"jac": jacobian, "method": method, "x_scale": "jac"} | limits
        given |= dict.fromkeys(("ftol", "xtol", "gtol"), 1e-10)
        begin = time.process_time()
        ends = [least_squares(residual, x, max_nfev=500, **given) for x in drawn[:SUBSET]]
        spent = 1e3 * (time.process_time() - begin)
        return np.array([end.cost for end in ends]), spent * STARTS / SUBSET

    costs, bounded = scipy("trf", bounds=(low, high))
    reference = min(bounded, scipy("lm")[1])
    return {
        "ratio": own / reference,
        "ours_ms": own,
        "reference_ms": reference,
        "reference": (
            f"processor time of one thread; scipy least_squares (the quicker of trf, limits as bounds, and lm without limits) with the same analytic Jacobian, compiled and dense, on {SUBSET} of "
            f"the starts, scaled to {STARTS}; covariance-scaled starts (scale {SCALE:g}) of body34, "
            f"{len(scene.observed.names)} image joints, priors, no collisions"
        ),
        "ours_lower_or_same": float((ours.cost[:SUBSET] <= costs + _SAME).mean()),
    }


def _dense(
    scene: JumpScene,
) -> tuple[Callable[[Floats[P]], Floats[R]], Callable[[Floats[P]], Floats[R, P]]]:
    """Return the scene as a general solver wants it: residuals at solver parameters, image joints [px], then priors [standard
    deviations]; and their derivatives.
    """
    problem, rows, means = keypoint_problem(scene.model, [scene.observed]), [], []
    for prior in body_priors(scene.model):
        assert isinstance(prior, GaussianPrior)
        known = np.flatnonzero(np.isfinite(prior.sigma))
        rows.append(np.eye(len(prior.sigma))[known] / prior.sigma[known, None])
        means.append(prior.mean[known] / prior.sigma[known])
    prior_rows, prior_means = np.concatenate(rows), np.concatenate(means)
    count = 2 * len(problem.views[1])

    def image(params: Floats[P], want_jacobian: bool) -> tuple[Floats[R], Floats[R, P]]:
        residual, jacobian = np.empty(count), np.empty((count * want_jacobian, len(params)))
        image_rows(problem, params, want_jacobian, residual, jacobian)
        return residual, jacobian

    return (
        lambda params: np.concatenate([image(params, False)[0], prior_rows @ params - prior_means]),
        lambda params: np.concatenate([image(params, True)[1], prior_rows]),
    )
