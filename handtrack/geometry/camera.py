"""Pinhole cameras with OpenCV's lens distortion, and a rig of them.

Camera frame: x right, y down, z forward; `p_camera = R p_world + t`; integer pixel coordinates at
pixel centres.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from handtrack.arrays import D2, D3, D4, Array, Axes, Floats, K, array_dataclass
from handtrack.errors import HandtrackError, index_of
from handtrack.geometry.lens import COEFFICIENT_COUNTS, distort, undistort
from handtrack.geometry.rotation import rotation_matrix

_LEAST_DEPTH_M = 0.05
_MOST_TANGENTIAL = 0.1  # a lens that is not centred on its sensor has 0.001 to 0.01; a fisheye's k3 and k4 stand in this place
_LONGEST_FOCAL_PX = 1e6  # a lens of 1 m over pixels of 1 µm


@array_dataclass
class Camera:
    """One calibrated camera. Compared by identity, so it can be the key of a cache.

    Raises HandtrackError for a matrix with skew, a rotation that is none, numbers that are not
    finite.
    """

    name: str
    size: tuple[int, int]
    """width, height [px]."""
    matrix: Floats[D3, D3]
    """In pixels: [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]."""
    distortions: Floats[K]
    """(4, 5, 8, 12 or 14,) in OpenCV's order: k1 k2 p1 p2 k3 ..."""
    rotation: Floats[D3, D3]
    """R_camera_world."""
    translation: Floats[D3]
    """[m], the world's origin in the camera frame."""

    def __post_init__(self) -> None:
        for name in ("matrix", "distortions", "rotation", "translation"):
            array = np.array(getattr(self, name), dtype=float)
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        object.__setattr__(self, "size", (int(self.size[0]), int(self.size[1])))
        _check(self)

    @classmethod
    def from_opencv(
        cls,
        matrix: Array[*Axes],
        distortions: Array[*Axes] | None = None,
        rotation: Array[*Axes] | None = None,
        translation: Array[*Axes] | None = None,
        *,
        name: str,
        size: tuple[int, int],
        unit_m: float = 1.0,
    ) -> Camera:
        """Return the camera of OpenCV's numbers, of any of its shapes: `calibrateCamera`'s matrix
        and coefficients, and rvec or R, and tvec, of `solvePnP` or `stereoCalibrate` (world →
        camera).

        Left out: no distortion, the world is the camera's.

        Parameters
        ----------
        size
            Width, height [px].
        unit_m
            Metres in one unit of the translation, such as 0.001 where the board was in mm.

        Raises
        ------
        HandtrackError
        """
        turn: Any = np.eye(3) if rotation is None else np.asarray(rotation, float)
        turn = rotation_matrix(turn.ravel()) if turn.size == 3 else turn
        flat: Any = np.zeros(5) if distortions is None else np.asarray(distortions, float).ravel()
        shift: Any = np.zeros(3) if translation is None else np.asarray(translation, float).ravel()
        return cls(name, size, np.array(matrix, float), flat, turn, unit_m * shift)

    @cached_property
    def centre(self) -> Floats[D3]:
        """The camera's position, world [m]."""
        return -self.rotation.T @ self.translation

    @cached_property
    def projection(self) -> Floats[D3, D4]:
        """K [R|t], without distortion: homogeneous world [m] → homogeneous pixels."""
        return self.matrix @ np.column_stack([self.rotation, self.translation])

    @cached_property
    def is_distorted(self) -> bool:
        """Whether any distortion coefficient differs from zero."""
        return bool(np.any(self.distortions))

    def to_camera(self, points: Floats[*Axes, D3]) -> Floats[*Axes, D3]:
        """Return world points [m] in the camera frame [m]."""
        return np.asarray(points, dtype=float) @ self.rotation.T + self.translation

    @property
    def focal_px(self) -> float:
        """The focal length [px], the mean of both directions."""
        return 0.5 * float(self.matrix[0, 0] + self.matrix[1, 1])

    def pixels_per_m(self, depth: Floats[*Axes] | float) -> Floats[*Axes]:
        """Return how many pixels a metre is at depths [m] of any shape; what is nearer than 5 cm, or behind, counts as 5 cm."""
        return self.focal_px / np.maximum(np.asarray(depth, float), _LEAST_DEPTH_M)

    def pixels_per_m_at(self, points: Floats[*Axes, D3]) -> Floats[*Axes]:
        """Return the same at world points [m]."""
        return self.pixels_per_m(self.to_camera(points)[..., 2])

    def project(self, points_world: Floats[*Axes, D3]) -> Floats[*Axes, D2]:
        """Return the pixels of world points [m], with distortion.

        NaN behind the camera, and beyond the field in which the lens's polynomial is valid.
        """
        points = self.to_camera(points_world)
        depth = points[..., 2:]
        in_front = depth > 0
        directions = points[..., :2] / np.where(in_front, depth, 1.0)
        directions = np.where(in_front, directions, np.nan)
        return self._pixels(distort(directions, self.distortions))

    def shows(self, points_world: Floats[*Axes, D3]) -> Array[*Axes]:
        """Return which world points [m] lie within the image; what hides them does not matter."""
        pixels = self.project(points_world)
        # NaN is in no image
        inside = (pixels >= -0.5) & (pixels <= np.array(self.size) - 0.5)
        return np.asarray(inside.all(axis=-1))

    def without_distortion(self) -> Camera:
        """Return the camera with the same matrix, pose and size, and no distortion."""
        return replace(self, distortions=np.zeros(5))

    def scaled(self, size: tuple[int, int]) -> Camera:
        """Return the camera of the same images, scaled to width, height [px]: a pixel's place x, with its centre at whole
        numbers, becomes s (x + ½) − ½.
        """
        across, down = (new / old for new, old in zip(size, self.size, strict=True))
        matrix = np.diag([across, down, 1.0]) @ self.matrix
        matrix[:2, 2] += 0.5 * np.array([across, down]) - 0.5
        return replace(self, size=size, matrix=matrix)

    def undistort_points(self, pixels: Floats[*Axes, D2]) -> Floats[*Axes, D2]:
        """Return pixels of the undistorted camera; NaN where the lens cannot have put them."""
        return self._pixels(undistort(self._directions(pixels), self.distortions))

    def distort_points(self, pixels: Floats[*Axes, D2]) -> Floats[*Axes, D2]:
        """Return where pixels of the undistorted camera lie in the real image; NaN beyond
        the lens's field."""
        return self._pixels(distort(self._directions(pixels), self.distortions))

    def project_jacobian(self, points_world: Floats[*Axes, D3]) -> Floats[*Axes, D2, D3]:
        """Return d pixel / d point [px/m] of the undistorted pinhole at world points [m]."""
        x, y, z = np.moveaxis(self.to_camera(points_world), -1, 0)
        zero, one = np.zeros_like(x), np.ones_like(x)
        across = np.stack(
            [np.stack([one, zero, -x / z], -1), np.stack([zero, one, -y / z], -1)], -2
        )
        focal = np.diag(self.matrix)[:2, None]
        return focal * across / z[..., None, None] @ self.rotation

    def rays(self, pixels: Floats[*Axes, D2]) -> Floats[*Axes, D3]:
        """Return unit directions, world, of viewing rays through pixels of the real image."""
        flat = undistort(self._directions(pixels), self.distortions)
        directions = np.concatenate([flat, np.ones_like(flat[..., :1])], axis=-1)
        directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
        return directions @ self.rotation

    def _directions(self, pixels: Floats) -> Floats:
        return (np.asarray(pixels, dtype=float) - self.matrix[:2, 2]) / np.diag(self.matrix)[:2]

    def _pixels(self, directions: Floats) -> Floats:
        return directions * np.diag(self.matrix)[:2] + self.matrix[:2, 2]


