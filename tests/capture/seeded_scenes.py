"""Drawn recordings of a hand that moves and curls its fingers, in light that is hard on masks, with a detector's joints."""

from dataclasses import dataclass

import cv2
import numpy as np

from handtrack import load_model
from handtrack.arrays import Array, Bytes, Floats
from handtrack.simulation.render import pixel_rays, render
from tests.cameras import pinhole

SIZE = (360, 300)
SKIN = np.array([120.0, 150, 205])  # BGR
_JOINTS_OFF_PX = 5.0
_LIGHT = np.array([-0.35, -0.6, -0.72])


@dataclass
class Recording:
    """Images, true masks and joints by name; a frame source."""

    images: list[Bytes]
    truth: list[Array]
    joints: list[dict[str, Floats]]
    params: list[Floats]
    """solver parameters of the hand, `hand26`"""
    where: str = "drawn"
    size: tuple[int, int] = SIZE
    warnings: tuple[str, ...] = ()

    @property
    def frames(self) -> range:
        return range(len(self.images))

    def has(self, frame: int) -> bool:
        return frame in self.frames

    def read(self, frame: int) -> Bytes | None:
        return self.images[frame] if frame in self.frames else None


def recording(
    light: str, rng: np.random.Generator, frames: int = 24, of: int | None = None
) -> Recording:
    """Return frames of a right hand without a forearm, before a textured background, in a light: even, shadows, wood, backlight or infrared.

    of: how many frames its whole motion takes, if more than these.
    """
    model = load_model("hand26")
    camera = pinhole("cam0", SIZE, 420, translation=(0, -0.08, 0.55), at=(180, 150))
    rays = pixel_rays(camera)
    behind = _background(light, rng)
    out = Recording([], [], [], [])
    for frame in range(frames):
        phase = 2 * np.pi * frame / (of or frames)
        curl = np.deg2rad(35 * (1 - np.cos(3 * phase)))
        angles = {
            f"{finger}_{joint}_flex": curl
            for finger in ("index", "middle", "ring", "little")
            for joint in ("mcp", "pip")
        }
        params = model.rest_params() + model.params_from(angles)
        params[:6] = 0.10 * np.sin(phase), 0.04 * np.cos(2 * phase), 0, 0, 0.4 * np.sin(phase), 0.3
        params = model.clipped(params)
        bones = model.bones(params)
        front, _, normal = render(camera, model.ellipsoids["fine"].posed(bones), rays)
        hand = front >= 0
        image = behind.copy()
        if light != "even":
            image *= 1 - 0.6 * _shadow(hand)[..., None]
        lit = np.clip(normal @ (_LIGHT / np.linalg.norm(_LIGHT)), 0, 1)
        # fingers below the palm are in the shade
        image[hand] = (SKIN * (0.12 + 0.88 * lit[..., None]))[hand]
        if light == "backlight":
            image[hand] *= 0.35
        if light == "infrared":
            image = np.repeat(image.mean(axis=2, keepdims=True), 3, axis=2)
        image = cv2.GaussianBlur(image, (3, 3), 0) + rng.normal(scale=3.0, size=(*hand.shape, 1))
        out.images.append(np.clip(image, 0, 255).astype(np.uint8))
        out.truth.append(hand)
        out.params.append(params)
        places = camera.project(model.joint_positions(bones))
        places = places + rng.normal(scale=_JOINTS_OFF_PX, size=places.shape)
        out.joints.append(dict(zip(model.joint_names, places, strict=True)))
    return out


def _background(light, rng):
    width, height = SIZE
    coarse = cv2.resize(rng.normal(size=(height // 12, width // 12)), SIZE)
    fine = cv2.GaussianBlur(rng.normal(size=(height, width)), (3, 3), 0)
    if light == "wood":
        grain = np.sin(np.arange(height)[:, None] / 3.0 + 2 * coarse)
        shade = 0.85 + 0.08 * grain + 0.05 * coarse
        return SKIN * shade[..., None]
    level = {"even": 150, "shadows": 170, "backlight": 235, "infrared": 70}[light]
    shade = level + 12 * coarse + 4 * fine
    return np.repeat(shade[..., None], 3, axis=2) * np.array([1.0, 0.97, 0.92])


def _shadow(hand):
    moved = np.roll(hand.astype(np.float64), (14, 20), axis=(0, 1))
    return np.asarray(cv2.GaussianBlur(moved, (21, 21), 0), float)
