"""Rectified pairs: two virtual cameras whose rows lie along the line between the real ones.

The rotation is made here, not by cv2.stereoRectify: pairs above one another or rolled need no case
of their own, and two cameras that are turned towards each other keep what both see in the picture.
"""

from __future__ import annotations

from typing import TypeVar

import cv2
import numpy as np

from handtrack.arrays import D2, D3, Array, Axes, Floats, H, K, L, N, W, array_dataclass, pixel_grid
from handtrack.capture.images.raw_frames import level_line_at
from handtrack.errors import HandtrackError
from handtrack.geometry.camera import Camera, camera_matrix
from handtrack.geometry.lens import remap_source

_T = TypeVar("_T")
_BORDER_STEPS = 25  # points along each side of an image when its rectified place is looked for
_MOST_SCALE = 1.5  # of a rectified image over the real one
_LEAST_BASELINE_M = 1e-4
_LEAST_CROSSING_COS = 0.34  # 70 degrees: beyond that, two views have hardly a surface in common


@array_dataclass
class RectifiedPair:
    """Two virtual cameras without distortion, with the same rotation and rows; `left` is to the
    left of `right` in their own images."""

    left: Camera
    right: Camera
    real: tuple[Camera, Camera]
    """of the left and of the right one"""
    swapped: bool
    """whether the first of the two given cameras is `right`."""
    source: tuple[Floats[H, W, D2], Floats[H, W, D2]]
    """float32: the place in the real images of each rectified pixel."""

    @property
    def baseline_m(self) -> float:
        """Distance between the cameras."""
        return float(np.linalg.norm(self.right.centre - self.left.centre))

    @property
    def zero_disparity(self) -> float:
        """The disparity of what is infinitely far [px]."""
        return float(self.left.matrix[0, 2] - self.right.matrix[0, 2])

    def disparity_of(self, depth_m: float) -> float:
        """Return the disparity [px] at a depth z of the rectified cameras."""
        focal = float(self.left.matrix[0, 0])
        return focal * self.baseline_m / depth_m + self.zero_disparity

    def depth_of(self, disparity: Array[*Axes]) -> Array[*Axes]:
        """Return the depth z [m] of disparities [px]; NaN where they are beyond infinity."""
        parallax = disparity - self.zero_disparity
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = self.left.matrix[0, 0] * self.baseline_m / parallax
        return np.where(parallax > 0, depth, np.nan)

    def points(self, columns: Array[N], rows: Array[N], disparity: Array[N]) -> Floats[N, D3]:
        """Return world points [m] of left rectified pixels with their disparity [px]."""
        depth = self.depth_of(disparity)
        matrix = self.left.matrix
        across = np.column_stack(
            [
                (columns - matrix[0, 2]) / matrix[0, 0],
                (rows - matrix[1, 2]) / matrix[1, 1],
                np.ones(len(depth)),
            ]
        )
        return (across * depth[:, None]) @ self.left.rotation + self.left.centre

    def by_side(self, first: _T, second: _T) -> tuple[_T, _T]:
        """Return what the two given cameras have, the left one's before the right one's."""
        return (second, first) if self.swapped else (first, second)

    def rectify(
        self,
        image: Array[H, W, *Axes],
        side: int,
        linear: bool = True,
        along_level_lines: bool = False,
    ) -> Array[K, L, *Axes]:
        """Return an image (H, W) or (H, W, 3) of a real camera as the virtual one sees it.

        Parameters
        ----------
        side
            0 left, 1 right.
        linear
            Interpolate, and repeat the border outside, which makes no edges; false for masks, 0
            outside.
        along_level_lines
            Interpolate by the 2004 paper's rule (§2.2) instead of bilinearly.
        """
        source = self.source[side]
        if linear and along_level_lines:
            return np.round(level_line_at(image, *np.moveaxis(source, -1, 0))).astype(image.dtype)
        how = cv2.INTER_LINEAR if linear else cv2.INTER_NEAREST
        border = cv2.BORDER_REPLICATE if linear else cv2.BORDER_CONSTANT
        return np.asarray(cv2.remap(image, source, None, how, borderMode=border))  # type: ignore[call-overload]


