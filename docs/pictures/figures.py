"""Draws docs/figures. Run: python -m docs.pictures.figures [FOLDER]; needs the extra `docs` (matplotlib)."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from docs.pictures.model_pictures import SKIN, model_pictures, rendered
from docs.pictures.plotting import pyplot, saved, tight
from handtrack.arrays import Bytes, F, Floats, S
from handtrack.diagnostics.residual_image import field_picture
from handtrack.geometry.camera import Camera
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.model_file import load_model
from handtrack.simulation.simulate import simulated_rig
from tests.experiments.silhouettes.binary_fist import FIST, MODES, RIGS, FistTrack, scene, track
from tests.experiments.silhouettes.field_recovery import Recovery, follow, recover

SHOWN = (0, 26, 36, 50)
"""frames of the gesture in the pictures"""
_CROP = (slice(85, 395), slice(150, 500))
_LABELS = {
    "conic_field": "the paper's: conic field, no priors",
    "conic_field_priors": "conic field with priors",
    "coverage_paper_loop": "coverage, no priors",
    "coverage_weak_rest": "coverage, rest prior 120°",
    "coverage": "the default: coverage with priors",
}
_COLORS = {
    "conic_field": "#D55E00",
    "conic_field_priors": "#E69F00",
    "coverage_paper_loop": "#56B4E9",
    "coverage_weak_rest": "#009E73",
    "coverage": "#0072B2",
}


def main(folder: Path) -> None:
    """Write every figure."""
    folder.mkdir(parents=True, exist_ok=True)
    model = load_model()
    saved(draw_model(model), folder / "model.png")
    saved(draw_recovery(model), folder / "field_recovery.png")
    rigs = {cameras: scene(cameras) for cameras in RIGS}
    tracks = {n: {mode: track(rigs[n], MODES[mode]) for mode in MODES} for n in RIGS}
    gesture = rigs[2].joint_params
    field = follow(model, simulated_rig(2).cameras, gesture)
    binary = np.stack([r.parameters for r in tracks[6]["coverage"].results])
    saved(draw_gesture(model, gesture, field, binary), folder / "gesture.png")
    saved(draw_errors(tracks), folder / "binary_fist.png")
    saved(draw_uncertainty(tracks), folder / "uncertainty.png")


def draw_model(model: ArticulatedModel) -> Any:
    """Return the paper's Fig. 1: skeleton, flesh, field, together."""
    params = model.rest_params()
    params[1] -= 0.09
    pictures = model_pictures(model, params)
    figure, axes = pyplot().subplots(1, 4, figsize=(9, 2.0))
    for axis, (title, picture) in zip(axes, pictures.items(), strict=True):
        _shown(axis, picture[_CROP], title)
    return tight(figure)


def draw_gesture(
    model: ArticulatedModel,
    truth: Floats[F, S],
    field: Floats[F, S],
    binary: Floats[F, S],
    shown: tuple = SHOWN,
) -> Any:
    """Return the paper's Fig. 2. truth, field, binary: the latter two what each experiment found."""
    camera = simulated_rig(2).cameras[0]
    around = simulated_rig(6).cameras[0]
    figure, axes = pyplot().subplots(2, 2 * len(shown), figsize=(9, 2.5))
    for i, frame in enumerate(shown):
        _shown(axes[0, 2 * i], _field_of(model, truth[frame], camera), f"frame {frame}: seen")
        _shown(axes[0, 2 * i + 1], _skin_of(model, field[frame], camera), "found")
        mask = _field_of(model, truth[frame], around).max(axis=2, keepdims=True) > 24
        _shown(axes[1, 2 * i], np.repeat(255 * mask.astype(np.uint8), 3, axis=2))
        _shown(axes[1, 2 * i + 1], _skin_of(model, binary[frame], around))
    return tight(figure)


def draw_recovery(model: ArticulatedModel, seeds: int = 200) -> Any:
    """Return errors of start and end of each seed, both scales of the field."""
    cameras = simulated_rig(2).cameras
    figure, axis = pyplot().subplots(figsize=(5, 3))
    for scale, color, mark in (("normalised", "#0072B2", "o"), ("paper's", "#D55E00", "x")):
        rows: list[Recovery] = [
            recover(model, cameras, seed, scale != "normalised") for seed in range(seeds)
        ]
        start = [row.start_mm for row in rows]
        end = np.maximum([row.error_mm for row in rows], 1e-8)
        axis.plot(start, end, mark, color=color, ms=3, label=f"{scale} scale", alpha=0.7)
    axis.set(yscale="log", xlabel="mean joint error of the start [mm]", ylabel="of the end [mm]")
    axis.axhline(0.05, color="0.6", lw=0.8)
    axis.legend(frameon=False)
    return tight(figure)


def draw_errors(tracks: Mapping[int, Mapping[str, FistTrack]]) -> Any:
    """Return mean joint errors by frame, a panel a rig."""
    figure, axes = pyplot().subplots(1, len(tracks), figsize=(9, 2.8), sharey=True)
    for axis, (cameras, by_mode) in zip(axes, tracks.items(), strict=True):
        for mode, tracked in by_mode.items():
            axis.plot(tracked.error_mm, color=_COLORS[mode], label=_LABELS[mode], lw=1.2)
        axis.axvspan(FIST.start, FIST.stop - 1, color="0.92")
        axis.set(title=f"{cameras} cameras", xlabel="frame", yscale="log", ylim=(0.03, 30))
    axes[0].set_ylabel("mean joint error [mm]")
    tight(figure)
    lines, names = axes[0].get_legend_handles_labels()
    figure.subplots_adjust(bottom=0.25)
    figure.legend(lines, names, loc="lower center", ncol=len(names), frameon=False, fontsize=7)
    return figure


def draw_uncertainty(tracks: Mapping[int, Mapping[str, FistTrack]]) -> Any:
    """Return error and stated standard deviation by frame: two cameras with less and more of a prior; six."""
    chosen = (
        (2, "coverage_paper_loop"),
        (2, "coverage"),
        (2, "coverage_weak_rest"),
        (6, "coverage"),
    )
    figure, axes = pyplot().subplots(1, len(chosen), figsize=(9, 2.8), sharey=True)
    for axis, (cameras, mode) in zip(axes, chosen, strict=True):
        tracked = tracks[cameras][mode]
        axis.plot(tracked.error_mm, color="black", lw=1.2, label="error")
        axis.plot(tracked.stated_mm, color="#CC79A7", lw=1.2, label="stated")
        axis.axvspan(FIST.start, FIST.stop - 1, color="0.92")
        axis.set_title(f"{cameras} cameras\n{_LABELS[mode]}", fontsize=9)
        axis.set(xlabel="frame", yscale="log", ylim=(0.03, 100))
    axes[0].set_ylabel("joints [mm]")
    axes[-1].legend(frameon=False)
    return tight(figure)


def _field_of(model: ArticulatedModel, joint: Floats, camera: Camera) -> Bytes:
    bones = model.bones(model.transform.solver_params(joint))
    return field_picture(camera, model.flesh["fine"].posed(bones))[_CROP]


def _skin_of(model: ArticulatedModel, joint: Floats, camera: Camera) -> Bytes:
    bones = model.bones(model.transform.solver_params(joint))
    flesh = model.flesh["fine"].posed(bones)
    return rendered(camera, flesh, SKIN, np.array([250.0] * 3))[_CROP]


def _shown(axis: Any, picture: Bytes, title: str = "") -> None:
    axis.imshow(picture)
    axis.set_axis_off()
    if title:
        axis.set_title(title, fontsize=8)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "docs/figures"))
