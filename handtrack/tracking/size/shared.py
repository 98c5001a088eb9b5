"""What all frames of a recording share: cameras that are off, and the person."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from handtrack.arrays import Array, Floats, K, array_dataclass
from handtrack.terms.bone_system import JointSystem
from handtrack.tracking.size.cameras import CALIBRATION, NUMBERS, TIME, CameraChanges
from handtrack.tracking.size.person import PersonChange


@array_dataclass
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

    def stopped(self, gradient: Floats[K]) -> Array[K]:
        """Return which of them lie at a limit that they would leave."""
        split = self.cameras.count
        return np.r_[np.zeros(split, bool), self.person.stopped(gradient[split:])]

    def through(self, cameras: CameraChanges) -> Shared:
        """Return the same person through other cameras."""
        return replace(self, cameras=cameras)

    def known(self, weight: Floats[K]) -> JointSystem:
        """Return what is known of them beforehand, weighing so many times; see `alike`."""
        split, by_camera = self.cameras.count, np.ones(NUMBERS)
        if split:
            by_camera[self.cameras.free] = weight[: int(self.cameras.free.sum())]
        cameras, person = self.cameras.prior(by_camera), self.person.prior()
        by_person = weight[-1] if len(weight) > split else 0.0
        hessian = np.zeros((self.count, self.count))
        hessian[:split, :split] = cameras.hessian
        hessian[split:, split:] = by_person * person.hessian
        return JointSystem(
            cameras.cost + by_person * person.cost,
            np.concatenate([cameras.gradient, by_person * person.gradient]),
            hessian,
        )

    def alike(self, frames: float, posture: float) -> Floats[K]:
        """Return of how many frames all together tell as much as one of each number: of where cameras are of all `frames`, of the
        person and of masks those with one posture. Of when a camera saw each frame tells anew: what flesh is off by, times a
        velocity, sums to its share of the way, and a hand that goes there and back takes it back.
        """
        once = np.where(TIME, 1.0, np.where(CALIBRATION, frames, posture))[self.cameras.free]
        return np.r_[
            np.tile(once, len(self.cameras.cameras)), np.full(self.person.count, posture)
        ].astype(float)
