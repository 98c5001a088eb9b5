"""Frames as one problem, those of a recording or chosen ones: what each says of its pose and of what all share, how poses follow one another,
and which are most probable together.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property, lru_cache
from typing import Protocol, Self

import numpy as np

from handtrack.arrays import D2, Array, F, Floats, Ints, K, L, M, N, P, array_dataclass
from handtrack.model.articulated import ArticulatedModel, HandScale
from handtrack.model.kinematics import BoneFields
from handtrack.model.pose_changes import TURN, by_turn, moved
from handtrack.model.size import SizeParameters
from handtrack.parallel import in_parallel
from handtrack.solver.block_banded import REACH, Bordered
from handtrack.solver.problem import Problem
from handtrack.terms.bone_kernels import add_to_chosen
from handtrack.terms.keypoints import KeypointTerm
from handtrack.terms.silhouettes import FieldTerm
from handtrack.terms.term import JointSystem, ObservationTerm
from handtrack.tracking.frame.constants import POINTS_LAST
from handtrack.tracking.size.cameras import (
    CALIBRATION,
    DETECTOR,
    NUMBERS,
    TIME,
    CameraChanges,
    CameraPoses,
    velocities,
)
from handtrack.tracking.size.motion import Motion
from handtrack.tracking.size.person import PersonChange, is_stopped


def terms_of(problem: Problem, model: ArticulatedModel) -> list[ObservationTerm]:
    """Return a problem's terms of what was seen, where the joints that a detector means are this model's."""
    return [
        replace(term, model=model) if isinstance(term, KeypointTerm) else term
        for term in problem.observation_terms
    ]


_AT_ONCE = 256
"""frames that are unpacked at once"""


@array_dataclass
class FrameProblem:
    """What a frame says of its pose, and of what all share."""

    others: Problem
    """what was seen, but for `views`"""
    prior: Problem
    """what is known of poses beforehand"""
    views: tuple[Problem, ...]
    """what each of the cameras saw that may change, last the clouds of theirs"""
    share: float
    """of what was seen, how much counts: less where errors last, and the poses are as wrong as they are"""

    @classmethod
    def of(cls, problem: Problem) -> FrameProblem:
        """Return a frame's problem as it is, through cameras that stay."""
        seen = replace(problem, parameter_terms=())
        return cls(seen, replace(problem, observation_terms=()), (), 1.0)

    def linearize(
        self, pose: Floats[P], views: Sequence[CameraPoses], n: int, person: PersonChange
    ) -> tuple[JointSystem, Floats[P, P]]:
        """Return what the frame says of its pose and of what all share: of P + K numbers, changes
        of the pose as `pose_changes.moved` makes them, then the shared ones; and what it alone
        would say of the pose by what was seen: a matrix, without what is known beforehand.

        Parameters
        ----------
        views
            Of each camera that may change, the frame being their n-th.
        """
        size = len(pose)
        ends = (view.first + view.by_camera.shape[2] for view in views)
        count = max(ends, default=0) + person.count
        gradient, matrix = np.zeros(size + count), np.zeros((size + count, size + count))
        numbers = np.arange(size + count)
        persons = numbers[size + count - person.count :]
        cost = 0.0
        for problem, view in zip([self.others, *self.views], [None, *views], strict=True):
            if problem.observation_terms:
                seen = _frame_system(person, problem, pose, view, n)
                own = numbers[size:] if view is None else numbers[size + view.first :]
                wide = 0 if view is None else view.by_camera.shape[2]
                at = np.concatenate([numbers[:size], own[:wide], persons])
                cost += seen.cost
                add_to_chosen(gradient, matrix, at, seen.gradient, seen.hessian)
        known = by_changes(self.prior.linearize(pose), pose)
        told = matrix[:size, :size].copy()
        gradient[:size] += known.gradient
        matrix[:size, :size] += known.hessian
        return JointSystem(cost + known.cost, gradient, matrix), told / self.share