def rectified(first: Camera, second: Camera) -> RectifiedPair:
    """Return the rectified pair of two calibrated cameras, in any arrangement side by side, above
    one another, rolled or turned towards each other.

    Raises HandtrackError for cameras in one place, or looking across each other by more than 70
    degrees.
    """
    line: Floats = second.centre - first.centre
    baseline = float(np.linalg.norm(line))
    who = f"cameras '{first.name}' and '{second.name}'"
    if baseline < _LEAST_BASELINE_M:
        raise HandtrackError(
            f"{who}: their centres are {baseline * 1e3:.3g} mm apart, so there is no stereo in "
            "them. Check the translations in the calibration, and world_unit_m."
        )
    axes = first.rotation[2], second.rotation[2]
    if axes[0] @ axes[1] < _LEAST_CROSSING_COS:
        angle = np.degrees(np.arccos(np.clip(axes[0] @ axes[1], -1, 1)))
        raise HandtrackError(
            f"{who} look in directions {angle:.0f} degrees apart; matching needs less than 70. "
            "Choose neighbouring cameras as the pair, or use their silhouettes."
        )
    x = line / baseline
    axis = axes[0] + axes[1]
    ahead = axis - (axis @ x) * x
    if np.linalg.norm(ahead) < 0.2 * np.linalg.norm(axis):
        raise HandtrackError(
            f"{who} look along the line between them; matching needs them beside each other."
        )
    z = ahead / np.linalg.norm(ahead)
    # of the two ways to lie, the one that is less turned from the real images
    swapped = bool(x @ (first.rotation[0] + second.rotation[0]) < 0)
    if swapped:
        x = -x
    rotation: Floats = np.asarray([x, np.cross(z, x), z], dtype=float)
    left, right = (second, first) if swapped else (first, second)
    focal = float(np.mean([np.diag(c.matrix)[:2] for c in (first, second)]))
    lows, highs = np.stack([_span(camera, rotation, focal) for camera in (left, right)], axis=1)
    rows = _limited(lows[:, 1].max(), highs[:, 1].min(), max(left.size[1], right.size[1]))
    widths = left.size[0], right.size[0]
    columns = [_limited(*span) for span in zip(lows[:, 0], highs[:, 0], widths)]
    width = int(max(high - low for low, high in columns)) + 1
    height = int(rows[1] - rows[0]) + 1
    if height < 8:
        raise HandtrackError(
            f"{who}: their images have no rows in common. Do they see the same thing?"
        )
    virtual = []
    for camera, (low, high) in zip((left, right), columns):
        middle = (low + high) / 2 - (width - 1) / 2
        matrix = camera_matrix(focal, focal, -middle, -rows[0])
        virtual.append(
            Camera(
                f"{camera.name} rectified",
                (width, height),
                matrix,
                np.zeros(5),
                rotation,
                np.asarray(-rotation @ camera.centre, dtype=float),
            )
        )
    source = _source(left, virtual[0]), _source(right, virtual[1])
    return RectifiedPair(virtual[0], virtual[1], (left, right), swapped, source)


def _span(camera: Camera, rotation: Floats, focal: float) -> Floats[D2, D2]:
    """Return where the image lies on the rectified plane: least column and row [px] from the foot of
    the camera, then the most."""
    width, height = camera.size
    across = np.linspace(0, width - 1, _BORDER_STEPS)
    down = np.linspace(0, height - 1, _BORDER_STEPS)
    border = np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)
    rays = camera.rays(border) @ rotation.T
    rays = rays[np.isfinite(rays).all(axis=1) & (rays[:, 2] > 0.1)]
    flat = focal * rays[:, :2] / rays[:, 2:]
    return np.stack([flat.min(axis=0), flat.max(axis=0)])


def _limited(low: float, high: float, real: int) -> tuple[float, float]:
    """Return the span, cut around its middle where it is much larger than the real image."""
    most, middle = _MOST_SCALE * real, (low + high) / 2
    low, high = np.floor(low), np.ceil(high)
    if high - low <= most:
        return float(low), float(high)
    return float(np.floor(middle - most / 2)), float(np.ceil(middle + most / 2))


def _source(real: Camera, flat: Camera) -> Floats[H, W, D2]:
    rays = flat.rays(pixel_grid(flat.size))
    return remap_source(real.project(real.centre + rays))