def camera_matrix(fx: float, fy: float, cx: float, cy: float) -> Floats[D3, D3]:
    """Return [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] [px]."""
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def scaled_by(size: tuple[int, int], found: tuple[int, int]) -> float | None:
    """Return the one factor by which images of a size (width, height) may have been scaled to another, to a pixel of
    rounding; None where there is none.
    """
    factors = found[0] / size[0], found[1] / size[1]
    if 1.0 in factors:  # cut off, or padded, on one side
        return None
    fits = any(abs(s * size[i] - found[i]) <= 1.0 for i, s in ((1, factors[0]), (0, factors[1])))
    return 0.5 * sum(factors) if fits else None


@array_dataclass
class CameraRig:
    """Cameras of one calibration, with names that differ."""

    cameras: tuple[Camera, ...]

    def __post_init__(self) -> None:
        for name, count in Counter(self.names).items():
            if count > 1:
                raise HandtrackError(
                    f"the name '{name}' is given to two cameras; each needs its own."
                )

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(camera.name for camera in self.cameras)

    def __getitem__(self, name: str) -> Camera:
        return self.cameras[index_of("camera", name, self.names)]

    def __contains__(self, name: object) -> bool:
        return name in self.names

    def __iter__(self) -> Iterator[Camera]:
        return iter(self.cameras)

    def __len__(self) -> int:
        return len(self.cameras)


