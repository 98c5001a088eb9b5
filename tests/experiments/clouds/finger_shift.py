"""Benchmark: starts with every finger on its neighbour's place, repaired with and without the lost-finger search.

The palm is a knuckle too far to one side, and each finger is bent as the one is whose place it took: three fingers then fit
what is seen, one hangs in the air.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from handtrack.arrays import Floats, P
from handtrack.model.articulated import FINGERS, ArticulatedModel
from handtrack.model.model_file import load_model
from handtrack.model.pose_library import named_pose
from handtrack.model.surfaces.metaballs import MetaballSurface
from handtrack.model.surfaces.surface_mesh import sample_surface
from handtrack.observation.observation import Observation, PointCloud
from handtrack.simulation.scenes.simulated_views import mask_views
from handtrack.simulation.simulate import simulated_rig
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.descent import descend
from handtrack.tracking.frame.frame_terms import frame_terms
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.search.engine import Candidate
from handtrack.tracking.search.lost_finger import FingerObjective, with_fingers_found
from tests.experiments.scenes.simulated_clouds import FINE, depth_views
from tests.experiments.tracked_frames import joint_error_mm

SEEN = ("cloud", "depth", "silhouettes")
"""points all over the hand; one depth camera's; masks of three cameras"""
AS_GOOD = 2.0
"""[log-likelihood] a pose that costs at most this much more than what descent reaches from the truth is as good as it;
what no sensor saw cannot be asked for"""
_POSES = ("open", "flat", "rest", "curl", "point", "lsf_v", "lsf_w")
_POINTS, _NOISE_M = 3000, 3e-4
_TURN_RAD, _JOINT_RAD, _OFF_M = 0.25, np.deg2rad(6.0), 0.003


@dataclass(frozen=True)
class Repair:
    """One start, and what became of it."""

    start_mm: float
    alone_mm: float
    """mean joint error after descent"""
    escaped_mm: float
    """and after the escape from where descent ended"""
    alone_cost: float
    escaped_cost: float
    truth_cost: float
    """of what descent reaches from the true pose"""


def finger_shift(seeds: int = 50) -> dict[str, float | int | str]:
    """Return the shares of starts that end with every finger in place, for each way of seeing the hand."""
    figures: dict[str, float | int | str] = {"seeds": seeds}
    for seen in SEEN:
        rows = [repair(seed, seen) for seed in range(seeds)]
        alone = np.array([row.alone_cost <= row.truth_cost + AS_GOOD for row in rows])
        found = np.array([row.escaped_cost <= row.truth_cost + AS_GOOD for row in rows])
        worse = [row.escaped_cost > row.alone_cost + 1e-9 for row in rows]
        figures |= {
            f"{seen}_start_median_mm": float(np.median([row.start_mm for row in rows])),
            f"{seen}_alone_p90_mm": float(np.quantile([row.alone_mm for row in rows], 0.9)),
            f"{seen}_with_escape_p90_mm": float(np.quantile([row.escaped_mm for row in rows], 0.9)),
            f"{seen}_right_alone": float(alone.mean()),
            f"{seen}_right_with_escape": float(found.mean()),
            f"{seen}_wrong_ones": int((~alone).sum()),
            f"{seen}_wrong_ones_repaired": float(found[~alone].mean()) if (~alone).any() else 1.0,
            f"{seen}_dearer_with_escape": int(np.sum(worse)),
        }
    return figures


def repair(seed: int, seen: str) -> Repair:
    """Return what becomes of a random posture that starts one finger off, to either side in turn."""
    rng = np.random.default_rng(seed)
    model = load_model()
    truth = _posture(model, rng)
    side = 1.0 if seed % 2 else -1.0
    start = one_finger_off(model, truth, side)
    start[:3] += _OFF_M * rng.normal(size=3)
    start = model.clipped(start)
    settings = TrackerSettings()
    observation = _seen(model, truth, seen, rng)
    terms = frame_terms(model, settings, observation, model.bones(start), None)

    def descended(params: Floats) -> Floats:
        return descend(model, settings.solver, terms, params)[0].params

    alone = descended(start)
    near = FingerObjective.at(terms, alone)
    found = with_fingers_found(terms, alone, Control(), 0, "the benchmark asks")
    errors = (joint_error_mm(model, x, truth) for x in (start, alone, found))
    poses = (alone, found, descended(truth))
    costs = (near.measured(Candidate(model, x)).cost for x in poses)
    return Repair(*errors, *costs)


def one_finger_off(model: ArticulatedModel, params: Floats[P], side: float) -> Floats[P]:
    """Return params with each finger in its neighbour's place, bent as that one is; side 1: towards the little."""
    bones = model.bones(params)
    places = model.joint_positions(bones)
    index, little = (places[model.joint_names.index(f"{f}_mcp")] for f in ("index", "little"))
    joint = model.joint_params(params)
    moved = joint.copy()
    moved[:3] += side * (little - index) / 3.0
    four = FINGERS[1:] if side > 0 else FINGERS[:0:-1]
    for finger, other in pairwise(four):
        for bend in ("mcp_flex", "pip_flex", "dip_flex"):
            at, there = (model.skeleton.parameter(f"{f}_{bend}") for f in (finger, other))
            moved[at] = joint[there]
    return model.transform.solver_params(moved)


def _posture(model: ArticulatedModel, rng: np.random.Generator) -> Floats:
    joint = named_pose(model, str(rng.choice(_POSES)))
    joint[6:] += _JOINT_RAD * rng.normal(size=len(joint) - 6)
    joint[3:6] = _TURN_RAD * rng.normal(size=3)
    joint[1] = -0.09
    return model.clipped(model.transform.solver_params(joint))


def _seen(
    model: ArticulatedModel, truth: Floats, seen: str, rng: np.random.Generator
) -> Observation:
    if seen == "silhouettes":
        return mask_views(model, truth, simulated_rig(3, (320, 240)).cameras)
    if seen == "depth":
        return next(iter(depth_views(model, model.joint_params(truth)[None], FINE, rng)))
    points, _ = sample_surface(MetaballSurface.of(model), model.bones(truth), _POINTS, rng)
    noisy = points + _NOISE_M * rng.normal(size=points.shape)
    return Observation(0, 0.0, cloud=PointCloud(noisy))
