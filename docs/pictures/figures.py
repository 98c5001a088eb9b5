"""Draws docs/figures/model.png and jumps_flips.png. Run: python -m docs.pictures.figures [FOLDER]; needs the extra `docs`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from docs.pictures.model_pictures import model_pictures
from docs.pictures.plotting import pyplot, saved, tight
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.model_file import load_model
from handtrack.simulation.scenes.jump_scene import KJS1, JumpScene, full_scene

_CROP = (slice(85, 395), slice(150, 500))
_FOUND = "#D55E00"
_BONES = (
    ("pelvis", "neck", "head", "head_top"),
    *((f"{s}_shoulder", f"{s}_elbow", f"{s}_wrist") for s in ("left", "right")),
    *((f"{s}_hip", f"{s}_knee", f"{s}_ankle") for s in ("left", "right")),
    ("left_shoulder", "neck", "right_shoulder"),
    ("left_hip", "pelvis", "right_hip"),
)


def main(folder: Path) -> None:
    """Write both figures."""
    folder.mkdir(parents=True, exist_ok=True)
    saved(draw_model(load_model()), folder / "model.png")
    saved(draw_flips(full_scene()), folder / "jumps_flips.png")


def draw_model(model: ArticulatedModel) -> Any:
    """Return the 2007 paper's Fig. 1: skeleton, flesh, field, together."""
    params = model.rest_params()
    params[1] -= 0.09
    pictures = model_pictures(model, params)
    figure, axes = pyplot().subplots(1, 4, figsize=(9, 2.0))
    for axis, (title, picture) in zip(axes, pictures.items(), strict=True):
        axis.imshow(picture[_CROP])
        axis.set_axis_off()
        axis.set_title(title, fontsize=8)
    return tight(figure)


def draw_flips(scene: JumpScene) -> Any:
    """Return all minima that KJS1 finds in one scene: alike in the image, different from the side."""
    found = scene.polished(scene.tree(KJS1)).params
    figure, (image, side, above) = pyplot().subplots(1, 3, figsize=(9, 3.6))
    for params in [*found, scene.start]:
        at_start = params is scene.start
        style = {"color": "black" if at_start else _FOUND, "lw": 1.8 if at_start else 0.7}
        points = scene.model.joint_positions(scene.model.bones(params))
        pixels = scene.observed.camera.project(points)
        for line in _BONES:
            at = [scene.model.joint_names.index(name) for name in line]
            image.plot(*pixels[at].T, **style)
            side.plot(points[at, 2], points[at, 1], **style)
            above.plot(points[at, 0], points[at, 2], **style)
    image.plot(*scene.observed.pixels.T, "o", color="#0072B2", ms=3)
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


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "docs/figures"))
