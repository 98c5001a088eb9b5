"""Benchmark: minima found by kinematic jumps and by random samplers, Table 1 of the 2003 paper. Run: python -m tests.experiments.jumps.minima."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

import numpy as np

from handtrack.arrays import Array, Floats, M, N, P
from handtrack.bench.measuring import alone
from handtrack.sampling.diffusion import projected
from handtrack.sampling.keypoint_kernels import keypoint_cost, workspace
from handtrack.sampling.keypoint_problem import keypoint_problem
from handtrack.sampling.polish import Polished
from handtrack.sampling.suppression import MERGED_RAD, distinct
from handtrack.simulation.scenes.jump_scene import (
    KJS1,
    KJS2,
    LIMBS,
    JumpScene,
    full_scene,
    jump_scene,
)

Tails = Literal["gaussian", "cauchy"]
SAMPLES, POSES = 2000, 100
SCALES: tuple[tuple[float, Tails], ...] = (
    (1.0, "gaussian"), (4.0, "gaussian"), (8.0, "gaussian"), (16.0, "gaussian"), (1.0, "cauchy"),
)  # fmt: skip
EVERYTHING = ("neck", *LIMBS)
GOOD_SIGMAS = 3.0


def covariance_scaled(
    mean: Floats[P],
    covariance: Floats[P, P],
    scale: float,
    count: int,
    rng: np.random.Generator,
    tails: Tails,
) -> Floats[N, P]:
    """Return `diffusion.covariance_scaled`, or with Cauchy's tails along each principal axis."""
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    spread = vectors * np.sqrt(np.maximum(values, 0.0))
    return mean + scale * _unit(len(mean), count, rng, tails) @ spread.T


def spherical(
    mean: Floats[P],
    covariance: Floats[P, P],
    scale: float,
    count: int,
    rng: np.random.Generator,
    tails: Tails,
) -> Floats[N, P]:
    """Return samples = mean + scale · r z: what knows nothing of the cost but how large its core is.

    r = (λ₁ … λ_P)^(1/2P): sphere and covariance ellipsoid have the same volume, as in the 2003 paper, §5.1.
    """
    radius = np.exp(0.5 * np.linalg.slogdet(covariance)[1] / len(covariance))
    return mean + scale * radius * _unit(len(mean), count, rng, tails)


def _unit(size: int, count: int, rng: np.random.Generator, tails: Tails) -> Floats[N, P]:
    if tails == "cauchy":
        return rng.standard_cauchy(size=(count, size))
    return rng.normal(size=(count, size))


@dataclass(frozen=True)
class Row:
    """One row of Table 1. Raw: of the samples; found: of the distinct minima that they polish to."""

    name: str
    scale: str
    samples: int
    minima: int
    minima_at_equal: int
    """among the first few samples, as many as KJS1 has leaves"""
    distance_raw: float
    """median distance from the start, in parameters [rad, and m for the root's place]"""
    distance_found: float
    std_raw: float
    """the same in standard deviations of the start"""
    std_found: float
    cost_raw: float
    """median cost ½ Σ r² with r in pixels, priors included, less the start's"""
    cost_found: float
    converged: float
    """share of samples that reach a minimum: gradient below tolerance, Hessian positive on the free directions"""
    seconds: float
    """drawing and polishing, processor time of one thread"""
    good: int = 0
    """of the minima: those that cost no more than GOOD_SIGMAS standard deviations above the least that any row found"""
    good_at_equal: int = 0

    @property
    def minima_per_second(self) -> float:
        return self.minima / self.seconds


@dataclass(frozen=True, eq=False)
class Sampled:
    """What a row is made from."""

    row: Row
    raw: Floats[N, P]
    found: Floats[M, P]
    """distinct minima"""
    cost: Floats[M]
    """theirs"""
    cost_at_equal: Floats[M]
    """of those among the first few samples"""


