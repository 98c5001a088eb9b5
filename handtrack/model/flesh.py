"""Ellipsoids: the flesh on bones, and where a pose puts them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from handtrack.arrays import D3, Array, E, Floats, Ints
from handtrack.model.kinematics import BonePoses


@dataclass(frozen=True)
class PosedEllipsoids:
    """Ellipsoids in the world."""

    bone: Ints[E]
    """the bone each one sits on."""
    centre: Floats[E, D3]
    """world [m]."""
    rotation: Floats[E, D3, D3]
    """ellipsoid axes → world."""
    radii: Floats[E, D3]
    """semi-axes [m]."""


class EllipsoidArrays(NamedTuple):
    """Ellipsoids in bone frames, as compiled sums take them; see `Ellipsoids`."""

    bone: Ints[E]
    centre: Floats[E, D3]
    rotation: Floats[E, D3, D3]
    radii: Floats[E, D3]


@dataclass(frozen=True)
class Ellipsoids:
    """Ellipsoids fixed to bones, in bone frames (2007 paper, section 3.3)."""

    name: tuple[str, ...]
    bone: Ints[E]
    """the bone each one sits on."""
    centre: Floats[E, D3]
    """in the bone's frame, origin at its proximal end [m]."""
    rotation: Floats[E, D3, D3]
    """ellipsoid axes → bone frame."""
    radii: Floats[E, D3]
    """semi-axes [m]."""

    def __len__(self) -> int:
        return len(self.bone)

    @cached_property
    def arrays(self) -> EllipsoidArrays:
        """The same for compiled sums."""
        return EllipsoidArrays(
            np.ascontiguousarray(self.bone, np.int64),
            *(np.ascontiguousarray(a, float) for a in (self.centre, self.rotation, self.radii)),
        )

    def posed(self, bones: BonePoses) -> PosedEllipsoids:
        """Return the ellipsoids where the bones have carried them."""
        flesh, carried = self.rescaled(bones), bones.rotation[self.bone]
        centre = bones.position[self.bone] + np.einsum("eij,ej->ei", carried, flesh.centre)
        return PosedEllipsoids(self.bone, centre, carried @ self.rotation, flesh.radii)

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
        return replace(self, radii=np.maximum(self.radii + by_m, 0.5 * self.radii))

    def subset(self, keep: Array[E]) -> Ellipsoids:
        """Return only the ellipsoids for which `keep` is True."""
        kept = np.flatnonzero(keep)
        names = tuple(self.name[i] for i in kept)
        return Ellipsoids(
            names, self.bone[kept], self.centre[kept], self.rotation[kept], self.radii[kept]
        )
