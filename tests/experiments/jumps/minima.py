"""Benchmark: minima found by kinematic jumps and by random samplers, Table 1 of the 2003 paper. Run: python -m tests.experiments.jumps.minima."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from handtrack.arrays import Floats, N, P
from handtrack.bench.measuring import alone
from handtrack.sampling.diffusion import covariance_scaled, projected
from handtrack.sampling.suppression import distinct
from handtrack.simulation.scenes.jump_scene import (
    KJS1,
    KJS2,
    LIMBS,
    JumpScene,
    full_scene,
    jump_scene,
)

SAMPLES, POSES = 2000, 100
SCALES = ((1.0, "normal"), (4.0, "normal"), (8.0, "normal"), (16.0, "normal"), (1.0, "cauchy"))
"""of the standard deviations, and the tails along each axis"""


@dataclass(frozen=True)
class Row:
    """One row of Table 1."""

    name: str
    samples: int
    minima: int
    """distinct ones that the samples polish to"""
    minima_at_equal: int
    """among the first few samples, as many as KJS1 has leaves"""
    seconds: float
    """drawing and polishing, processor time of one thread"""


def row(name: str, scene: JumpScene, draw: Callable[[], Floats[N, P]], equal: int) -> Row:
    """Return the row of a sampler: drawn, polished, near-equal minima merged."""
    begin = time.process_time()
    raw = draw()
    ends = scene.polished(raw)
    seconds = time.process_time() - begin
    good = ends.is_minimum
    every, few = (
        len(distinct(ends.params[rows], ends.cost[rows]))
        for rows in (good, good & (np.arange(len(raw)) < equal))
    )
    return Row(name, len(raw), every, few, seconds)


def table(scene: JumpScene, samples: int) -> list[Row]:
    """Return the rows: KJS1, KJS2, all chains at once, covariance-scaled and spherical samples at all scales."""
    equal = len(scene.tree(KJS1))
    jumps = {"KJS1": KJS1, "KJS2": KJS2, "KJS all": ("neck", *LIMBS)}
    rows = [
        row(name, scene, lambda limbs=limbs: scene.tree(limbs), equal)
        for name, limbs in jumps.items()
    ]
    values = np.linalg.eigvalsh(scene.covariance)
    spreads = {
        "CSS": scene.covariance,
        # sphere and covariance ellipsoid have the same volume: 2003 paper, §5.1
        "SS": np.eye(len(values)) * np.exp(np.log(values).mean()),
    }
    for name, spread in spreads.items():
        for number, (scale, tails) in enumerate(SCALES):
            rng = np.random.default_rng(number)

            def draw(spread=spread, scale=scale, tails=tails, rng=rng) -> Floats:
                unit = rng.standard_cauchy if tails == "cauchy" else rng.standard_normal
                drawn = covariance_scaled(scene.start, spread, scale, samples, unit)
                return projected(scene.model, drawn)

            rows.append(row(name, scene, draw, equal))
    return rows


def different_share(limbs: Sequence[str], poses: int) -> float:
    """Return which share of a tree's leaves are, once polished, different minima, over random frontal poses."""
    leaves = different = 0
    for seed in range(poses):
        scene = jump_scene(seed)
        starts = scene.tree(limbs)
        if len(starts):  # where the start is at a limit, noise can leave none
            ends = scene.polished(starts)
            good = ends.is_minimum
            leaves += len(starts)
            different += len(distinct(ends.params[good], ends.cost[good]))
    return different / leaves


@alone
def jumps() -> dict[str, Any]:
    """Return how many minima each finds, and how many more a second jumps find than random samples."""
    scene = full_scene()
    scene.polished(scene.tree(KJS1))  # compiled before anything is timed
    rows = table(scene, SAMPLES)
    jump = rows[0]
    fastest = max(one.minima / one.seconds for one in rows if one.name == "CSS")
    return {
        f"kjs1_minima_of_{jump.samples}": jump.minima,
        **{
            f"{name.lower()}_minima_of_{jump.samples}": max(
                one.minima_at_equal for one in rows if one.name == name
            )
            for name in ("CSS", "SS")
        },
        "kjs1_different_minima": different_share(KJS1, POSES),
        "kjs2_different_minima": different_share(KJS2, POSES),
        "minima_per_second_over_css": jump.minima / jump.seconds / fastest,
        "rows": [vars(one) for one in rows],
    }
