"""What each frame says of its pose and of what all share; of all frames kept small: symmetric matrices as the entries of their lower
halves that are not 0."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from handtrack.arrays import Array, F, Floats, Ints, K, L, M, N, P, array_dataclass
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.kinematics import BoneFields
from handtrack.model.pose_changes import TURN, by_turn
from handtrack.solver.problem import Problem
from handtrack.terms.bone_kernels import add_to_chosen
from handtrack.terms.bone_system import JointSystem
from handtrack.terms.keypoints import KeypointTerm
from handtrack.terms.silhouettes.silhouette_terms import FieldTerm
from handtrack.terms.term import ObservationTerm
from handtrack.tracking.size.cameras import CameraPoses
from handtrack.tracking.size.person import PersonChange


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

    def own(self) -> Iterator[tuple[slice, Floats[N, P, P]]]:
        """Yield the poses' part, some frames at once."""
        for at in self._parts():
            yield at, self._of_poses(at, 0)

    def observed(self) -> Iterator[tuple[slice, Floats[N, P, P]]]:
        """Yield what each frame alone would say of its pose by what was seen, some frames at once."""
        for at in self._parts():
            yield at, self._of_poses(at, 1)

    def border(self, at: slice) -> Floats[N, P, K]:
        """Return the part of some frames by pose and what is shared."""
        rows = _dense([border for _, border, _ in self._matrices[at]], self.shared * self.size)
        return rows.reshape(len(rows), self.shared, self.size).swapaxes(1, 2)

    @property
    def corner(self) -> Floats[K, K]:
        """By what is shared, all frames together."""
        total = self._corner(slice(0))
        for at in self._parts():
            # in the order of frames: the same sum however many there are at once
            total = np.concatenate([total, self._corner(at)]).sum(axis=0, keepdims=True)
        return total[0, _places(self.shared)]

    def after(self, step: Floats[F, P], shared: Floats[K]) -> tuple[FrameSystems, Floats[F]]:
        """Return what the frames should say after a step, to second order; and the second-order cost ½ δᵀHδ of each frame's steps δ since it
        was linearised: half their length squared, in standard deviations.
        """
        found = replace(self, **{name: getattr(self, name).copy() for name in _BY_FRAME})
        extrapolated = np.empty(len(self.costs))
        for at in self._parts():
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
        found[:size, :size] = np.moveaxis(self._of_poses(at, 0), 0, 2)
        found[:size, size:] = np.moveaxis(border, 0, 2)
        found[size:, :size] = found[:size, size:].swapaxes(0, 1)
        found[size:, size:] = np.moveaxis(self._corner(at)[:, _places(self.shared)], 0, 2)
        return np.moveaxis(found, 2, 0)

    def _of_poses(self, at: slice, which: int) -> Floats[N, P, P]:
        return np.array([both[which] for both, _, _ in self._matrices[at]])[:, _places(self.size)]

    def _corner(self, at: slice) -> Floats[N, M]:
        rows = [corner for _, _, corner in self._matrices[at]]
        return _dense(rows, self.shared * (self.shared + 1) // 2)

    def _parts(self) -> Iterator[slice]:
        for first in range(0, len(self.costs), _AT_ONCE):
            yield slice(first, first + _AT_ONCE)


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