def _check(camera: Camera) -> None:
    who = f"camera '{camera.name}'"
    shapes = {"matrix": (3, 3), "rotation": (3, 3), "translation": (3,)}
    for name, shape in shapes.items():
        if getattr(camera, name).shape != shape:
            found = getattr(camera, name).shape
            raise HandtrackError(f"{who}: {name} has the shape {found}, expected {shape}.")
    if camera.distortions.shape not in [(n,) for n in COEFFICIENT_COUNTS]:
        raise HandtrackError(
            f"{who}: {camera.distortions.size} distortion coefficients; OpenCV's model has 4, 5, "
            "8, 12 or 14 (k1 k2 p1 p2 k3 ...). Fill up with zeros."
        )
    for name in (*shapes, "distortions"):
        if not np.isfinite(getattr(camera, name)).all():
            raise HandtrackError(
                f"{who}: {name} has values that are not finite numbers. Calibrate again."
            )
    tangential = camera.distortions[2:4]
    if np.abs(tangential).max() > _MOST_TANGENTIAL:
        raise HandtrackError(
            f"{who}: tangential distortion p1 = {tangential[0]:.4g}, p2 = {tangential[1]:.4g}; expected at most "
            f"{_MOST_TANGENTIAL:g}. Is it a fisheye's (k1 k2 k3 k4)? `handtrack new --lens fisheye` takes those. "
            "Or are coefficients in another order than k1 k2 p1 p2 k3?"
        )
    if min(camera.size) < 1:
        raise HandtrackError(f"{who}: size {camera.size}; expected width and height in pixels.")
    _check_matrix(camera.matrix, who)
    _check_rotation(camera.rotation, who)


def _check_matrix(matrix: Floats, who: str) -> None:
    if abs(matrix[0, 1]) > 1e-9 * abs(matrix[0, 0]):
        raise HandtrackError(
            f"{who}: the matrix has a skew of {matrix[0, 1]:g}; expected 0. OpenCV would ignore "
            "it silently, so it is refused: calibrate without skew."
        )
    if matrix[0, 0] <= 0 or matrix[1, 1] <= 0:
        raise HandtrackError(
            f"{who}: focal lengths {matrix[0, 0]:g}, {matrix[1, 1]:g}; expected positive pixels. "
            "The matrix is singular or mirrored."
        )
    if max(matrix[0, 0], matrix[1, 1]) > _LONGEST_FOCAL_PX:
        raise HandtrackError(
            f"{who}: focal lengths {matrix[0, 0]:g}, {matrix[1, 1]:g} pixels; expected at most {_LONGEST_FOCAL_PX:g}. Is the "
            "matrix in another unit?"
        )
    if not np.allclose(matrix[[1, 2, 2, 2], [0, 0, 1, 2]], [0, 0, 0, 1], rtol=0, atol=1e-12):
        raise HandtrackError(
            f"{who}: the matrix must read [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]; found "
            f"{matrix.tolist()}. Is it transposed? Then the rotation probably is as well (JARVIS, DANNCE, old MATLAB)."
        )


def _check_rotation(rotation: Floats, who: str) -> None:
    determinant = float(np.linalg.det(rotation))
    off = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
    if off < 1e-6 and determinant < 0:
        raise HandtrackError(
            f"{who}: the rotation is mirrored (determinant {determinant:.3g}, expected 1). One "
            "axis has the wrong sign, or two are exchanged."
        )
    if off >= 1e-6:
        raise HandtrackError(
            f"{who}: the rotation matrix is no rotation: R Rᵀ differs from the identity by "
            f"{off:.2g} (determinant {determinant:.3g}). It may be singular or scaled; expected "
            "orthonormal rows."
        )
