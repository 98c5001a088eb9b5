"""What all frames of a recording share: cameras that are off, and the person."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from handtrack.arrays import Floats, K
from handtrack.terms.bone_system import JointSystem
from handtrack.tracking.size.cameras import CameraChanges
from handtrack.tracking.size.person import PersonChange


@dataclass(frozen=True, eq=False)
class Shared:
    """Unknowns beside the poses: K numbers, those of the cameras first."""

    cameras: CameraChanges
    person: PersonChange

    @property
    def count(self) -> int:
        """How many numbers there are."""
        return self.cameras.count + self.person.count

    def stepped(self, step: Floats[K]) -> Shared:
        """Return them after a step of all numbers."""
        cameras, person = np.split(step, [self.cameras.count])
        return Shared(self.cameras.stepped(cameras), self.person.stepped(person))

    def through(self, cameras: CameraChanges) -> Shared:
        """Return the same person through other cameras."""
        return replace(self, cameras=cameras)

    def known(self, weight: Floats[K]) -> JointSystem:
        """Return what is known of them beforehand, weighing so many times; one weight for all of the cameras, one for the person."""
        split = self.cameras.count
        cameras, person = self.cameras.prior(), self.person.prior()
        by_camera, by_person = (
            weight[0] if split else 0.0,
            weight[-1] if len(weight) > split else 0.0,
        )
        hessian = np.zeros((self.count, self.count))
        hessian[:split, :split] = by_camera * cameras.hessian
        hessian[split:, split:] = by_person * person.hessian
        return JointSystem(
            by_camera * cameras.cost + by_person * person.cost,
            np.concatenate([by_camera * cameras.gradient, by_person * person.gradient]),
            hessian,
        )

    def alike(self, frames: float, posture: float) -> Floats[K]:
        """Return of how many frames all together tell as much as one of each number: of cameras of all `frames`, of the person of
        those with one posture.
        """
        return np.repeat([frames, posture], [self.cameras.count, self.person.count]).astype(float)
