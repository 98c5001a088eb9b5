"""How poses follow one another in a whole recording: a velocity that persists for a while, and is pushed."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property

import numpy as np

from handtrack.arrays import D3, F, Floats, K, L, M, N, P, array_dataclass
from handtrack.geometry.rotation import left_jacobian
from handtrack.model.pose_changes import ANGLES, TURN, changes
from handtrack.tracking.frame.settings import PriorSettings
from handtrack.tracking.frame.terms.priors import motion_sigma

_USUAL_FRAMES = 0.01
"""frames for which the usual process noise counts beside what was seen: it keeps what never moves from being known to"""
_LASTS_S = 0.2
"""[s] after which e⁻¹ of a velocity is left: a movement of half a second, as reaching and grasping take, begins and ends in twice
that. It isn't estimated: beside the process noise, of hidden joints' angles neither can be told from the other"""
_AT_ONCE = 256
"""frames whose parts of the system are made at once: those of all would be twice as large as the system"""
_PAIRS = ((0, 0, 2), (0, 1, 1), (0, 2, 0), (1, 0, 2), (1, 1, 1), (2, 0, 2))
"""of x₋, x, x₊ each with itself, x with x₋, x₊ with x, x₊ with x₋: how many frames after the column the row is, from which frame on, and
how many frames before the end"""


@array_dataclass
class Motion:
    """x₊ − x = kept · (x − x₋) + N(0, process noise), of solver parameters a frame: an Ornstein–Uhlenbeck velocity.

    Where nothing is seen the hand goes on, and comes to rest; what it may do meanwhile is bounded and known. Joints are
    pushed together: fingers that close as one where they are seen do so where one of them is hidden. A first velocity is as
    large as velocities are that last, of variance process noise / (1 − kept²).
    """

    kept: float
    """share of the velocity that is left a frame later, 0 … 1"""
    process_noise: Floats[P, P]
    """[m², rad²] covariance; place and turn go on their own"""

    @classmethod
    def usual(cls, prior: PriorSettings, size: int, seconds: float) -> Motion:
        """Return what is assumed before anything is known of a recording: what `prior` says of the next frame, so many seconds
        later.
        """
        return cls(float(np.exp(-seconds / _LASTS_S)), np.diag(motion_sigma(prior, size) ** 2))

    def cost(self, poses: Floats[F, P]) -> float:
        """Return ½ Σ rᵀ r of all accelerations and of the first velocity, in standard deviations."""
        steps = changes(poses)
        pushed = steps[1:] - self.kept * steps[:-1]
        first = steps[:1] * np.sqrt(1.0 - self.kept**2)
        return 0.5 * sum(float(((part @ self._known) * part).sum()) for part in (first, pushed))

    def add_to(
        self, blocks: Floats[F, L, P, P], gradient: Floats[F, P], poses: Floats[F, P]
    ) -> None:
        """Add the Gauss-Newton system, by changes of the poses (`moved`), in place. blocks: of a banded matrix."""
        steps, kept = changes(poses), self.kept
        if not len(steps):
            return
        slow = np.sqrt(1.0 - kept**2)
        both = [slow * move for move in _by_ends(steps[:1])]
        self._add(blocks, gradient, slow * steps[:1], both)
        for at in range(0, len(steps) - 1, _AT_ONCE):
            own = steps[at : at + _AT_ONCE + 1]
            behind, ahead = _by_ends(own)
            self._add(
                blocks[at:],
                gradient[at:],
                own[1:] - kept * own[:-1],
                [-kept * behind[:-1], behind[1:] - kept * ahead[:-1], ahead[1:]],
            )

    def estimated(
        self,
        poses: Floats[F, P],
        inverse: Iterable[tuple[int, Floats[N, L, P, P]]],
        usual: Motion,
    ) -> Motion:
        """Return the motion that makes the poses most probable, as far as they are known: one step
        of EM.

        Parameters
        ----------
        inverse
            The poses' covariance as `Bordered.inverse_parts` gives it; none where they are
            known.
        usual
            What counts as some frames more.
        """
        if len(poses) < 3:
            return self
        steps, size = changes(poses), poses.shape[1]
        # sums over frames of covariances between x₋, x, x₊; [k] of `inverse` is the later with the earlier frame
        sums = np.zeros((len(_PAIRS), size, size))
        for at, blocks in inverse:
            for total, (k, first, last) in zip(sums, _PAIRS, strict=True):
                total += blocks[max(first - at, 0) : max(len(poses) - last - at, 0), k].sum(axis=0)
        earlier, middle, later, first, second, two = sums
        before = steps[:-1].T @ steps[:-1] + middle + earlier - first - first.T
        after = steps[1:].T @ steps[1:] + later + middle - second - second.T
        both = steps[1:].T @ steps[:-1] + second - two - middle + first
        kept = self.kept
        pushed = after - kept * (both + both.T) + kept**2 * before
        pushed = 0.5 * (pushed + pushed.T)
        count = len(steps) - 1
        together = np.eye(size)
        together[ANGLES, ANGLES] = count / (count + size)
        np.fill_diagonal(together, 1.0)
        pushed = (pushed + _USUAL_FRAMES * usual.process_noise) / (count + _USUAL_FRAMES)
        return Motion(kept, pushed * together)

    @cached_property
    def _known(self) -> Floats[P, P]:
        return np.linalg.inv(self.process_noise)

    def _add(
        self,
        blocks: Floats[F, L, P, P],
        gradient: Floats[F, P],
        residual: Floats[M, P],
        moves: list[Floats[M, P, P]],
    ) -> None:
        """Add residuals, the m-th of frames m and those after it. moves: by what it changes with each of these."""
        count = len(residual)
        pull = residual @ self._known
        for a, by_a in enumerate(moves):
            gradient[a : a + count] += np.einsum("mqp,mq->mp", by_a, pull)
            known = np.swapaxes(by_a, 1, 2) @ self._known
            for b, by_b in enumerate(moves[: a + 1]):
                blocks[b : b + count, a - b] += known @ by_b


def _by_ends(steps: Floats[M, P]) -> tuple[Floats[M, P, P], Floats[M, P, P]]:
    """Return how steps change with the pose where each begins, and with that where it ends."""
    size, turn = steps.shape[1], steps[:, TURN]
    behind = _moves(size, -1.0, -np.linalg.inv(left_jacobian(-turn)))
    return behind, _moves(size, 1.0, np.linalg.inv(left_jacobian(turn)))


def _moves(size: int, own: float, turn: Floats[M, D3, D3]) -> Floats[M, K, P]:
    """Return matrices (M, P, P) that are diagonal but for the root's turn."""
    found = np.tile(own * np.eye(size), (len(turn), 1, 1))
    found[:, TURN, TURN] = turn
    return found