def sampled(
    scene: JumpScene, name: str, scale: str, draw: Callable[[], Floats[N, P]], equal: int
) -> Sampled:
    """Return the row of a sampler: drawn, polished, near-equal minima merged."""
    begin = time.process_time()
    raw = draw()
    ends = scene.polished(raw)
    seconds = time.process_time() - begin
    good = ends.is_minimum
    assert np.allclose(ends.params, projected(scene.model, ends.params)), "a minimum beyond limits"
    found, cost = _different(ends, good)
    _, cost_at_equal = _different(ends, good & (np.arange(len(raw)) < equal))
    costs = scene_costs(scene, np.concatenate([raw, found])) - scene.start_cost
    far = parameter_distance(scene, np.concatenate([raw, found]))
    deep = std_distance(scene, np.concatenate([raw, found]))
    medians = [_medians(each, len(raw)) for each in (far, deep, costs)]
    row = Row(
        name, scale, len(raw), len(found), len(cost_at_equal),
        *medians[0], *medians[1], *medians[2], float(good.mean()), seconds,
    )  # fmt: skip
    return Sampled(row, raw, found, cost, cost_at_equal)


def _different(ends: Polished, rows: Array[N]) -> tuple[Floats[M, P], Floats[M]]:
    """Return the different minima among rows of where samples ended, and their costs."""
    params, cost = ends.params[rows], ends.cost[rows]
    chosen = distinct(params, cost)
    return params[chosen], cost[chosen]


def _medians(values: Floats, count: int) -> tuple[float, float]:
    found = float(np.median(values[count:])) if len(values) > count else float("nan")
    return float(np.median(values[:count])), found


def scene_costs(scene: JumpScene, params: Floats[N, P]) -> Floats[N]:
    """Return the whole cost at params."""
    problem = keypoint_problem(scene.model, [scene.seen], scene.priors, collision=scene.collision)
    space = workspace(problem)
    return np.array([keypoint_cost(problem, row, space) for row in params])


def parameter_distance(scene: JumpScene, params: Floats[N, P]) -> Floats[N]:
    """Return the Euclidean distances of params from the scene's start."""
    return np.linalg.norm(params - scene.start, axis=1)


def std_distance(scene: JumpScene, params: Floats[N, P]) -> Floats[N]:
    """Return the Mahalanobis distances of params from the scene's start."""
    off = params - scene.start
    return np.sqrt(np.einsum("np,np->n", off, np.linalg.solve(scene.covariance, off.T).T))


def table(
    scene: JumpScene,
    samples: int = SAMPLES,
    seed: int = 0,
    whole: Sequence[str] = EVERYTHING,
) -> list[Sampled]:
    """Return the rows: KJS1, KJS2, the chains `whole` at once, covariance-scaled and spherical samples at all scales."""
    equal = len(scene.tree(KJS1))
    jumps = {"KJS1": KJS1, "KJS2": KJS2, "KJS all": whole}
    rows = [
        sampled(scene, name, "", lambda limbs=limbs: scene.tree(limbs).params, equal)
        for name, limbs in jumps.items()
    ]
    for name, sampler in (("CSS", covariance_scaled), ("SS", spherical)):
        for number, (scale, tails) in enumerate(SCALES):
            rng = np.random.default_rng([seed, number])

            def draw(sampler=sampler, scale=scale, tails=tails, rng=rng) -> Floats:
                drawn = sampler(scene.start, scene.covariance, scale, samples, rng, tails)
                return projected(scene.model, drawn)

            shown = f"{scale:g}" if tails == "gaussian" else f"{scale:g}/HT"
            rows.append(sampled(scene, name, shown, draw, equal))
    most = min(row.cost.min(initial=np.inf) for row in rows) + 0.5 * GOOD_SIGMAS**2
    return [
        replace(
            each,
            row=replace(
                each.row,
                good=int((each.cost <= most).sum()),
                good_at_equal=int((each.cost_at_equal <= most).sum()),
            ),
        )
        for each in rows
    ]


