"""Draws docs/figures/monocular_dance.png. Run: python -m docs.pictures.monocular_dance FILE.png; it tracks first, which takes minutes."""

from __future__ import annotations

import sys
from itertools import pairwise
from pathlib import Path

import numpy as np

from docs.pictures.plotting import pyplot
from handtrack.model.articulated import ArticulatedModel
from tests.experiments.jumps.monocular_dance import (
    FPS,
    NEAR_MM,
    SHOWN,
    DanceErrors,
    SeenDance,
    seen_dance,
    tracked,
)


def draw(file: Path, what: SeenDance, several: DanceErrors, one: DanceErrors) -> None:
    """Draw errors over time, and the frame in which one hypothesis is furthest off, from the front and from above."""
    plt = pyplot()
    figure, axes = plt.subplots(
        1, 3, figsize=(11, 3.6), width_ratios=(2.2, 1, 1), layout="constrained"
    )
    time = np.arange(len(several.own)) / FPS
    axes[0].plot(time, one.own, color="#D55E00", label="one hypothesis")
    axes[0].plot(time, several.own, color="#56B4E9", label="own choice among 8")
    axes[0].plot(time, several.oracle, color="#0072B2", label="best of 8")
    axes[0].axhline(NEAR_MM, color="0.6", lw=1, ls="--")
    axes[0].set(xlabel="time [s]", ylabel="mean joint error [mm]", ylim=(0, None))
    axes[0].legend(frameon=False)
    frame = int(np.argmax(one.own - several.own))
    root = what.model.joint_names.index("pelvis")
    shapes = [(what.places[frame], "0.2", 2.5)]
    for pose in several.results[frame].alternatives[:SHOWN][::-1]:
        params = what.model.transform.solver_params(pose.parameters)
        places = what.model.joint_positions(what.model.bones(params))
        shapes.append((places, "#56B4E9", 1.0))
    shapes.append((one.results[frame].joint_positions, "#D55E00", 1.2))
    for axis, (across, up), title in ((axes[1], (0, 1), "front"), (axes[2], (0, 2), "above")):
        for places, colour, width in shapes:
            for a, b in _limbs(what.model):
                line = places[[a, b]] - places[root]
                axis.plot(line[:, across], line[:, up], color=colour, lw=width)
        axis.set_aspect("equal")
        axis.set_title(f"{title}, {frame / FPS:.1f} s", fontsize=9)
        axis.axis("off")
    if axes[2].get_ylim()[0] < axes[2].get_ylim()[1]:
        axes[2].invert_yaxis()  # the camera is below
    figure.savefig(file, dpi=110)
    plt.close(figure)


def _limbs(model: ArticulatedModel) -> list[tuple[int, int]]:
    joints = [("pelvis", "chest"), ("chest", "neck"), ("neck", "head_top")]
    for side in ("left", "right"):
        for chain in (
            ("neck", "shoulder", "elbow", "wrist", "hand"),
            ("pelvis", "hip", "knee", "ankle", "toe"),
        ):
            names = [chain[0], *(f"{side}_{joint}" for joint in chain[1:])]
            joints += list(pairwise(names))
    return [(model.joint_names.index(a), model.joint_names.index(b)) for a, b in joints]


if __name__ == "__main__":
    stretch = seen_dance(0)
    with_eight, alone = tracked(stretch, SHOWN), tracked(stretch, 1)
    draw(Path(sys.argv[1]), stretch, with_eight, alone)
