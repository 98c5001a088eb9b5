"""The lens that really took a camera's images, where a pinhole view of them is tracked.

A fisheye's image cannot be straightened as a whole: at 90° from the axis a pinhole's pixel lies at infinity. So a part of it
is seen through a pinhole that looks at its middle (`pinhole_views`), and images, masks and joints are brought there once.
The same holds for a matrix with skew, which a pinhole of ours does not have.
"""

from __future__ import annotations

import math

import numpy as np

from handtrack.arrays import D2, D3, Axes, Floats, H, K, W, array_dataclass, pixel_grid
from handtrack.errors import HandtrackError
from handtrack.geometry.camera import Camera
from handtrack.geometry.lens import COEFFICIENT_COUNTS, distort, undistort
from handtrack.geometry.rotation import looking_along, rotation_matrix

FISHEYE_COUNT = 4
WIDEST_RAD = math.radians(100.0)
"""of one view: at 50° from the axis a pinhole's pixels are 2.4 times as dense as in the middle"""
_NEWTON_STEPS = 30
_SHRINK = 0.98
_ON_BORDER = 33  # directions tried on each side of a view
_LEAST_PX = 16


@array_dataclass
class SourceLens:
    """A lens: OpenCV's polynomial in x/z, y/z, or `cv2.fisheye`'s in the angle from the axis (Kannala and Brandt 2006)."""

    size: tuple[int, int]
    """width, height [px] of its images."""
    matrix: Floats[D3, D3]
    """[px], with skew; pixel centres at whole numbers."""
    coefficients: Floats[K]
    """fisheye: k1 k2 k3 k4 of θ_d = θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸); else k1 k2 p1 p2 k3 …"""
    fisheye: bool

    def __post_init__(self) -> None:
        counts = (FISHEYE_COUNT,) if self.fisheye else COEFFICIENT_COUNTS
        for name, shapes in (("matrix", [(3, 3)]), ("coefficients", [(n,) for n in counts])):
            array = np.array(getattr(self, name), dtype=float)
            if array.shape not in shapes or not np.isfinite(array).all():
                raise HandtrackError(
                    f"the lens's {name} are {array.tolist()}; expected finite numbers of shape "
                    f"{' or '.join(map(str, shapes))}."
                )
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        if min(self.matrix[0, 0], self.matrix[1, 1]) <= 0 or min(self.size) < 1:
            raise HandtrackError(
                f"the lens has focal lengths {self.matrix[0, 0]:g}, {self.matrix[1, 1]:g} and images of "
                f"{self.size[0]} x {self.size[1]}; expected numbers above 0."
            )

    def project(self, directions: Floats[*Axes, D3]) -> Floats[*Axes, D2]:
        """Return the pixels of directions in the lens's frame (x right, y down, z forward); NaN where it shows none."""
        directions = np.asarray(directions, dtype=float)
        with np.errstate(divide="ignore", invalid="ignore"):
            if self.fisheye:
                across = np.linalg.norm(directions[..., :2], axis=-1)
                angle = np.arctan2(across, directions[..., 2])
                scale = np.where(across > 0, self._bent(angle) / across, 1 / directions[..., 2])
                flat = directions[..., :2] * scale[..., None]
                flat = np.where((angle <= self._widest)[..., None], flat, np.nan)
            else:
                ahead = np.where(directions[..., 2:] > 0, directions[..., 2:], np.nan)
                flat = distort(directions[..., :2] / ahead, self.coefficients)
        return flat @ self.matrix[:2, :2].T + self.matrix[:2, 2]

    def rays(self, pixels: Floats[*Axes, D2]) -> Floats[*Axes, D3]:
        """Return unit directions in the lens's frame through pixels; NaN where no direction leads there."""
        centred = np.asarray(pixels, dtype=float) - self.matrix[:2, 2]
        flat = centred @ np.linalg.inv(self.matrix[:2, :2]).T
        if not self.fisheye:
            straight = undistort(flat, self.coefficients)
            rays = np.concatenate([straight, np.ones_like(straight[..., :1])], axis=-1)
            return rays / np.linalg.norm(rays, axis=-1, keepdims=True)
        bent = np.linalg.norm(flat, axis=-1)
        angle = np.minimum(bent, self._widest)
        for _ in range(_NEWTON_STEPS):
            angle = np.clip(
                angle - (self._bent(angle) - bent) / self._slope(angle), 0, self._widest
            )
        angle = np.where(np.abs(self._bent(angle) - bent) < 1e-9, angle, np.nan)
        around = flat / np.where(bent > 0, bent, 1.0)[..., None]
        return np.concatenate(
            [around * np.sin(angle)[..., None], np.cos(angle)[..., None]], axis=-1
        )

    def source(self, view: Camera) -> Floats[H, W, D2]:
        """Return the pixel (H, W, 2) of the lens's image that each pixel of a view shows, of one of `pinhole_views`; NaN where none does."""
        pixels = np.dstack([pixel_grid(view.size), np.ones(view.size[::-1])])
        return self.project(pixels @ np.linalg.inv(view.matrix).T @ view.rotation)

    @property
    def _widest(self) -> float:
        """The angle [rad] up to which the polynomial increases, at most 180°."""
        odd = np.zeros(9)
        odd[::2] = [1.0, *(c * n for c, n in zip(self.coefficients, (3, 5, 7, 9), strict=True))]
        roots = np.polynomial.Polynomial(odd).trim().roots()
        real = roots[np.abs(roots.imag) < 1e-9].real
        return float(min(real[real > 0], default=math.pi, key=float)) * (1 - 1e-9)

    def _bent(self, angle: Floats[*Axes]) -> Floats[*Axes]:
        s = angle * angle
        k1, k2, k3, k4 = self.coefficients
        return angle * (1 + s * (k1 + s * (k2 + s * (k3 + s * k4))))

    def _slope(self, angle: Floats[*Axes]) -> Floats[*Axes]:
        s = angle * angle
        k1, k2, k3, k4 = self.coefficients
        return 1 + s * (3 * k1 + s * (5 * k2 + s * (7 * k3 + s * 9 * k4)))