@dataclass(frozen=True)
class Share:
    """Over many poses: how many of the leaves of a tree are, once polished, different minima."""

    poses: int
    """with at least one leaf; where the start is at a limit, noise can leave none"""
    leaves: int
    minima: int
    distinct: int
    poses_all_distinct: int

    @property
    def share(self) -> float:
        return self.distinct / self.leaves


def share_of_leaves(limbs: Sequence[str], seeds: Sequence[int], **scene: Any) -> Share:
    """Return the share over random frontal poses. scene: as `jump_scene`."""
    counts = []
    for seed in seeds:
        here = jump_scene(seed, **scene)
        leaves = here.tree(limbs).params
        if not len(leaves):
            continue
        ends = here.polished(leaves)
        good = ends.is_minimum
        counts.append((len(leaves), good.sum(), len(distinct(ends.params[good], ends.cost[good]))))
    leaves, minima, different = np.array(counts).T
    return Share(
        len(counts), int(leaves.sum()), int(minima.sum()), int(different.sum()),
        int((leaves == different).sum()),
    )  # fmt: skip


def jumps() -> dict[str, Any]:
    """Return Table 1 and the shares over many poses."""
    return alone("tests.experiments.jumps.minima", "--json")


def measure(samples: int = SAMPLES, poses: int = POSES) -> dict[str, Any]:
    """Return the benchmark's figures, measured in this process."""
    scene = full_scene()
    scene.polished(scene.tree(KJS1).params)  # compiled before anything is timed
    rows = [sample.row for sample in table(scene, samples)]
    figures: dict[str, Any] = {}
    for name, limbs in (("kjs1", KJS1), ("kjs2", KJS2)):
        over = share_of_leaves(limbs, range(poses))
        figures[f"{name}_leaves"] = over.leaves
        figures[f"{name}_minima_share"] = over.minima / over.leaves
        figures[f"{name}_distinct_share"] = over.share
        figures[f"{name}_poses_all_distinct"] = f"{over.poses_all_distinct} of {over.poses}"
        flat = share_of_leaves(limbs, range(poses), flat=0.35)
        figures[f"{name}_distinct_share_links_from_20_deg"] = flat.share
    by_name = {(row.name, row.scale): row for row in rows}
    jump, css4 = by_name["KJS1", ""], by_name["CSS", "4"]
    best = max(row.minima_per_second for row in rows if row.name == "CSS")
    figures["minima_per_second_over_best_css"] = jump.minima_per_second / best
    figures["raw_cost_kjs1_over_css4"] = jump.cost_raw / css4.cost_raw
    for name in ("SS", "CSS"):
        figures[f"most_minima_{name.lower()}_at_equal_samples"] = max(
            row.minima_at_equal for row in rows if row.name == name
        )
    figures["minima_kjs1_at_equal_samples"] = jump.minima
    figures["merged_within_rad_rms"] = MERGED_RAD
    figures["rows"] = [asdict(row) | {"minima_per_second": row.minima_per_second} for row in rows]
    figures["table"] = "\n" + markdown(rows)
    return figures


def markdown(rows: Sequence[Row]) -> str:
    """Return the table as text."""
    lines = [
        "| | scale | samples | minima | in the first few | good | in the first few | distance raw | found | std raw | found | cost raw | found | minima/s |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        lines.append(
            f"| {row.name} | {row.scale} | {row.samples} | {row.minima} | {row.minima_at_equal} | "
            f"{row.good} | {row.good_at_equal} | "
            f"{row.distance_raw:.2f} | {row.distance_found:.2f} | {row.std_raw:.1f} | {row.std_found:.1f} | "
            f"{row.cost_raw:.4g} | {row.cost_found:.3g} | {row.minima_per_second:.3g} |"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    result = measure()
    if "--json" in sys.argv:
        print(json.dumps(result))
    else:
        print(result.pop("table"))
        result.pop("rows")
        print(json.dumps(result, indent=1))
