"""Modes of a recording: minima of frames besides the tracked poses, the paths through all of them, and how probable each is."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from handtrack.arrays import Array, F, Floats, Ints, K, L, P, array_dataclass, runs
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.pose_changes import change, changes, moved
from handtrack.parallel import in_parallel
from handtrack.terms.term import JointSystem
from handtrack.tracking.frame.confidence import assess, energy_ratio
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.descent import descend, stage_problem
from handtrack.tracking.frame.frame_terms import FrameTerms
from handtrack.tracking.frame.result import FrameResult, Status
from handtrack.tracking.frame.terms.priors import motion_prior
from handtrack.tracking.search.frame_solve import SUSPICIOUS_RATIO, finger_grid
from handtrack.tracking.search.global_search import flipped_fingers
from handtrack.tracking.size.motion import Motion
from handtrack.tracking.whole.likelihood import FrameLikelihood, RecordingLikelihood


@array_dataclass
class Minimum:
    """A pose in which a frame's cost is about lowest nearby."""

    pose: Floats[P]
    """solver parameters"""
    costs: Callable[[Floats[P]], JointSystem]
    """what the frame costs at a pose, to second order, by changes of the pose as `pose_changes.moved` makes them"""
    origin: str
    """how it was found"""

    @cached_property
    def system(self) -> JointSystem:
        """What the frame costs there; asked for only where a frame has other minima, or one beside it."""
        return self.costs(self.pose)


@array_dataclass
class Trellis:
    """Minima of frames that follow one another, at least one each, joined by what a frame may change.

    A minimum's mass is its Gaussian's, exp(−η cost) · √det C (Laplace), C = (ηH + S⁻¹)⁻¹: what the frame leaves open is known as
    well as the frames beside it say, within a frame's change S. Two that follow each other are joined by N(change; 0, S + C + C').
    """

    minima: Sequence[Sequence[Minimum]]
    change: Floats[P, P]
    """S [m², rad²]: covariance of what a pose changes from a frame to the next"""
    share: float
    """η: of what a frame says, how much the frames before did not say: flesh and masks that are wrong for one mode are so again"""

    @cached_property
    def best(self) -> Ints[F]:
        """Which minimum of each frame lies on the most probable path (Viterbi)."""
        (first, *masses), joins = self._weights
        least, back = -first, list[Ints[L]]()
        for mass, joined in zip(masses, joins, strict=True):
            costs = least[:, None] - joined
            back.append(costs.argmin(axis=0))
            least = costs.min(axis=0) - mass
        path = [int(least.argmin())]
        for before in reversed(back):
            path.append(int(before[path[-1]]))
        return np.array(path[::-1])

    def path(self, chosen: Ints[F]) -> Floats[F, P]:
        """Return the poses of one minimum each frame."""
        return np.array([row[k].pose for row, k in zip(self.minima, chosen.tolist(), strict=True)])

    @property
    def probabilities(self) -> list[Floats[K]]:
        """How probable each frame's minima are, by all frames: over all paths through them (forward–backward).

        How frames follow one another counts by η, too: what is wrong for one mode moves it alike in frame after frame.
        """
        (first, *masses), joins = self._weights
        joins = [self.share * joined for joined in joins]
        ahead: list[Floats[K]] = [first]
        behind: list[Floats[K]] = [np.zeros(len(self.minima[-1]))]
        for mass, joined in zip(masses, joins, strict=True):
            ahead.append(mass + _log_sum(ahead[-1][:, None] + joined, axis=0))
        for mass, joined in zip(reversed(masses), reversed(joins), strict=True):
            behind.append(_log_sum(joined + mass + behind[-1], axis=1))
        both = [a + b for a, b in zip(ahead, reversed(behind), strict=True)]
        return [np.exp(row - _log_sum(row[:, None], axis=0)) for row in both]

    @cached_property
    def _weights(self) -> tuple[list[Floats[K]], list[Floats[K, L]]]:
        """Logarithms of each frame's masses, and of each frame's minima joined with each of the next's.

        What is the same of all paths is left out: the mass of a frame's only minimum, and the join of two such.
        """
        known = np.linalg.inv(self.change)
        masses: list[Floats[K]] = []
        joined: list[Floats[K, L]] = []
        before: Floats[K, P, P] | None = None
        for n, row in enumerate(self.minima):
            spread, mass = None, np.zeros(1)
            if any(len(beside) > 1 for beside in self.minima[max(n - 1, 0) : n + 2]):
                told = self.share * np.array([one.system.hessian for one in row])
                spread = np.linalg.inv(told + known)
                mass = -self.share * np.array([one.system.cost for one in row])
                mass += 0.5 * np.linalg.slogdet(spread)[1]
            if before is not None and spread is not None:
                joined.append(self._join(self.minima[n - 1], row, before, spread))
            elif n > 0:
                joined.append(np.zeros((1, 1)))
            masses.append(mass)
            before = spread
        return masses, joined

    def _join(
        self,
        here: Sequence[Minimum],
        there: Sequence[Minimum],
        spread: Floats[K, P, P],
        other: Floats[L, P, P],
    ) -> Floats[K, L]:
        pairs = np.array([[one.pose, two.pose] for one in here for two in there])
        # each pair's change is the one within it; those from pair to pair are left out
        steps = changes(pairs.reshape(-1, pairs.shape[2]))[::2]
        open_ = (self.change + spread[:, None] + other).reshape(len(steps), *self.change.shape)
        off = np.einsum("np,np->n", steps, np.linalg.solve(open_, steps[:, :, None])[:, :, 0])
        found = -0.5 * off - 0.5 * np.linalg.slogdet(open_)[1]
        return found.reshape(len(here), len(there))


