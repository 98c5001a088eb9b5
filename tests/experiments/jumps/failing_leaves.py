"""Benchmark: minima behind the leaves that the closed form cannot do: pruned, left to descent at what is nearest, or fitted to their joints first.

2003 paper, §3.2: where a ray misses its sphere or a limit is in the way, joint positions are met as nearly as can be by descent within limits.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from handtrack.arrays import D3, Floats, J, L, M, N, P
from handtrack.model.articulated import ArticulatedModel
from handtrack.observation.observation import Keypoints
from handtrack.sampling.chains import PreparedChain
from handtrack.sampling.interpretation_tree import (
    InterpretationTree,
    interpretation_tree,
)
from handtrack.sampling.keypoint_problem import keypoint_problem
from handtrack.sampling.limb_ik_kernels import pierce
from handtrack.sampling.polish import PolishSettings, polish_problem
from handtrack.sampling.suppression import distinct
from handtrack.simulation.scenes.jump_scene import LIMBS, JumpScene, body, jump_scene, limb_chains

POSES = 120
GOOD = 8.0
"""½ Σ r² above the start's: four standard deviations"""
_FOLLOWED_SIGMA_M = 0.001
_FITTING = PolishSettings(iterations=50, gradient_tolerance=1e-2)
"""to a hundredth of a millimetre where the positions can be reached"""


def fit_positions(
    model: ArticulatedModel,
    starts: Floats[N, P],
    free: Sequence[str],
    joints: Sequence[str],
    positions: Floats[N, J, D3],
) -> Floats[N, P]:
    """Return the poses within limits whose joints come closest to positions world [m], each from its own start, by damped Newton.

    Only the solver parameters named `free` move; two chains that form a loop (a hand on the hip) are named together.
    """
    rank = np.argsort([model.joint_names.index(name) for name in joints])
    held = ~np.isin(model.transform.names, free)
    problem = keypoint_problem(model, [Keypoints(tuple(joints), positions[0], _FOLLOWED_SIGMA_M)])
    found = []
    for start, places in zip(starts, positions, strict=True):
        limits = model.moving_limits.frozen(held, start)
        own = problem._replace(limits=limits, target=np.ascontiguousarray(places[rank]))
        found.append(polish_problem(own, start[None], _FITTING).params[0])
    return np.array(found)


def fitted_leaves(scene: JumpScene, chain: PreparedChain) -> Floats[M, P]:
    """Return a chain's leaves; those that do not meet all their joints are brought as near to all at once as limits let them."""
    leaves = _leaves(scene, chain, "nearest")
    rows = np.flatnonzero(~leaves.exact)
    if not len(rows):
        return leaves.params
    names = [scene.model.joint_names[j] for j in chain.end_joints]
    wanted = _positions(scene, chain, np.asarray(leaves.far[rows], dtype=int))
    fitted = leaves.params.copy()
    fitted[rows] = fit_positions(
        scene.model, leaves.params[rows], chain.chain.parameters, names, wanted
    )
    return fitted


def _leaves(scene: JumpScene, chain: PreparedChain, failing: str) -> InterpretationTree:
    return interpretation_tree(
        scene.model, scene.start, [chain], scene.camera, scene.targets, failing == "nearest"
    )


def _positions(scene: JumpScene, chain: PreparedChain, far: Any) -> Floats[N, L, D3]:
    """Return where the joints of leaves are to be: on their rays at the depths (N, L) chosen, or nearest to these."""
    model, each = scene.model, np.arange(len(far))
    start = model.joint_positions(model.bones(scene.start))
    end = np.tile(start[model.joint_names.index(chain.chain.joints[0])], (len(far), 1))
    pixels = scene.targets[chain.end_joints]
    wanted = np.empty((len(far), len(chain.reach), 3))
    for link, ray in enumerate(scene.camera.rays(pixels)):
        points, missed = np.empty((len(far), 2, 3)), np.empty((len(far), 2), dtype=np.int8)
        length = float(np.linalg.norm(chain.reach[link]))
        pierce(end, scene.camera.centre, ray, length, points, missed, True)
        there = (
            missed[each, far[:, link]] != 2
        )  # else the one point nearest to the ray stands for both
        end = np.ascontiguousarray(points[each, np.where(there, far[:, link], 0)])
        wanted[:, link] = end
    return wanted


def failing_leaves(poses: int = POSES) -> dict[str, Any]:
    """Return mean numbers over random poses, limb by limb: leaves, minima that they lead to, and good ones (within 4 σ of the start)."""
    figures: dict[str, Any] = {}
    for model_name in ("body34", "body38"):
        for noise_px in (1.0, 3.0):
            sums = {
                way: np.zeros(3) for way in ("pruned", "nearest", "fitted", "nearest_or_fitted")
            }
            for seed in range(poses):
                scene = jump_scene(
                    seed, noise_px=noise_px, flat=0.0, steep=1.0, model=body(model_name)
                )
                found = _minima(scene)
                found["nearest_or_fitted"] = np.concatenate([found["nearest"], found["fitted"]])
                for way, ends in found.items():
                    sums[way] += _counted(scene, ends)
            for way, (leaves, minima, good) in sums.items():
                name = f"{model_name}_{noise_px:g}_px_{way}"
                figures[f"{name}_leaves"] = leaves / poses
                figures[f"{name}_minima"] = minima / poses
                figures[f"{name}_good"] = good / poses
    return figures


def _minima(scene: JumpScene) -> dict[str, Floats[N, P]]:
    """Return by what becomes of failing leaves where all limbs' leaves end; NaN where in no minimum."""
    chains = [limb_chains(scene.model)[limb] for limb in LIMBS]
    starts = {
        "pruned": [_leaves(scene, chain, "prune").params for chain in chains],
        "nearest": [_leaves(scene, chain, "nearest").params for chain in chains],
        "fitted": [fitted_leaves(scene, chain) for chain in chains],
    }
    found = {}
    for way, rows in starts.items():
        ends = scene.polished(np.concatenate(rows))
        found[way] = np.column_stack([ends.params, np.where(ends.is_minimum, ends.cost, np.inf)])
    return found


def _counted(scene: JumpScene, ends: Floats[N, M]) -> tuple[int, int, int]:
    """Return numbers of leaves, of different minima, and of good ones. ends: parameters and cost."""
    params, cost = ends[:, :-1], ends[:, -1]
    good = np.isfinite(cost)
    different = cost[good][distinct(params[good], cost[good])]
    return len(ends), len(different), int((different < scene.start_cost + GOOD).sum())
