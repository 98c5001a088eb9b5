"""Render a textured model before a background, as a camera sees somebody in patterned clothes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from handtrack import Camera
from handtrack.arrays import D3, Array, B, Floats, H, Ints, K, N, W
from handtrack.model.kinematics import BonePoses
from handtrack.model.part_mesh import PartMesh
from handtrack.terms.images import DepthPicture, depth_picture, texture_points

Paint = Callable[[Ints[N], Floats[N, D3]], Floats[N, D3]]
"""bone, place in its frame [m] → colour, 0 … 255"""

_FINER = 2  # samples along a pixel's side
_LIGHT = np.array([-0.35, -0.6, -0.72])  # camera axes: from the upper left, behind the camera
_AMBIENT = 0.55


@dataclass(frozen=True, eq=False)
class Pattern:
    """Smooth random patterns, another on every bone: sums of waves in the bone's own frame."""

    base: Floats[B, D3]
    """mean colour"""
    wave: Floats[B, K, D3]
    """[1/m]"""
    phase: Floats[B, K]
    swing: Floats[B, K, D3]
    """of each colour"""

    @classmethod
    def random(cls, bones: int, rng: np.random.Generator, wave_length_m: float) -> Pattern:
        """Return a pattern with spots of about half the wave length."""
        count = 8
        direction = rng.normal(size=(bones, count, 3))
        direction /= np.linalg.norm(direction, axis=2, keepdims=True)
        length = wave_length_m * rng.uniform(0.6, 1.6, (bones, count, 1))
        return cls(
            rng.uniform(70, 185, (bones, 3)),
            2 * np.pi * direction / length,
            rng.uniform(0, 2 * np.pi, (bones, count)),
            rng.normal(scale=22.0, size=(bones, count, 3)),
        )

    def __call__(self, bone: Ints[N], local: Floats[N, D3]) -> Floats[N, D3]:
        angle = np.einsum("nki,ni->nk", self.wave[bone], local) + self.phase[bone]
        return self.base[bone] + np.einsum("nk,nkc->nc", np.sin(angle), self.swing[bone])


def in_image(picture: DepthPicture) -> tuple[Ints[H, W], Floats[H, W]]:
    """Return face and depth over the whole image."""
    row, column = np.indices(picture.camera.size[::-1])
    face, depth = picture.at(np.stack([column.ravel(), row.ravel()], axis=1))
    return face.reshape(row.shape), depth.reshape(row.shape)


def textured_picture(
    camera: Camera, mesh: PartMesh, bones: BonePoses, paint: Paint, background: Array[H, W, D3]
) -> tuple[Array[H, W, D3], Array[H, W]]:
    """Return a picture uint8 and the share of each pixel that the model covers.

    Lit from the upper left. Four samples a pixel; no lens distortion.
    """
    fine = camera.scaled((_FINER * camera.size[0], _FINER * camera.size[1]))
    picture = depth_picture(mesh, bones, fine)
    bone, local, pixel = texture_points(mesh, bones, picture, 1)
    column, row = np.rint(pixel).astype(int).T
    face, _ = in_image(picture)
    normal = mesh.carried(bones)[1][mesh.faces[face[row, column]]].mean(axis=1)
    light = np.clip(normal @ camera.rotation.T @ (_LIGHT / np.linalg.norm(_LIGHT)), 0.0, 1.0)
    image = cv2.resize(background, fine.size, interpolation=cv2.INTER_LINEAR).astype(np.float32)
    image[row, column] = paint(bone, local) * (_AMBIENT + (1 - _AMBIENT) * light)[:, None]
    covered = (face >= 0).astype(np.float32)
    small = cv2.resize(image, camera.size, interpolation=cv2.INTER_AREA)
    share = cv2.resize(covered, camera.size, interpolation=cv2.INTER_AREA)
    return np.clip(np.rint(small), 0, 255).astype(np.uint8), share


def cluttered_background(size: tuple[int, int], rng: np.random.Generator) -> Array[H, W, D3]:
    """Return a picture uint8 of random rectangles and spots of all sizes, width and height `size`."""
    width, height = size
    image = np.full((height, width, 3), rng.uniform(60, 190, 3), np.float32)
    for _ in range(60):
        w, h = rng.integers(15, width // 3, 2)
        x, y = rng.integers(-w // 2, width), rng.integers(-h // 2, height)
        color = 128 + 0.6 * (rng.uniform(30, 225) - 128) + rng.uniform(-40, 40, 3)
        cv2.rectangle(image, (int(x), int(y)), (int(x + w), int(y + h)), color.tolist(), -1)
    for spot in (2.0, 5.0, 15.0):
        noise = cv2.GaussianBlur(rng.normal(size=(height, width, 3)), (0, 0), spot)
        image += 14.0 * noise / noise.std()
    return np.clip(cv2.GaussianBlur(image, (0, 0), 0.8), 0, 255).astype(np.uint8)