def _log_sum(values: Floats[K, L], axis: int) -> Floats[K]:
    most = values.max(axis=axis, keepdims=True)
    return np.log(np.exp(values - most).sum(axis=axis)) + most.squeeze(axis)


APART_M = 0.01
"""[m] by which some joint of two minima differs at least: the breadth of half a finger"""
_SURPRISING = 2.0
"""usual changes of a frame from which two frames don't go together"""
_MET = 2
"""frames in a row after which a path that leads to known minima is taken for theirs"""
_FAR = 50
"""frames that a path is carried on at most"""
_TRIED = 4
"""places of fingers that are tried in a frame"""
_ROUNDS = 3
"""times at most that frames are bridged which jump on the best path, since each may open another"""
_LEAST_CHANGE = 0.1
"""of the usual: what hardly moved may still begin to"""
_HOPELESS = 5.0
"""[log-likelihood] a path that fits worse by more, all its frames together, isn't carried on: its share would be 0.007, and an alternative
is kept from 0.03"""


@dataclass(eq=False)
class ModeSearch:
    """Minima as they are gathered."""

    likelihood: RecordingLikelihood
    tracked: Sequence[FrameResult]
    minima: list[list[Minimum]] = field(init=False, default_factory=list)

    @property
    def control(self) -> Control:
        return self.likelihood.recording.control

    @cached_property
    def poses(self) -> Floats[F, P]:
        """Solver parameters: as tracked, bridged where the hand was lost."""
        return np.array([self.likelihood.around[result.frame] for result in self.tracked])

    @cached_property
    def motion(self) -> Motion:
        prior, seconds = self.likelihood.settings.prior, self.likelihood.seconds
        return Motion.usual(prior, self.poses.shape[1], seconds)

    @cached_property
    def _usual(self) -> Floats[P]:
        """What a pose usually changes from a frame to the next [m, rad]."""
        return np.sqrt(np.diag(self.motion.process_noise))

    @property
    def share(self) -> float:
        """Of what a frame says, how much counts (`Trellis.share`): all frames that show one pose as one, or as many as joints show."""
        return min(1.0 / (self.likelihood.repeated * self.likelihood.new), 1.0)

    def gathered(self) -> Trellis | None:
        """Return the trellis of tracked poses, of those that they lead to where frames don't go together or are in doubt,
        carried on from both sides, and of fingers tried elsewhere, each time that the pose is new; None when stopped.
        """
        for n, pose in enumerate(self.poses):
            if self.control.should_stop():
                return None
            known = self.tracked[n].status != Status.LOST
            first = self._minimum(n, pose, "tracked" if known else "bridged", plain=True)
            if self.tracked[n].poor_cloud:
                first = self._descended(n, pose, False, "depths believed") or first
            self.minima.append([first])
            for other in self.tracked[n].alternatives[1:]:
                params = self.likelihood.model.solver_params(other.parameters)
                self._add(n, self._minimum(n, params, other.origin))
        firm = np.array([result.status != Status.LOST for result in self.tracked])
        doubted = self._doubted()
        for n, apart in enumerate(self._apart(firm, doubted), 1):
            rays = [(n, -1), (n - 1, 1)] if apart else []
            self._carry(
                (at, way, self.minima[at][0].pose, self._speed(at, -way, firm))
                for at, way in rays
                if firm[at]
            )
        for n in _spread(firm, self.likelihood.repeated):
            self._try_fingers(n)
        usual = Trellis(self.minima, self.motion.process_noise, self.share)
        for _ in range(_ROUNDS):
            if not self._bridge(usual.path(self.with_observed_change(usual).best)):
                break
            usual = Trellis(self.minima, self.motion.process_noise, self.share)
        return None if self.control.should_stop() else usual

    def with_observed_change(self, usual: Trellis) -> Trellis:
        """Return the trellis where frames change as they do on the most probable path by what is usual."""
        return replace(usual, change=self._change(usual.path(usual.best)))

    def _change(self, poses: Floats[F, P]) -> Floats[P, P]:
        """Return what a frame changes on a path, a variance: nine in ten changes are within 1.645 standard deviations, the others
        may be mistakes; no more than is usual, since a path full of mistakes changes by anything.
        """
        found = np.percentile(np.abs(changes(poses)), 90, axis=0) / 1.645
        return np.diag(np.clip(found, _LEAST_CHANGE * self._usual, self._usual) ** 2)

    def _bridge(self, poses: Floats[F, P]) -> bool:
        """Add the middle between the neighbours of frames that don't go together with these on a path: where a frame tells
        little, no minimum of its own may be near. Return whether there is any.
        """
        added = False
        for n in np.flatnonzero(self._pushed(poses)).tolist():
            if self.minima[n][0].origin == "bridged":
                continue
            before, after = poses[n - 1], poses[n + 1]
            middle = self.likelihood.model.clipped(moved(before, 0.5 * change(before, after)))
            added |= self._add(n, self._minimum(n, middle, "between"))
        return added

    def _frame(self, n: int) -> FrameLikelihood:
        return self.likelihood.of(self.tracked[n].frame)

    def _minimum(self, n: int, pose: Floats[P], origin: str, plain: bool = False) -> Minimum:
        """Return a minimum of a frame; plain: seen as the frame is, where it was tracked."""

        def costs(there: Floats[P]) -> JointSystem:
            frame = self._frame(n)
            return frame.plain(there) if plain else frame.at(there)

        return Minimum(pose, costs, origin)

    def _doubted(self) -> Array[F]:
        """Return which frames don't fit, or fit worse than those around them."""
        found = []
        for n, result in enumerate(self.tracked):
            around = self.tracked[max(n - 15, 0) : n + 15]
            views = result.views or self._frame(n).terms.views
            ratio = energy_ratio(result.energy, views, around) if views else 1.0
            found.append(not result.fits or ratio > SUSPICIOUS_RATIO)
        return np.array(found)

    def _apart(self, firm: Array[F], doubted: Array[F]) -> Array[F]:
        """Return which frames (F − 1) don't go together with the next: pushed by more than is usual, or only one in doubt."""
        pushed = self._pushed(self.poses)
        apart = pushed[1:] | pushed[:-1] | (firm[1:] != firm[:-1])
        return apart | (doubted[1:] != doubted[:-1])

    def _pushed(self, poses: Floats[F, P]) -> Array[F]:
        """Return which frames change their neighbours' motion by more than is usual."""
        pushed = np.zeros(len(poses), bool)
        surprise = np.abs(np.diff(changes(poses), axis=0)) / self._usual
        pushed[1:-1] = (surprise > _SURPRISING).any(axis=1)
        return pushed

    def _speed(self, n: int, towards: int, firm: Array[F]) -> Floats[P]:
        """Return the change to a frame from its neighbour on one side; 0 where that was lost or is far."""
        other = n + towards
        if not 0 <= other < len(self.poses) or not firm[other]:
            return np.zeros_like(self.poses[n])
        step = change(self.poses[other], self.poses[n])
        return step if (np.abs(step) < _SURPRISING * self._usual).all() else np.zeros_like(step)

    def _carry(self, starts: Iterable[tuple[int, int, Floats[P], Floats[P]]]) -> None:
        """Carry poses on, from each frame one way with a speed; ways that part share no frame."""
        in_parallel(lambda start: self._carry_on(*start), starts)

    def _carry_on(self, n: int, towards: int, pose: Floats[P], speed: Floats[P]) -> None:
        """Add the minima to which a pose leads, frame after frame, until it meets those that are known."""
        met, worse = 0, 0.0
        for other in range(n + towards, n + towards * (_FAR + 1), towards):
            if not 0 <= other < len(self.poses) or self.control.should_stop() or met == _MET:
                return
            speed = self.motion.kept * speed
            expected = self.likelihood.model.clipped(moved(pose, speed))
            there = self._nearest(other, expected)
            found = there or self._descended(other, expected, True, "carried on")
            if found is None:
                pose = expected
                continue
            row = self.minima[other]
            seen = [one.system.cost for one in row if one.origin != "bridged"]
            least = min(seen, default=found.system.cost)
            worse = max(worse + self.share * (found.system.cost - least), 0.0)
            if worse > _HOPELESS:
                return
            met = 0 if there is None and self._add(other, found) else met + 1
            speed = change(pose, found.pose)
            pose = found.pose

    def _descended(self, n: int, start: Floats[P], pull: bool, origin: str) -> Minimum | None:
        """Return the minimum near a pose; None where nothing was seen or the hand isn't there."""
        frame, model = self._frame(n), self.likelihood.model
        terms: FrameTerms = frame.terms
        if not terms.has_observations:
            return None
        if pull:
            settings = self.likelihood.settings
            expected = motion_prior(model.joint_params(start), settings.prior, 1.0, 1)
            terms = replace(terms, priors=(*terms.priors, expected))
        stop = self.control.should_stop
        terms = terms.visible_at(model.bones(start))
        found = descend(terms, start, stop)[0].params
        if self.tracked[n].status == Status.LOST:
            again = assess(frame.terms, model.bones(found), 0.0, ())[0]
            if again == Status.LOST:
                return None
        return self._minimum(n, found, origin)

    def _add(self, n: int, found: Minimum) -> bool:
        """Add a minimum, unless it is known; return whether it isn't."""
        row = self.minima[n]
        if self._nearest(n, found.pose) is not None:
            return False
        if row[0].origin == "bridged":
            row.clear()
        row.append(found)
        return True

    def _nearest(self, n: int, pose: Floats[P]) -> Minimum | None:
        """Return the nearest of a frame's minima that a pose is one with."""
        seen = [one for one in self.minima[n] if one.origin != "bridged"]
        far = [largest_move_m(self.likelihood.model, one.pose, pose) for one in seen]
        return seen[int(np.argmin(far))] if far and min(far) < APART_M else None

    def _try_fingers(self, n: int) -> None:
        """Put fingers elsewhere in a frame, and carry on what fits."""
        frame, model = self._frame(n), self.likelihood.model
        if not frame.terms.has_observations or not model.has_keypoints21:
            return
        pose = min(self.minima[n], key=lambda one: one.system.cost).pose
        far = stage_problem(frame.terms, pose, 0)
        starts = [start for _, start in finger_grid(far, pose, _TRIED)]
        cameras = [prepared.camera for prepared in frame.terms.prepared]
        flips = sorted(flipped_fingers(model, cameras, pose), key=far.cost)
        starts += flips[:_TRIED]
        for found in in_parallel(lambda start: self._descended(n, start, False, "tried"), starts):
            if self.control.should_stop():
                return
            least = min(one.system.cost for one in self.minima[n])
            if found is None or self.share * (found.system.cost - least) > _HOPELESS:
                continue
            if self._add(n, found):
                still = np.zeros_like(found.pose)
                self._carry((n, way, found.pose, still) for way in (-1, 1))


def largest_move_m(model: ArticulatedModel, one: Floats[P], other: Floats[P]) -> float:
    """Return by how much the bone's end that moves most between two poses moves [m]."""
    a, b = (model.bone_ends(model.bones(pose)) for pose in (one, other))
    return float(np.linalg.norm(a - b, axis=1).max())


def _spread(wanted: Array[F], every: float) -> list[int]:
    """Return the middle one of every so many frames of each row of those that are wanted."""
    found: list[int] = []
    for begin, end in runs(wanted):
        cuts = np.linspace(begin, end, int(np.ceil((end - begin) / every)) + 1).astype(int)
        found += [(a + b) // 2 for a, b in pairwise(cuts.tolist())]
    return found