_Sparse = tuple[Array, Floats[N]]
"""bits of a row's entries that are not 0, and these"""


@array_dataclass
class FrameSystems:
    """Each frame's cost to second order, by L = P + K numbers: changes of its own pose, and of what all frames share.

    There are two while a step is tried; frames that are not linearised again have one matrix in both. Of a hand whose joints three cameras
    see a matrix takes 27 kB: each joint's offset goes with few other numbers, and whole matrices of K = 90 would take 60.
    """

    size: int
    """P"""
    costs: Floats[F]
    gradient: Floats[F, L]
    share: Floats[F]
    """of what was seen, how much counts"""
    since: Floats[F, L]
    """steps since it was linearised, which its cost and gradient follow to second order"""
    _matrices: list[tuple[Array, _Sparse, _Sparse]]
    """lower halves of the poses' part, and of what of it is of what was seen; by what is shared and pose; lower half by what is shared"""

    @classmethod
    def empty(cls, frames: int, size: int, shared: int) -> FrameSystems:
        """Return room for as many frames as `put` is called for."""
        gradient, since = np.zeros((2, frames, size + shared))
        costs, share = np.empty(frames), np.ones(frames)
        nothing = _sparse(np.empty(0))
        return cls(size, costs, gradient, share, since, [(np.empty(0), nothing, nothing)] * frames)

    @property
    def shared(self) -> int:
        """K."""
        return self.gradient.shape[1] - self.size

    def put(self, frame: int, share: float, whole: JointSystem, seen: Floats[P, P]) -> None:
        """Keep a frame's system, in place, of which that share of what was seen counts."""
        self.costs[frame], self.gradient[frame] = whole.cost, whole.gradient
        self.share[frame], self.since[frame] = share, 0.0
        own, (border, corner) = _half(self.size), np.hsplit(whole.hessian[self.size :], [self.size])
        poses, shared = np.array([whole.hessian[own], seen[own]]), corner[_half(self.shared)]
        self._matrices[frame] = poses, _sparse(border.ravel()), _sparse(shared)

    def parts(self) -> Iterator[slice]:
        """Yield which frames are unpacked at once."""
        for first in range(0, len(self.costs), _AT_ONCE):
            yield slice(first, first + _AT_ONCE)

    def own(self, at: slice) -> Floats[N, P, P]:
        """Return the poses' part of some frames."""
        return self._of_poses(at, 0)

    def observed(self, at: slice) -> Floats[N, P, P]:
        """Return what each of some frames alone would say of its pose by what was seen."""
        return self._of_poses(at, 1)

    def border(self, at: slice) -> Floats[N, P, K]:
        """Return the part of some frames by pose and what is shared."""
        rows = _dense([border for _, border, _ in self._matrices[at]], self.shared * self.size)
        return rows.reshape(len(rows), self.shared, self.size).swapaxes(1, 2)

    @property
    def corner(self) -> Floats[K, K]:
        """By what is shared, all frames together."""
        total = self._corner(slice(0))
        for at in self.parts():
            # in the order of frames: the same sum however many there are at once
            total = np.concatenate([total, self._corner(at)]).sum(axis=0, keepdims=True)
        return total[0, _places(self.shared)]

    def after(self, step: Floats[F, P], shared: Floats[K]) -> tuple[FrameSystems, Floats[F]]:
        """Return what the frames should say after a step, to second order; and the second-order cost ½ δᵀHδ of each frame's steps δ since it
        was linearised: half their length squared, in standard deviations.
        """
        found = replace(self, **{name: getattr(self, name).copy() for name in _BY_FRAME})
        extrapolated = np.empty(len(self.costs))
        for at in self.parts():
            whole = np.column_stack([step[at], np.tile(shared, (len(step[at]), 1))])
            hessian = self._hessian(at)
            bent = np.einsum("fij,fj->fi", hessian, whole)
            found.costs[at] += (whole * (self.gradient[at] + 0.5 * bent)).sum(axis=1)
            found.gradient[at] += bent
            since = found.since[at]
            since += whole
            extrapolated[at] = 0.5 * (since * np.einsum("fij,fj->fi", hessian, since)).sum(axis=1)
        return found, extrapolated

    def _hessian(self, at: slice) -> Floats[N, L, L]:
        """Return whole matrices of some frames; those beside each other in memory are frames, so that sums over numbers are in their order."""
        (size, both), border = (self.size, self.gradient.shape[1]), self.border(at)
        found = np.empty((both, both, len(border)))
        found[:size, :size] = np.moveaxis(self.own(at), 0, 2)
        found[:size, size:] = np.moveaxis(border, 0, 2)
        found[size:, :size] = found[:size, size:].swapaxes(0, 1)
        found[size:, size:] = np.moveaxis(self._corner(at)[:, _places(self.shared)], 0, 2)
        return np.moveaxis(found, 2, 0)

    def _of_poses(self, at: slice, which: int) -> Floats[N, P, P]:
        return np.array([both[which] for both, _, _ in self._matrices[at]])[:, _places(self.size)]

    def _corner(self, at: slice) -> Floats[N, M]:
        rows = [corner for _, _, corner in self._matrices[at]]
        return _dense(rows, self.shared * (self.shared + 1) // 2)


_BY_FRAME = ("costs", "gradient", "share", "since", "_matrices")
"""fields of FrameSystems of which `put` exchanges a row"""


def _sparse(row: Floats[N]) -> _Sparse:
    """Return a row by its entries that are not 0; −0 is one, too."""
    there = row.view(np.uint64) != 0
    return np.packbits(there), row[there]


def _dense(rows: Sequence[_Sparse], count: int) -> Floats[M, N]:
    """Return rows of so many entries."""
    found = np.zeros((len(rows), count))
    for row, (bits, entries) in zip(found, rows, strict=True):
        row[np.unpackbits(bits, count=count).view(bool)] = entries
    return found


def by_changes(system: JointSystem, pose: Floats[P]) -> JointSystem:
    """Return a pose's system by changes as `pose_changes.moved` makes them."""
    return system.pull_back(by_change(pose))


def _frame_system(
    person: PersonChange, problem: Problem, pose: Floats[P], view: CameraPoses | None, n: int
) -> JointSystem:
    """Return what was seen by changes of the pose, then of the camera where it may change, and by the free ones of a person's deviations
    (K,), without a size's prior.
    """
    moves, outline, terms = by_change(pose), None, problem.observation_terms
    if view is not None:
        here = np.eye(len(pose))
        here[:6, :6], pose = view.by_pose[n], view.poses[n]
        moves = by_change(pose) @ np.column_stack([here, view.by_camera[n]])
        if view.wider_m:
            terms = [t.wider(view.wider_m) if isinstance(t, FieldTerm) else t for t in terms]
            problem = replace(problem, observation_terms=terms)
        if view.by_outline.any():
            outline = np.concatenate([np.zeros(len(pose)), view.by_outline])
    if not person.count and outline is None:
        return problem.linearize(pose).pull_back(moves)
    model = person.model
    bones, twists, _ = model.linearize(pose)
    fields = BoneFields.of_twists(
        twists @ (model.transform.matrix @ moves), len(model.joint_names), outline
    )
    if person.count:
        fields = fields.beside(person.parameters.fields(bones, np.flatnonzero(person.free)))
    systems = (term.linearize(bones, fields) for term in terms_of(problem, model))
    return sum(systems, JointSystem.zero(fields.joints.shape[2]))


def by_change(pose: Floats[P]) -> Floats[P, P]:
    """Return how solver parameters change with changes as `pose_changes.moved` makes them."""
    found = np.eye(len(pose))
    found[TURN, TURN] = by_turn(pose)
    return found


@lru_cache(maxsize=8)
def _half(size: int) -> tuple[Ints[M], Ints[M]]:
    """Return rows and columns of a matrix's lower half, row after row."""
    rows, columns = np.tril_indices(size)
    return rows, columns


@lru_cache(maxsize=8)
def _places(size: int) -> Ints[N, N]:
    """Return where each entry of a symmetric matrix is in its lower half."""
    found = np.empty((size, size), int)
    rows, columns = _half(size)
    found[rows, columns] = found[columns, rows] = np.arange(len(rows))
    return found


# ---- all frames together


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

    def frames_per_sample(self, frames: float, posture: float) -> Floats[K]:
        """Return of how many frames all together tell as much as one of each number: of where cameras are of all `frames`, of the
        person and of masks those with one posture. Of when a camera saw each frame tells anew: what flesh is off by, times a
        velocity, sums to its share of the way, and a hand that goes there and back takes it back. A detector's joints of one image
        err together, too, and where a camera looks by them still in the next.
        """
        once = np.where(TIME, 1.0, np.where(CALIBRATION, frames, posture))
        if self.cameras.detected:
            once[TIME], once[DETECTOR] = _JOINTS_ALIKE, _JOINTS_ALIKE * _JOINTS_LAST
        return np.r_[
            np.tile(once[self.cameras.free], len(self.cameras.cameras)),
            np.full(self.person.count, posture),
        ].astype(float)


_SWEEPS = 30
"""at most; it ends by what a sweep gains, see `_ENOUGH`"""
_ENOUGH, _ENOUGH_ONCE = 0.02, 0.125
"""Newton's decrement, the gain that a step foretells, below which it is the last: of the mean frame a fifth of a standard deviation,
½ (1/5)², and half of one of any single frame, ½ (1/2)². A hand that moves fast creeps on for long below that: of curling fingers the mean
error was 4.52 mm after 7 sweeps and 4.51 after 23, when no frame moved by a fifth. In angles of joints that nothing shows a step may be
large for as little"""
_LOOSER = 1.0, 5.0, 25.0
"""times as much where another estimate goes on from this one: of chosen frames, or of wide bands; of both, where the mean frame's gain is one
standard deviation, ½. 5 was chosen by joints alone on marked_real_5cam while cameras' times stayed as wide bands found them, with it 10.66
mm, with 25 10.76. 100 frames of desk_two_view take 31 sweeps for 42; of ten recordings of masks six became better and four worse, on average 0.1 mm better"""
_DAMPING, _TIGHTEN, _RELAX, _LEAST, _MOST = 1e-3, 10.0, 0.1, 1e-4, 1e6
"""first damping, as a share of the diagonal; by what it is multiplied after a step that frames fit worse, each further one twice as much
(Nielsen 1999), and after others. Below the least steps hardly change: of sizing's sweeps a third were spent to come back from 1e-9"""
_STALLED = 3
"""sweeps that end it, too, where all together gained less than `_ENOUGH` of the mean frame, and one standard deviation is foretold at most.
Near the minimum a quarter of all sweeps gained nothing: steps are rejected for what pixels at outlines do. Three: by looking at the sweeps of
webxr_open_close_3cam and of the demo"""
_LONGEST = 2.0
"""times as long as Gauss and Newton's a step may be, where the one before found the cost to curve less than the system says. Robust losses
are taken by the parabolas above them: up to twice the way to a parabola's minimum costs no more than none (de Leeuw and Heiser 1980)"""
_RIDGE = 1e-9
_LINEARIZED = 16
"""frames at once on all cores; between them it may be stopped"""
_NEW = (1.0 - POINTS_LAST) / (1.0 + POINTS_LAST)
"""share of a frame that is new. Of what they share, all frames together tell as much as one: what a model's flesh is off by,
they share too, and so many pixels would take it for the cameras'. What is known of these weighs as many times as there are frames;
of the person as many times as frames show one pose, for what flesh is off by differs from pose to pose"""
_JOINTS_ALIKE, _JOINTS_LAST = 4.0, 13.0
"""joints of one image that tell as much as one of what moves all alike, and frames in a row: in nine cameras before two rendered hands a
joint errs by 3.7 px (rms) on its own, by 1.35 px together with the 20 others, of which 0.86 is left in the next frame, and by 2.7 px to a side
that stays, as if the camera were turned by half of what it may be. Before these hands, by two and three cameras, up to 1.7 frames of a time
offset were false while cameras might not turn, 0.6 since"""
_MOTIONS, _MOTION_SWEEPS = 5, 3
"""times that the motion is estimated with the frames' systems as they are, since reading the frames anew takes longer, and in how
many of the sweeps; then it stands, for poses to settle"""


class StoppedError(Exception):
    """Raised in place of an estimate: asked to stop, or it would gain too little."""


@array_dataclass
class WholeEstimate:
    """Poses of frames that follow one another, and how sure they are."""

    poses: Floats[F, P]
    covariance: Floats[F, P, P]
    """of the changes of each pose as `pose_changes.moved` makes them, errors that last counted once"""
    costs: Floats[F]
    """what each frame says against its pose"""
    sweeps: int
    why: str
    """`converged`, `sweeps` (used up), or `no descent`"""
    shared: Shared
    """what was found of cameras and person"""
    shared_covariance: Floats[K, K]
    """of all numbers of `shared`"""
    origin: str = "followed"
    """how it was come by, of several trajectories"""

    @property
    def cameras(self) -> CameraChanges:
        return self.shared.cameras

    @cached_property
    def speeds(self) -> Floats[F, P]:
        """What each pose changes a frame."""
        return velocities(self.poses)

    @cached_property
    def moments(self) -> Floats[N, F]:
        """How much later than a frame each camera saw the image looked at beside it, and last the cloud was measured [frames]."""
        return self.cameras.moments(len(self.poses))

    @cached_property
    def scale(self) -> HandScale | None:
        """The person, where something of them was found."""
        first = self.cameras.count
        person, known = self.shared.person, self.shared_covariance[first:, first:]
        return person.scale(known) if person.count else None


class Frames(Protocol):
    """Where the estimate reads frames, and what they share."""

    @property
    def shared(self) -> Shared: ...
    @property
    def usual(self) -> Motion | None:
        """How poses usually follow one another; None where frames do not follow one another."""
        ...

    @property
    def repeated(self) -> float:
        """How many frames show one pose."""
        ...

    @property
    def wide(self) -> bool:
        """Whether bands or losses are wide: what is found is but a start."""
        ...

    def of(self, frame: int) -> FrameProblem:
        """Return what a frame says."""
        ...

    def sharing(self, shared: Shared) -> Self:
        """Return the same frames of a person and through cameras that have changed."""
        ...


@array_dataclass
class ChosenFrames:
    """Frames with a problem each that do not follow one another."""

    problems: Sequence[Problem]
    person: PersonChange
    repeated: float = 1.0
    usual, wide = None, False

    @property
    def shared(self) -> Shared:
        return Shared(CameraChanges.of(), self.person)

    def of(self, frame: int) -> FrameProblem:
        return FrameProblem.of(self.problems[frame])

    def sharing(self, shared: Shared) -> Self:
        return replace(self, person=shared.person)


@array_dataclass
class _Swept:
    """What all frames say at their poses, and of what they share."""

    poses: Floats[F, P]
    shared: Shared
    frames_per_sample: Floats[K]
    """of how many frames all together tell as much as one, of what is shared"""
    systems: FrameSystems

    @cached_property
    def bounds(self) -> Floats[F, P, D2]:
        """Between which the poses may be."""
        return self.shared.person.parameters.model.bounds(self.poses)

    @property
    def costs(self) -> Floats[F]:
        return self.systems.costs

    def cost(self, motion: Motion | None) -> float:
        moves = 0.0 if motion is None else motion.cost(self.poses)
        return float(self.costs.sum()) + moves + self.known.cost

    @cached_property
    def known(self) -> JointSystem:
        """What is known beforehand of what they share."""
        return self.shared.known(self.frames_per_sample)


def estimate_whole(
    likelihood: Frames,
    frames: Sequence[int],
    poses: Floats[F, P],
    should_stop: Callable[[], bool] = lambda: False,
    report: Callable[[float], None] = lambda share: None,
    sweeps: int = _SWEEPS,
    at_most: float = np.inf,
) -> WholeEstimate:
    """Return the poses that are most probable together, from `poses` on, solver parameters of the
    frames, and the changes of the evidence's cameras and person. Raises StoppedError when stopped, or
    where its first step does not foretell that a frame costs less than `at_most` on average.

    Damped Gauss-Newton on all poses at once (banded Cholesky, linear in the frames), and what they
    share in its border. Each frame has a damping of its own: one that fits worse after a step than
    its system predicted is held back, the others are not. A frame that steps have moved by less
    than a fifth of a standard deviation is linearised again only at the end (`_ENOUGH`; the fluid
    relinearization of Kaess et al. 2012, iSAM2). What lies at a limit and would leave is held
    there. The process noise of the motion is estimated beside (EM).

    Parameters
    ----------
    tell
        Is called with the share that is done, frame by frame, since reading them takes longest.
    sweeps
        At most.
    """
    model = likelihood.shared.person.parameters.model
    usual = motion = likelihood.usual
    times = _LOOSER[(usual is None) + likelihood.wide]
    if usual is not None:
        motion = usual.estimated(poses, (), usual)
    frames_per_sample = likelihood.shared.frames_per_sample(
        len(frames), min(likelihood.repeated, len(frames))
    )
    damping, stiff, tighten = np.full(len(frames), _DAMPING), _DAMPING, _TIGHTEN
    length, gains = 1.0, list[float]()
    why, sweep = "sweeps", 0

    def swept(poses: Floats[F, P], ahead: tuple[FrameSystems, Floats[F]] | None = None) -> _Swept:
        shared, speed = likelihood.shared, velocities(poses)
        cameras, person = shared.cameras, shared.person
        views = cameras.views(poses, speed)
        if ahead is None:
            ahead = FrameSystems.empty(*poses.shape, shared.count), np.full(len(frames), np.inf)
        systems, extrapolated = ahead

        def linearized(n: int) -> tuple[float, JointSystem, Floats[P, P]]:
            frame = likelihood.of(frames[n])
            return frame.share, *frame.linearize(poses[n], views, n, person)

        # to and fro: of a long recording the frames that were read last are still in memory
        order = np.flatnonzero(~(extrapolated < _ENOUGH))[:: 1 if sweep % 2 == 0 else -1].tolist()
        for first in range(0, len(order), _LINEARIZED):
            if should_stop():
                raise StoppedError
            some = order[first : first + _LINEARIZED]
            for n, system in zip(some, in_parallel(linearized, some), strict=True):
                systems.put(n, *system)
            report((sweep + (first + len(some)) / len(order)) / (sweeps + 1))
        return _Swept(poses, shared, frames_per_sample, systems)

    best = swept(model.clipped(poses))
    for sweep in range(1, sweeps + 1):
        for _ in range(_MOTIONS if sweep <= _MOTION_SWEEPS else 0):
            if motion is None or usual is None:
                break
            system, right = _system(best, motion)
            expected = moved(best.poses, system.solve(*right)[0])
            motion = motion.estimated(expected, system.inverse_parts(), usual)
            del system  # of a long recording as large as what all frames say: never two at once
        system, right = _system(best, motion, damping, shared_damping=stiff)
        step, change = system.solve(*right)
        del system
        expected_gain = 0.5 * (right[0] * step).sum(axis=1)
        expected_gain += 0.5 * float((right[1] * change / frames_per_sample).sum())
        most, most_once = times * _ENOUGH, times * _ENOUGH_ONCE
        settled = expected_gain.mean() < most and expected_gain.max() < most_once
        step, change = length * step, length * change
        slope = float((right[0] * step).sum() + right[1] @ change)
        ahead = best.systems.after(step, change)
        predicted = ahead[0].costs.copy()
        if sweep == 1 and predicted.mean() >= at_most:
            raise StoppedError
        likelihood = likelihood.sharing(best.shared.stepped(change))
        found = swept(model.clipped(moved(best.poses, step)), ahead)
        gain = best.cost(motion) - found.cost(motion)
        # where the parabola is lowest that has the cost's slope, and its gain at this step
        best_length = 0.5 * length * slope / (slope - gain) if gain < slope else _LONGEST
        length = min(max(best_length, 1.0), _LONGEST)
        worse = found.costs > np.maximum(predicted, best.costs)
        damping = np.clip(damping * np.where(worse, tighten, _RELAX), _LEAST, _MOST)
        if gain > 0:
            best, tighten = found, _TIGHTEN
            stiff = max(_RELAX * stiff, _LEAST)
        elif worse.any() or (best.shared.count and stiff < _MOST):
            stiff *= tighten
            tighten *= 2.0
        else:
            why = "no descent"
        del found, ahead  # nor what frames said after a step that was not taken
        if why == "no descent":
            break
        common, cameras = best.shared.cameras.common, best.shared.cameras
        gains = [*gains, max(gain, 0.0)][-_STALLED:]
        stalled = len(gains) == _STALLED and sum(gains) < most * len(frames)
        ends = (gain > 0 and settled) or (stalled and expected_gain.mean() < _LOOSER[-1] * _ENOUGH)
        nearer = cameras.earlier(common).whole_frames()
        if nearer.ahead != cameras.ahead or (common and (ends or sweep == sweeps)):
            likelihood = likelihood.sharing(best.shared.through(nearer))
            best = swept(model.clipped(moved(best.poses, common * velocities(best.poses))))
            ends &= nearer.ahead == cameras.ahead
        if ends:
            why = "converged"
            break
    if not likelihood.wide and best.systems.since.any():
        likelihood = likelihood.sharing(best.shared)
        best = swept(best.poses)
    covariance, shared = _reported_covariance(best, motion)
    return WholeEstimate(best.poses, covariance, best.costs, sweep, why, best.shared, shared)


def fit_size(
    problems: Sequence[Problem],
    poses: Sequence[Floats[P]],
    free: Array[N] | None = None,
    repeated: float = 1.0,
) -> tuple[HandScale, Floats[F, P]]:
    """Return the person who explains frames' problems best, and the poses of each.

    Parameters
    ----------
    problems
        Of one model; its size and `poses` are where the search starts.
    free
        Which of the model's `SizeParameters` may change; all unless given.
    repeated
        How many frames tell as much as one, since they err alike.
    """
    size = SizeParameters(problems[0].model)
    every = np.ones(len(size.names), bool) if free is None else free
    person = PersonChange(size, every, size.deviations(size.model.scale))
    frames = ChosenFrames(problems, person, repeated)
    found = estimate_whole(frames, range(len(problems)), np.array(poses))
    assert found.scale is not None, "something is free"
    return found.scale, found.poses


def _reported_covariance(
    swept: _Swept, motion: Motion | None
) -> tuple[Floats[F, P, P], Floats[K, K]]:
    """Return each pose's covariance, and that of what they share, where what was seen errs alike from frame to frame: a model's own
    flesh, and where a detector sees its joints, are wrong in the next frame too.

    Of the other frames one in (1 + ρ)/(1 − ρ) is new; and what they say of a direction does not add to what its own frame
    says of it: the surer of both counts. What is shared is not known from the frame alone: its doubt comes on top.
    """
    system, _ = _system(swept, motion, reported=True)
    found = np.empty((*swept.poses.shape, swept.poses.shape[1]))
    for first, blocks in system.inverse_parts():
        found[first : first + len(blocks)] = blocks[:, 0]
    for at in swept.systems.parts():
        for t, seen in enumerate(swept.systems.observed(at), at.start):
            found[t] = _surer(seen, np.linalg.inv(found[t])) + system.spread(t)
    return found, system.covariance


def _surer(own: Floats[P, P], others: Floats[P, P]) -> Floats[P, P]:
    """Return the covariance in which each direction is as well known as by the surer of two informations, those in which both
    are diagonal; others: without a direction that nothing holds, and with a small part of own.
    """
    root = np.linalg.cholesky(own + others)
    share = np.linalg.solve(root, np.linalg.solve(root, own).T)
    values, vectors = np.linalg.eigh(0.5 * (share + share.T))
    back = np.linalg.solve(root.T, vectors)
    return (back / np.maximum(values, 1.0 - values)) @ back.T


def _system(
    swept: _Swept,
    motion: Motion | None,
    damping: Floats[F] | None = None,
    shared_damping: float = 0.0,
    reported: bool = False,
) -> tuple[Bordered, tuple[Floats[F, P], Floats[K]]]:
    """Return the system of poses and what they share, and its right sides, in which nothing moves that a limit stops.

    stated: of what a frame that follows another saw only that counts which was not seen before; of what all share all frames then tell
    as much as those that are alike.
    """
    new = 1.0 if motion is None or not reported else _NEW
    systems, (frames, size) = swept.systems, swept.poses.shape
    blocks = np.zeros((frames, REACH + 1, size, size))
    gradient = systems.gradient[:, :size].copy()
    for at in systems.parts():
        blocks[at, 0] += systems.own(at)
        if new < 1.0:
            more = np.maximum(systems.share[at], new) - new
            blocks[at, 0] -= more[:, None, None] * systems.observed(at)
    if motion is not None:
        motion.add_to(blocks, gradient, swept.poses)
    own = np.diagonal(blocks[:, 0], axis1=1, axis2=2)
    extra = (_RIDGE if damping is None else damping[:, None]) * own + _RIDGE
    low, high = np.moveaxis(swept.bounds, 2, 0)
    free = ~is_stopped(swept.poses, low, high, gradient)
    for k in range(REACH + 1):
        rows = free[k:] if k else free
        both = rows[:, :, None] & free[: len(rows), None, :]
        blocks[: len(rows), k] *= both
    every = np.arange(size)
    blocks[:, 0, every, every] += np.where(free, extra, 1.0 + own)
    frames_per_sample = (
        swept.frames_per_sample if reported else np.ones_like(swept.frames_per_sample)
    )
    counted = systems.share if reported else np.ones(frames)
    known = swept.shared.known(np.ones_like(frames_per_sample)) if reported else swept.known
    corner = (
        systems.corner / np.mean(counted) / np.sqrt(np.outer(frames_per_sample, frames_per_sample))
        + known.hessian
    )
    corner += shared_damping * np.diag(np.diag(corner))
    pull = systems.gradient[:, size:].sum(axis=0) + known.gradient
    held = swept.shared.stopped(pull)
    corner = np.where(held | held[:, None], np.diag(np.diag(corner)), corner)
    right = np.where(free, -gradient, 0.0), np.where(held, 0.0, -pull)

    def border(at: slice) -> Floats[N, P, K]:
        weight = np.sqrt(new / counted[at, None, None] / frames_per_sample)
        return np.where(held, 0.0, systems.border(at) * free[at, :, None] * weight)

    return Bordered.of(blocks, border, corner), right