def pinhole_views(
    name: str, lens: SourceLens, region: tuple[float, float, float, float] | None = None
) -> tuple[Camera, ...]:
    """Return the pinholes of that name through which a lens's images are tracked, in its frame: one, or tiles from
    left to right and top to bottom where what they are to show is wider than 100°.

    Each view's pixels lie in the image, and are as dense in its middle as the image's.

    Parameters
    ----------
    region
        x, y, width, height [px] in the lens's image; None: all of it.

    Raises
    ------
    HandtrackError
        Where the lens shows nothing of the region.
    """
    x, y, width, height = region or (0, 0, *lens.size)
    middle = np.array([x + 0.5 * (width - 1), y + 0.5 * (height - 1)])
    ends = np.array(
        [[x, middle[1]], [x + width - 1, middle[1]], [middle[0], y], [middle[0], y + height - 1]]
    )
    axis = lens.rays(middle if region else lens.matrix[:2, 2])
    base = looking_along(axis, np.array([0.0, 1.0, 0.0]))
    sides = lens.rays(ends) @ base.T
    left, right = (math.atan2(ray[0], ray[2]) for ray in sides[:2])
    top, bottom = (math.atan2(ray[1], ray[2]) for ray in sides[2:])
    if not np.isfinite([left, right, top, bottom]).all():
        raise HandtrackError(
            f"the lens's polynomial shows no direction at the border of its image of {lens.size[0]} x {lens.size[1]}. Is its "
            "matrix of another image size?"
        )
    return tuple(
        _view(name, lens, base, columns, rows)
        for rows in _parts(top, bottom)
        for columns in _parts(left, right)
    )


def _parts(low: float, high: float) -> list[tuple[float, float, float]]:
    """Return for each view where it looks, and its ends from there [rad]."""
    count = max(math.ceil((high - low) / WIDEST_RAD - 1e-6), 1)
    ends = np.linspace(low, high, count + 1)
    angles = [0.0] if count == 1 else (0.5 * (ends[:-1] + ends[1:])).tolist()
    return [(at, ends[i] - at, ends[i + 1] - at) for i, at in enumerate(angles)]


def _view(
    name: str,
    lens: SourceLens,
    base: Floats,
    columns: tuple[float, float, float],
    rows: tuple[float, float, float],
) -> Camera:
    """Return the view of angles [rad] to the right and down in a turned lens's frame, made smaller until all of it is image."""
    yaw, pitch = columns[0], rows[0]
    turn = rotation_matrix(np.array([pitch, 0.0, 0.0])) @ rotation_matrix(
        np.array([0.0, -yaw, 0.0])
    )
    rotation = turn @ base
    step = 1e-4
    near = lens.project(
        np.array([[-step, 0, 1], [step, 0, 1], [0, -step, 1], [0, step, 1]]) @ rotation
    )
    focal = float(np.linalg.norm(near[1] - near[0]) + np.linalg.norm(near[3] - near[2])) / (
        4 * step
    )
    edges = np.tan([*columns[1:], *rows[1:]])
    along = np.linspace(0, 1, _ON_BORDER)
    limit = np.array(lens.size) - 0.5
    while True:
        w, h = edges[1] - edges[0], edges[3] - edges[2]
        if min(w, h) * focal < _LEAST_PX:
            raise HandtrackError("the lens's image has no part that a pinhole view could show.")
        across, down = edges[0] + w * along, edges[2] + h * along
        sides = [(edges[0], down), (edges[1], down), (across, edges[2]), (across, edges[3])]
        border = np.stack([np.stack([*np.broadcast_arrays(u, v, 1.0)], -1) for u, v in sides])
        pixels = lens.project(border @ rotation)
        outside = np.asarray(~((pixels >= -0.5) & (pixels < limit)).all(axis=-1))
        if not outside.any():
            break
        # a side moves in for what is outside along it; of the two that meet in a corner the one further out
        inner = np.asarray(outside[:, 1:-1].any(axis=1))
        far = np.abs(edges)
        for side, other in ((0, 2), (0, 3), (1, 2), (1, 3)):
            if outside[side, 0 if other == 2 else -1] and not (inner[side] or inner[other]):
                inner[side if far[side] >= far[other] else other] = True
        edges = np.where(inner, _SHRINK * edges, edges)
    size = (max(int(w * focal), 1), max(int(h * focal), 1))
    matrix = np.array([[focal, 0, -edges[0] * focal], [0, focal, -edges[2] * focal], [0, 0, 1.0]])
    return Camera(name, size, matrix, np.zeros(5), rotation, np.zeros(3))
