"""Benchmark: Table 1 of the 2003 paper on its own kind of limb: arms of three links with an end effector, body38. Run: python -m tests.experiments.jumps.three_links."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from typing import Any

import numpy as np

from handtrack.arrays import Floats, N, P
from handtrack.bench.measuring import alone
from handtrack.sampling.diffusion import covariance_scaled, projected
from handtrack.simulation.scenes.jump_scene import (
    KJS1,
    KJS2,
    LIMBS,
    JumpScene,
    body,
    jump_scene,
)
from tests.experiments.jumps.minima import (
    GOOD_SIGMAS,
    SAMPLES,
    SCALES,
    Sampled,
    markdown,
    sampled,
    share_of_leaves,
    table,
)

FLIPS = {"left_arm": 8, "right_arm": 8, "left_leg": 2, "right_leg": 2}
"""what limits allow of a limb at most: of 900 random arms one had 8 leaves, of 900 legs none more than 2"""
WITHIN_LIMITS_SEED = 9
"""the first seed whose start, too, has FLIPS, after the noise of the image"""
FREE_SEED = 3
POSES = 5
WIDEST = (2, 3)
"""of SCALES: 8 and 16, which find most minima"""


def scene_within_limits() -> JumpScene:
    """Return a body38 within an adult's limits, in a pose whose limbs may flip as much as these allow."""
    return jump_scene(WITHIN_LIMITS_SEED, model=body("body38"), flips=FLIPS)


def scene_without_limits() -> JumpScene:
    """Return a body38 whose arms and legs have no limits: all of their flips are poses."""
    return jump_scene(FREE_SEED, model=body("body38", limits=False))


def three_links() -> dict[str, Any]:
    """Return Table 1 within limits and without, and what both ways of counting say."""
    return alone("tests.experiments.jumps.three_links", "--json")


def measure(poses: int = POSES) -> dict[str, Any]:
    """Return the benchmark's figures, measured in this process: random samplers draw as many samples as the jumps have leaves."""
    figures: dict[str, Any] = {}
    for name, scene in (
        ("without_limits", scene_without_limits()),
        ("within_limits", scene_within_limits()),
    ):
        scene.polished(scene.tree(KJS2).params)  # compiled before anything is timed
        rows = table(scene, len(scene.tree(LIMBS)), whole=LIMBS)
        figures |= {f"{name}_{key}": value for key, value in headline(rows).items()}
        leaves = next(each.cost for each in rows if each.row.name == "KJS all")
        most = leaves.min() + 0.5 * GOOD_SIGMAS**2
        figures[f"{name}_jumps_near_best_leaf"] = int((leaves <= most).sum())
        for place in WIDEST:
            more = _as_many_as_the_paper(scene, place)
            figures[f"{name}_css_{more.row.scale}_of_{SAMPLES}"] = more.row.minima
            figures[f"{name}_css_{more.row.scale}_of_{SAMPLES}_near_best_leaf"] = int(
                (more.cost <= most).sum()
            )
        figures[f"{name}_leaves_of_limbs"] = str([len(scene.tree([limb])) for limb in LIMBS])
        figures[f"{name}_rows"] = [asdict(each.row) for each in rows]
        figures[f"{name}_table"] = "\n" + markdown([each.row for each in rows])
    for name, limbs in (("kjs1", KJS1), ("kjs2", KJS2)):
        over = share_of_leaves(limbs, range(poses), model=body("body38", limits=False))
        figures[f"without_limits_{name}_leaves"] = over.leaves
        figures[f"without_limits_{name}_distinct_share"] = over.share
    return figures


def _as_many_as_the_paper(scene: JumpScene, place: int) -> Sampled:
    """Return 2000 covariance-scaled samples of one of SCALES; the first are those of the table."""
    scale, tails = SCALES[place]
    rng = np.random.default_rng([0, place])

    def draw() -> Floats[N, P]:
        drawn = covariance_scaled(scene.start, scene.covariance, scale, SAMPLES, rng, tails)
        return projected(scene.model, drawn)

    return sampled(scene, "CSS", f"{scale:g}", draw, SAMPLES)


def headline(rows: list[Sampled]) -> dict[str, int]:
    """Return the most minima of each kind of sampler, all of them and good ones."""
    jump = next(each.row for each in rows if each.row.name == "KJS all")
    told = {"jumps": jump.minima, "jumps_good": jump.good, "jumps_samples": jump.samples}
    for name in ("CSS", "SS"):
        of = [each.row for each in rows if each.row.name == name]
        told |= {
            f"{name.lower()}_most": max(row.minima for row in of),
            f"{name.lower()}_most_good": max(row.good for row in of),
        }
    return told


if __name__ == "__main__":
    result = measure()
    if "--json" in sys.argv:
        print(json.dumps(result))
    else:
        for shown in ("without_limits", "within_limits"):
            print(result.pop(f"{shown}_table"))
            result.pop(f"{shown}_rows")
        print(json.dumps(result, indent=1))
