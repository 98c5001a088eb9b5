"""Draws the fits to eight real depth frames, docs/figures/sr305.png among them. Run: python -m docs.pictures.depth_frames FOLDER"""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np

from handtrack.arrays import Array, Bytes, Floats
from handtrack.simulation.render import pixel_rays, render
from tests.experiments.clouds.sr305 import DepthFit, fitted
from tests.experiments.scenes.depth_hand import CAMERA, as_image


def overlay(fit: DepthFit, side: int = 320) -> Bytes:
    """Return a picture (side, 3 side, 3) BGR: the cloud with the model's outlines, the model, the cloud by distance.

    Green: on the surface; red: 10 mm and more off it.
    """
    bones = fit.model.bones(fit.model.transform.solver_params(fit.result.parameters))
    flesh = fit.model.flesh["fine"].posed(bones)
    front, _, normal = render(CAMERA, flesh, pixel_rays(CAMERA))
    grey = _painted(fit.measured, np.full((len(fit.measured), 3), 90.0))
    grey = _painted(fit.hand, np.full((len(fit.hand), 3), 150.0), grey)
    lit = 70 + 150 * np.clip(-normal[..., 2], 0, 1)
    shaded = np.where((front >= 0)[..., None], np.stack([lit * 0.6, lit * 0.8, lit], -1), grey)
    outlined = grey.copy()
    outlined[_borders(front, flesh.bone)] = (60, 200, 255)
    share = np.clip(fit.cloud_to_model_mm / 10.0, 0, 1)[:, None]
    by_distance = _painted(fit.hand, share * (60, 60, 255) + (1 - share) * (90, 220, 90), grey)
    middle = as_image(fit.hand.mean(axis=0)[None])[0] - side // 2
    x, y = (int(v) for v in np.clip(middle, 0, np.array(CAMERA.size) - side))
    parts = [p[y : y + side, x : x + side] for p in (outlined, shaded, by_distance)]
    picture = np.ascontiguousarray(np.hstack(parts).astype(np.uint8))
    text = (
        f"{fit.frame}: {fit.cloud_to_model_mm.mean():.1f} / {fit.model_to_cloud_mm.mean():.1f} mm"
    )
    cv2.putText(picture, text, (8, 20), cv2.FONT_HERSHEY_SIMPLEX, 0.55, (255, 255, 255), 1)
    return picture


def _borders(front: Array, bone: Array) -> Array:
    """Return where another bone's ellipsoid begins (H, W)."""
    shown = np.where(front >= 0, bone[np.maximum(front, 0)], -1)
    border = np.zeros(front.shape, bool)
    border[:, 1:] |= shown[:, 1:] != shown[:, :-1]
    border[1:] |= shown[1:] != shown[:-1]
    return border


def _painted(points: Floats, colours: Floats, onto: Array | None = None) -> Array:
    picture = np.zeros((*CAMERA.size[::-1], 3)) if onto is None else onto.copy()
    pixels = as_image(points)
    inside = ((pixels >= 0) & (pixels < CAMERA.size)).all(axis=1)
    picture[pixels[inside, 1], pixels[inside, 0]] = colours[inside]
    return picture


def main(folder: Path) -> None:
    """Print the figures and draw every fit, each in a picture and all in one."""
    folder.mkdir(parents=True, exist_ok=True)
    found = fitted()
    print(found.scale)
    pictures = []
    for fit in found.own_hand:
        pictures.append(overlay(fit))
        cv2.imwrite(str(folder / f"sr305_{fit.frame:03d}.png"), pictures[-1])
        print(
            f"{fit.frame:4d}: cloud → model {fit.cloud_to_model_mm.mean():.2f} mm, model → cloud "
            f"{fit.model_to_cloud_mm.mean():.2f} mm, {fit.result.status.name.lower()} {fit.result.note}"
        )
    half = (len(pictures) + 1) // 2
    sheet = np.hstack([np.vstack(pictures[:half]), np.vstack(pictures[half:])])
    cv2.imwrite(
        str(folder / "sr305.png"),
        cv2.resize(sheet, None, fx=0.4, fy=0.4, interpolation=cv2.INTER_AREA),
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
