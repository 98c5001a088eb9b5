"""Where a hypothesis is and how it moves, with the uncertainty of both: a Kalman filter's state, in solver parameters."""

from __future__ import annotations

import numpy as np

from handtrack.arrays import P2, Floats, Ints, K, P, array_dataclass
from handtrack.geometry.rotation import left_jacobian, wrapped

_SPEED_RAD, _SPEED_M = np.deg2rad(10.0), 0.03
"""a frame; how fast what has just been found may move: an arm's swing takes about half a second"""


@array_dataclass
class MotionBelief:
    """A normal distribution of place and velocity."""

    mean: Floats[P]
    """solver parameters, the first three in metres, the next three the root's rotation vector"""
    velocity: Floats[P]
    """a frame"""
    covariance: Floats[P2, P2]
    """of place, then velocity"""

    @property
    def place_covariance(self) -> Floats[P, P]:
        """Return the covariance of the place alone."""
        count = len(self.mean)
        return self.covariance[:count, :count]

    @classmethod
    def at_rest(cls, mean: Floats[P], covariance: Floats[P, P], speed: Floats[P]) -> MotionBelief:
        """Return the belief of a first frame: place as found, velocity around 0 by speed, a standard deviation."""
        count = len(mean)
        whole = np.zeros((2 * count, 2 * count))
        whole[:count, :count] = covariance
        whole[count:, count:] = np.diag(speed**2)
        return cls(mean, np.zeros(count), whole)

    def ahead(self, push: Floats[P], frames: int, moving: bool = True) -> MotionBelief:
        """Return the belief some frames later; each frame an unknown acceleration pushes, a
        standard deviation.

        Parameters
        ----------
        moving
            Whether motion goes on; otherwise places alone drift by `push`.
        """
        count = len(self.mean)
        mean, covariance = self.mean, self.covariance
        velocity = self.velocity if moving else np.zeros(count)
        step = np.eye(2 * count) + np.eye(2 * count, k=count) * moving
        share = [[0.25, 0.5], [0.5, 1.0]] if moving else [[1.0, 0.0], [0.0, 0.0]]
        noise = np.kron(share, np.diag(push**2))
        for _ in range(frames):
            mean = mean + velocity
            covariance = step @ covariance @ step.T + noise
        return MotionBelief(mean, velocity, 0.5 * (covariance + covariance.T))

    def updated(self, mean: Floats[P], covariance: Floats[P, P]) -> MotionBelief:
        """Return the belief once the place is known to be mean with covariance, this belief included."""
        count = len(self.mean)
        across, moving = self.covariance[count:, :count], self.covariance[count:, count:]
        gain = np.linalg.solve(self.place_covariance, across.T).T
        whole = np.empty_like(self.covariance)
        whole[:count, :count] = covariance
        whole[count:, :count] = gain @ covariance
        whole[:count, count:] = whole[count:, :count].T
        whole[count:, count:] = moving - gain @ (self.place_covariance - covariance) @ gain.T
        velocity = self.velocity + gain @ (mean - self.mean)
        return MotionBelief(mean, velocity, 0.5 * (whole + whole.T))

    def with_wrapped_turn(self) -> MotionBelief:
        """Return the same belief with a root's turn of at most half a turn: who spins would reach 2π, where it is singular."""
        mean, turn = self.mean.copy(), self.mean[3:6]
        if float(np.linalg.norm(turn)) <= np.pi:
            return self
        mean[3:6] = wrapped(turn)
        count = len(mean)
        change = np.eye(count)  # d new by d old
        change[3:6, 3:6] = np.linalg.solve(left_jacobian(mean[3:6]), left_jacobian(turn))
        both = np.zeros_like(self.covariance)
        both[:count, :count] = both[count:, count:] = change
        return MotionBelief(mean, change @ self.velocity, both @ self.covariance @ both.T)

    def released(self, columns: Ints[K], spread: Floats[P], speed: Floats[P]) -> MotionBelief:
        """Return the belief in which some parameters may be anywhere: spread and speed, standard deviations."""
        count = len(self.mean)
        both = np.concatenate([columns, columns + count])
        whole = self.covariance.copy()
        whole[both, :] = 0.0
        whole[:, both] = 0.0
        whole[columns, columns] = spread[columns] ** 2
        whole[columns + count, columns + count] = speed[columns] ** 2
        velocity = self.velocity.copy()
        velocity[columns] = 0.0
        return MotionBelief(self.mean, velocity, whole)


def unknown_speed(size: int) -> Floats[P]:
    """Return (P,) how fast parameters of which only the place is known may change in a frame, a standard deviation [m, rad]."""
    speed = np.full(size, _SPEED_RAD)
    speed[:3] = _SPEED_M
    return speed
