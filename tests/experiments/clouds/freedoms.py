"""Benchmark: joint error with 26, 21 and 18 freedoms, for fingers that obey the coupling and for others.

A motion of 26 freedoms is made to obey (the last joint bends by 2/3 of the one before, abductions are linked with one
person's constants), or not to (each joint adds a slow wander of its own). It is tracked with each set of freedoms.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import CubicSpline

from handtrack import ArticulatedModel, Observation, load_model
from handtrack.arrays import F, Floats, S
from handtrack.simulation.motion import motion
from tests.experiments.scenes.simulated_clouds import FINE, NOISY, Sensor, depth_views
from tests.experiments.tracked_frames import mean_mm, tracked

PERSON = {"index": 1.0, "middle": -0.1, "ring": 0.8, "little": 1.5}
"""the constants of the person who moves; not the usual ones"""
FREEDOMS = ("26", "21", "18", "18_usual")
"""`18` knows the person's constants, `18_usual` takes the definition's"""
HANDS = ("coupled", "independent")
SENSORS: dict[str, Sensor] = {"fine": FINE, "noisy": NOISY}
FRAMES = 20
_WANDER_RAD = np.deg2rad(15.0)
_SPREAD_RAD = np.deg2rad(12.0)


def freedoms(seeds: int = 2) -> dict[str, float | int | str]:
    """Return the mean joint error [mm] of all frames and seeds for each hand, sensor and set of freedoms."""
    figures: dict[str, float | int | str] = {"seeds": seeds, "frames": FRAMES}
    for sensor in SENSORS:
        for hand in HANDS:
            errors: dict[str, list[float]] = {free: [] for free in FREEDOMS}
            for seed in range(seeds):
                truth, seen = scene(hand, sensor, seed)
                for free in FREEDOMS:
                    errors[free].append(error_mm(free, truth, seen))
            for free, found in errors.items():
                figures[f"{sensor}_{hand}_{free}_mm"] = float(np.mean(found))
    return figures


def scene(
    hand: str, sensor: str, seed: int, frames: int = FRAMES
) -> tuple[Floats[F, S], list[Observation]]:
    """Return joint parameters (F, 26) of a motion that obeys the coupling or not, and its clouds."""
    rng = np.random.default_rng(seed)
    truth = fingers_of(hand, FRAMES, rng)[:frames]
    return truth, list(depth_views(load_model(), truth, SENSORS[sensor], rng))


def fingers_of(hand: str, frames: int, rng: np.random.Generator) -> Floats[F, S]:
    """Return joint parameters (F, 26) within limits: half of an opening and closing, fingers spreading on the way."""
    coupled = person("18")
    joint = motion(coupled, "curl", 2 * frames, rng)[:frames]
    joint[:, 6:] *= 0.7
    spread = coupled.transform.names.index("spread")
    solver = np.stack([coupled.transform.solver_params(row) for row in joint])
    solver[:, spread] = _SPREAD_RAD * np.abs(_wander(frames, 1, rng)[:, 0])
    own = np.stack([coupled.joint_params(coupled.clipped(row)) for row in solver])
    if hand == "coupled":
        return own
    free = person("26")
    own[:, 6:] += _WANDER_RAD * _wander(frames, own.shape[1] - 6, rng)
    return np.stack([free.clipped(row) for row in own])


def person(free: str) -> ArticulatedModel:
    """Return the model with a set of freedoms, with the person's own constants where they are known."""
    spread = None if free == "18_usual" else PERSON
    return load_model(coupling=free.partition("_")[0], spread=spread)


def error_mm(free: str, truth: Floats[F, S], seen: Sequence[Observation]) -> float:
    """Return the mean distance of joints and tips over the frames, tracked from the true first pose [mm]."""
    model, whole = person(free), load_model()
    start = model.clipped(model.transform.solver_params(truth[0]))
    found = np.stack([r.joint_positions for r in tracked(model, {}, seen, start)])
    true = [whole.joint_positions(whole.bones(params)) for params in truth[: len(found)]]
    return mean_mm(found, np.stack(true))


def _wander(frames: int, count: int, rng: np.random.Generator) -> Floats:
    """Return smooth paths (F, count) of about unit size."""
    knots = rng.normal(size=(4, count))
    return CubicSpline(np.linspace(0, 1, 4), knots, axis=0)(np.linspace(0, 1, frames))
