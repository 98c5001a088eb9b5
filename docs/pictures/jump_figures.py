"""Draws the figures of docs/jumps.md. Run: python -m docs.pictures.jump_figures [FOLDER]; needs the extra `docs`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from docs.pictures.plotting import pyplot, saved, tight
from handtrack.arrays import Floats
from handtrack.sampling.diffusion import covariance_scaled, projected
from handtrack.sampling.suppression import distinct
from handtrack.simulation.scenes.jump_scene import KJS1, JumpScene, full_scene, jump_scene
from tests.experiments.jumps.minima import POSES, SAMPLES, parameter_distance, sampled, std_distance

_RAW, _FOUND = "#999999", "#D55E00"
_BONES = (
    ("pelvis", "neck", "head", "head_top"),
    *((f"{s}_shoulder", f"{s}_elbow", f"{s}_wrist") for s in ("left", "right")),
    *((f"{s}_hip", f"{s}_knee", f"{s}_ankle") for s in ("left", "right")),
    ("left_shoulder", "neck", "right_shoulder"),
    ("left_hip", "pelvis", "right_hip"),
)
CSS_SCALE = 8.0


def main(folder: Path) -> None:
    """Write every figure."""
    folder.mkdir(parents=True, exist_ok=True)
    saved(draw_distances(), folder / "jumps_distances.png")
    saved(draw_flips(full_scene()), folder / "jumps_flips.png")


def draw_distances(poses: int = POSES, samples: int = SAMPLES) -> Any:
    """Return the paper's Fig. 6: how far from the start samples and minima are, jumps above, random samples below."""
    raw, found = _over_poses(range(poses))
    scene = full_scene()
    rng = np.random.default_rng(0)

    def draw() -> Floats:
        drawn = covariance_scaled(scene.start, scene.covariance, CSS_SCALE, samples, rng)
        return projected(scene.model, drawn)

    random = sampled(scene, "CSS", f"{CSS_SCALE:g}", draw, 1)
    measures = (parameter_distance, std_distance)
    rows = (
        (f"KJS1, {poses} poses", raw, found),
        (
            f"CSS, scale {CSS_SCALE:g}",
            [measure(scene, random.raw) for measure in measures],
            [measure(scene, random.found) for measure in measures],
        ),
    )
    figure, axes = pyplot().subplots(2, 2, figsize=(8, 4.6))
    for (title, before, after), line in zip(rows, axes, strict=True):
        for axis, one, other, unit in zip(
            line, before, after, ("parameters [rad, m]", "standard deviations"), strict=True
        ):
            bins = np.linspace(0.0, np.quantile(np.concatenate([one, other]), 0.99), 41)
            axis.hist(one, bins, color=_RAW, label=f"samples ({len(one)})")
            axis.hist(
                other, bins, color=_FOUND, histtype="step", lw=1.5, label=f"minima ({len(other)})"
            )
            axis.set(xlabel=f"distance from the start, {unit}", title=title)
            axis.legend(frameon=False, fontsize=8)
    return tight(figure)


def draw_flips(scene: JumpScene) -> Any:
    """Return all minima that KJS1 finds in one scene: alike in the image, different from the side."""
    found = scene.polished(scene.tree(KJS1).params).params
    figure, (image, side, above) = pyplot().subplots(1, 3, figsize=(9, 3.6))
    for params in [*found, scene.start]:
        at_start = params is scene.start
        style = {"color": "black" if at_start else _FOUND, "lw": 1.8 if at_start else 0.7}
        points = scene.model.joint_positions(scene.model.bones(params))
        pixels = scene.camera.project(points)
        for line in _BONES:
            at = [scene.model.joint_names.index(name) for name in line]
            image.plot(*pixels[at].T, **style)
            side.plot(points[at, 2], points[at, 1], **style)
            above.plot(points[at, 0], points[at, 2], **style)
    image.plot(*scene.seen.pixels.T, "o", color="#0072B2", ms=3)
    image.invert_yaxis()
    titles = (
        "in the image",
        "from the side: camera at the right",
        "from above: camera at the bottom",
    )
    above.invert_yaxis()
    for axis, title in zip((image, side, above), titles, strict=True):
        axis.set_aspect("equal")
        axis.set_axis_off()
        axis.set_title(title, fontsize=9)
    return tight(figure)


def _over_poses(seeds: Sequence[int]) -> tuple[list[Floats], list[Floats]]:
    """Return distances of leaves and of their minima, in parameters and in standard deviations, over poses."""
    raw: list[list[Floats]] = [[], []]
    found: list[list[Floats]] = [[], []]
    for seed in seeds:
        scene = jump_scene(seed)
        leaves = scene.tree(KJS1).params
        if not len(leaves):
            continue
        ends = scene.polished(leaves)
        good = ends.is_minimum
        minima = ends.params[good][distinct(ends.params[good], ends.cost[good])]
        for n, measure in enumerate((parameter_distance, std_distance)):
            raw[n].append(measure(scene, leaves))
            found[n].append(measure(scene, minima))
    return [np.concatenate(each) for each in raw], [np.concatenate(each) for each in found]


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "docs/figures"))
