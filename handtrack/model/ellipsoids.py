"""Ellipsoids: the flesh on bones, where a pose puts them, and how a camera sees them."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np

from handtrack.arrays import D2, D3, Array, E, Floats, H, Ints, J, W, array_dataclass, contiguous
from handtrack.geometry.camera import Camera
from handtrack.geometry.quadric import dual_conic, ellipse, is_ellipse, shape_matrix
from handtrack.model.kinematics import BonePoses


@array_dataclass
class Ellipsoids:
    """Ellipsoids fixed to bones, in bone frames (2007 paper, section 3.3); or posed, in the world."""

    bone: Ints[E]
    """the bone each one sits on."""
    centre: Floats[E, D3]
    """in the bone's frame, origin at its proximal end, or world [m]."""
    rotation: Floats[E, D3, D3]
    """ellipsoid axes → bone frame, or world."""
    radii: Floats[E, D3]
    """semi-axes [m]."""

    def __len__(self) -> int:
        return len(self.bone)

    @cached_property
    def arrays(self) -> tuple[Ints[E], Floats[E, D3], Floats[E, D3, D3], Floats[E, D3]]:
        """The same for compiled sums."""
        centre, rotation, radii = contiguous(self.centre, self.rotation, self.radii)
        return np.ascontiguousarray(self.bone, np.int64), centre, rotation, radii

    def posed(self, bones: BonePoses) -> Ellipsoids:
        """Return the ellipsoids where the bones have carried them."""
        turned, radii = bones.rotation[self.bone] @ self.rotation, self.rescaled(bones).radii
        return Ellipsoids(self.bone, self.centres(bones), turned, radii)

    def centres(self, bones: BonePoses) -> Floats[E, D3]:
        """Return where the bones have carried the centres, world [m]."""
        local = bones.rescaled_surface(self.bone, self.centre)
        turned = np.einsum("eij,ej->ei", bones.rotation[self.bone], local)
        return bones.position[self.bone] + turned

    def rescaled(self, bones: BonePoses) -> Ellipsoids:
        """Return the ellipsoids as large as the bones are."""
        if bones.scale_change is None:
            return self
        shift = 0.0 if bones.shift is None else bones.shift[self.bone]
        return self.scaled(bones.scale_change[self.bone], shift)

    def scaled(self, factors: Floats[E, D3], shift: Floats[E, D3] | float = 0.0) -> Ellipsoids:
        """Return the ellipsoids after scaling by factors along the axes of their bones, and a shift [m]."""
        if np.array_equal(self.rotation, np.broadcast_to(np.eye(3), self.rotation.shape)):
            rotation, radii = self.rotation, self.radii * factors
        else:  # the axes of the scaled ellipsoid: D = M Mᵀ, M = diag(factors) R diag(r)
            rotation, radii, _ = np.linalg.svd(
                factors[:, :, None] * self.rotation * self.radii[:, None, :]
            )
            rotation[np.linalg.det(rotation) < 0, :, 2] *= -1.0
        return replace(self, centre=self.centre * factors + shift, rotation=rotation, radii=radii)

    def thicker(self, by_m: float) -> Ellipsoids:
        """Return the ellipsoids with semi-axes longer by so much, or shorter, by half at most."""
        if by_m == 0.0:
            return self
        return replace(self, radii=np.maximum(self.radii + by_m, 0.5 * self.radii))

    def subset(self, keep: Array[E]) -> Ellipsoids:
        """Return only the ellipsoids for which `keep` is True."""
        kept = np.flatnonzero(keep)
        return Ellipsoids(self.bone[kept], self.centre[kept], self.rotation[kept], self.radii[kept])

    def skin_above(self, bone: Ints[J], points: Floats[J, D3]) -> Floats[J, D3]:
        """Return where the ways from points to the back of the hand (+z of their bones' frames) leave the ellipsoids of the same bones;
        a point that has none above it itself.
        """
        to_ball = np.swapaxes(self.rotation, 1, 2) / self.radii[:, :, None]
        begin = np.einsum("eij,kej->kei", to_ball, points[:, None] - self.centre)
        step = to_ball[:, :, 2]
        square, along = (step**2).sum(axis=1), (begin * step).sum(axis=2)
        root = along**2 - square * ((begin**2).sum(axis=2) - 1.0)
        met = (root >= 0) & (self.bone == bone[:, None])
        height = np.where(met, np.sqrt(np.maximum(root, 0.0)) - along, 0.0) / square
        return points + np.maximum(height.max(axis=1), 0.0)[:, None] * [0.0, 0.0, 1.0]

    def hide(self, points: Floats[J, D3], eye: Floats[D3], near_m: float) -> Array[J]:
        """Return which points posed ellipsoids hide from an eye; what lies that near before a point is its own."""
        to_ball = np.swapaxes(self.rotation, 1, 2) / self.radii[:, :, None]
        begin = np.einsum("eij,ej->ei", to_ball, eye - self.centre)
        ways = (points - eye) @ np.swapaxes(to_ball, 1, 2)
        along = np.einsum("ei,eji->ej", begin, ways)
        square = np.einsum("eji,eji->ej", ways, ways)
        last = 1.0 - near_m / np.linalg.norm(points - eye, axis=1)
        share = np.clip(-along / square, 0.0, last)
        off = (begin**2).sum(axis=1)[:, None] + share * (2.0 * along + share * square)
        return (off < 1.0).any(axis=0)


def field_image(
    camera: Camera,
    ellipsoids: Ellipsoids,
    levels: Floats[E, D2] | None = None,
    depth_scaled: bool = False,
) -> Floats[H, W]:
    """Return the lowest field, 0 where there is none; eqs. 18–19 of the 2007 paper, without
    distortion.

    Plain NumPy, pixel by pixel: independent of the terms' run sums.

    Parameters
    ----------
    levels
        t and s of each ellipsoid, for s (q − t) in place of q.
    depth_scaled
        The paper's scale [m⁻²].
    """
    width, height = camera.size
    image = np.zeros((height, width))
    shape = shape_matrix(ellipsoids.rotation, ellipsoids.radii)
    dual = dual_conic(camera.projection, ellipsoids.centre, shape)
    seen = is_ellipse(camera.projection, ellipsoids.centre, shape)
    centre, spread = ellipse(np.where(seen[:, None, None], dual, np.diag([-1.0, -1.0, 1.0])))
    seen &= (spread[:, 0, 0] > 0) & (spread[:, 1, 1] > 0)
    for e in np.flatnonzero(seen):
        outer, factor = (0.0, 1.0) if levels is None else levels[e]
        factor = -1.0 / dual[e, 2, 2] if depth_scaled else factor
        reach = np.sqrt((1 + outer) * np.diag(spread[e]))
        low = np.clip(np.ceil(centre[e] - reach), 0, camera.size).astype(int)
        high = np.clip(np.floor(centre[e] + reach) + 1, 0, camera.size).astype(int)
        determinant = np.linalg.det(spread[e])
        if (low >= high).any() or determinant <= 0:
            continue
        x = np.arange(low[0], high[0]) - centre[e, 0]
        y = (np.arange(low[1], high[1]) - centre[e, 1])[:, None]
        (s11, s12), (_, s22) = spread[e]
        value = (s22 * x * x - 2 * s12 * x * y + s11 * y * y) / determinant - 1 - outer
        part = image[low[1] : high[1], low[0] : high[0]]
        np.minimum(part, factor * value, out=part)
    return image


def model_mask(camera: Camera, ellipsoids: Ellipsoids) -> Array[H, W]:
    """Return True where the undistorted camera sees the model."""
    return field_image(camera, ellipsoids) < 0
