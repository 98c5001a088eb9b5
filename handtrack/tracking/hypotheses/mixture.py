"""Several hypotheses carried over time: predicted, jumped, scattered, optimised, weighed (2003 paper, §4)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from handtrack.arrays import Floats, Ints, P
from handtrack.errors import HandtrackError
from handtrack.geometry.camera import Camera
from handtrack.geometry.rotation import rotation_matrix, rotation_vector
from handtrack.model.articulated import ArticulatedModel
from handtrack.observation.observation import ImageKeypoints, Observation
from handtrack.sampling.chain_vote import chain_votes
from handtrack.sampling.chains import PreparedChain
from handtrack.sampling.diffusion import covariance_scaled, projected
from handtrack.sampling.hypotheses import distinct
from handtrack.sampling.interpretation_tree import TreeSettings, interpretation_tree
from handtrack.solver.covariance import covariance
from handtrack.tracking.frame.constants import APART_MM, JUMP_SHARE, MERGE_DEG, MIXTURE_DESCENTS
from handtrack.tracking.frame.descent import Minima, by_keypoints_alone, minima, stage_problem
from handtrack.tracking.frame.frame_terms import FrameTerms
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.frame.terms.posture import agility
from handtrack.tracking.hypotheses.mixture_terms import coarse, log_normal, pulled, without_memory
from handtrack.tracking.hypotheses.motion_belief import MotionBelief
from handtrack.tracking.hypotheses.moving_hypothesis import MovingHypothesis, with_wrapped_turn

_TREE = TreeSettings(failing="nearest", stretched="sample")
_FIRST_TREES, _FIRST_LEAVES = 6, 96  # of a first frame, and of each of its trees
# trees of better and better minima; times sigma where a start is far off
_FIRST_ROUNDS, _COARSE = (3, 10.0)
_WEIGHTLESS = 1e-300
_SPEED_RAD, _SPEED_M = np.deg2rad(10.0), 0.03
"""a frame; how fast what has just been found may move: an arm's swing takes about half a second"""


@dataclass(frozen=True, eq=False)
class Component:
    """One bell of the temporal prior: a hypothesis of the last frame moved to where it is expected now."""

    belief: MotionBelief
    terms: FrameTerms
    """what the frame costs, without any pull to the expected pose"""
    weight: float


@dataclass(frozen=True, eq=False)
class Mixture:
    """The hypotheses of one frame, heaviest first, and which of the last frame's each continues."""

    hypotheses: tuple[MovingHypothesis, ...]
    parents: tuple[int, ...]
    """−1 in a first frame"""


@dataclass(frozen=True, eq=False)
class _Proposals:
    """Minima found from one component in one way."""

    found: Minima
    terms: FrameTerms
    """without the pull to the expected pose"""
    parent: int
    origin: str
    belief: MotionBelief
    log_prior: float
    """log of the weight and of the prior's normalisation"""


@dataclass(frozen=True, eq=False)
class MixtureStep:
    """What is the same in every frame: model, settings, chains, and how fast parameters may change."""

    model: ArticulatedModel
    settings: TrackerSettings
    chains: Sequence[PreparedChain]

    def first(
        self, observation: Observation, terms: FrameTerms, start: Floats[P],
        should_stop: Callable[[], bool] | None = None,
    ) -> Mixture:  # fmt: skip
        """Return the hypotheses of a first frame: minima near start in any heading, and what their trees hold.

        From a start that is far off, first as if joints were seen coarsely. Then the best minimum's interpretation tree, and a
        better one's again, until none is better.
        """
        rng = self._rng(observation)
        rough = self._minima(coarse(terms), self._turned(start), 4, should_stop, True)
        starts = np.concatenate([start[None], rough.params])
        near = self._minima(terms, starts, 4, should_stop, True)
        found, eye, descents = [near], _eye(observation), MIXTURE_DESCENTS
        for _ in range(_FIRST_ROUNDS):
            if eye is None or not self.chains:
                break
            starts = self._trees_of_best(found[-1], eye, rng)
            least = found[-1].cost.min()
            found.append(self._minima(terms, starts, descents, should_stop, True))
            if not found[-1].cost.min() < least - 1.0:
                break
        still = MotionBelief.at_rest(start, np.eye(len(start)), self._speed())
        proposals = [_Proposals(near, terms, -1, "start", still, 0.0)]
        proposals += [_Proposals(f, terms, -1, "first tree", still, 0.0) for f in found[1:]]
        return self._weighed(proposals, True)

    def _trees_of_best(
        self, near: Minima, eye: tuple[Camera, ImageKeypoints | None], rng: np.random.Generator
    ) -> Floats:
        """Return starts (N, P): leaves of the whole body's tree at a few of the best minima, and samples around them."""
        camera, seen = eye
        targets, mixture = _of(self.model, seen), self.settings.mixture
        starts = []
        for row in distinct(near.params, near.cost)[:_FIRST_TREES]:
            params = near.params[row]
            tree = interpretation_tree(self.model, params, self.chains, camera, targets, _TREE, rng)
            leaves = tree.params
            if len(leaves) > _FIRST_LEAVES:
                leaves = leaves[rng.choice(len(leaves), _FIRST_LEAVES, replace=False)]
            spread = covariance(near.hessian[row])[0]
            around = covariance_scaled(params, spread, mixture.scale, mixture.draws // 2, rng)
            starts += [params[None], leaves, projected(self.model, around)]
        return np.concatenate(starts)

    def next(
        self,
        observation: Observation,
        components: Sequence[Component],
        should_stop: Callable[[], bool] | None = None,
    ) -> Mixture:
        """Return the hypotheses of a frame from those of the last one.

        Each component is optimised from where it is expected. Then components are drawn; of each, a chain by its vote,
        a covariance-scaled sample, and the sample's interpretation tree over the chain. Leaves are optimised under the
        temporal prior of a jump, which is flat in the parameters of the chain that jumped. docs/mixture.md.
        """
        rng = self._rng(observation)
        eye = _eye(observation)
        share = JUMP_SHARE if self.chains and eye is not None else 0.0
        votes = [self._votes(component) for component in components]
        leaves = self._leaves(components, votes, eye, rng) if share and eye is not None else {}
        proposals = []
        for i, component in enumerate(components):
            terms = pulled(self.model, component.terms, component.belief, ())
            # where a limb passes through the image plane, its flips are near enough to need no jump
            nearby = [starts for (at, _), starts in leaves.items() if at == i]
            starts = np.concatenate([component.belief.mean[None], *nearby])
            most = max(MIXTURE_DESCENTS // len(components), 2)
            found = self._minima(terms, starts, most, should_stop)
            log = np.log1p(-share) + np.log(max(component.weight, _WEIGHTLESS))
            log += log_normal(component.belief.place_covariance)
            proposals.append(
                _Proposals(found, component.terms, i, "followed", component.belief, float(log))
            )
        for (i, c), starts in leaves.items():
            log = float(np.log(share * max(votes[i][c], _WEIGHTLESS)))
            proposals.append(
                self._jumped(components[i], i, self.chains[c], starts, log, should_stop)
            )
        return self._weighed(proposals, False)

    def _votes(self, component: Component) -> Floats:
        belief, chains = component.belief, [ready.chain for ready in self.chains]
        return chain_votes(self.model, belief.mean, belief.place_covariance, chains)

    def _turned(self, start: Floats) -> Floats:
        """Return (4, P) the start, and turned by quarters about the root's own y axis: who stands may face anywhere."""
        joint = self.model.joint_params(start)
        turns = [np.array([0.0, quarter * np.pi / 2, 0.0]) for quarter in range(4)]
        facing = rotation_matrix(joint[3:6]) @ rotation_matrix(np.array(turns))
        rows = np.tile(joint, (4, 1))
        rows[1:, 3:6] = rotation_vector(facing[1:])
        return np.array([self.model.transform.solver_params(row) for row in rows])

    def speed_of_change(self) -> Floats[P]:
        """Return the unknown acceleration a frame, a standard deviation [m, rad]."""
        prior, strength = self.settings.prior, self.settings.tracker.smoothing
        push = np.full(self._size, np.deg2rad(prior.motion_sigma_deg))
        push[:3] = 1e-3 * prior.motion_sigma_mm
        share = agility(self.model)
        leaders = [np.flatnonzero(column)[:1] for column in self.model.transform.matrix.T]
        push *= [float(share[led[0]]) if len(led) else 1.0 for led in leaders]
        return push / np.sqrt(max(strength, 1e-6))

    def _leaves(
        self,
        components: Sequence[Component],
        votes: Sequence[Floats],
        eye: tuple[Camera, ImageKeypoints | None],
        rng: np.random.Generator,
    ) -> dict[tuple[int, int], Floats]:
        """Return the leaves (N, P) of all draws by component and chain."""
        camera, seen = eye
        targets = _of(self.model, seen)
        weights = np.array([component.weight for component in components])
        leaves: dict[tuple[int, int], list[Floats]] = {}
        mixture = self.settings.mixture
        quick = by_keypoints_alone(components[0].terms)
        draws = mixture.draws if quick else min(mixture.draws, MIXTURE_DESCENTS)
        for i in _drawn(weights / weights.sum(), draws, rng):
            belief = components[i].belief
            c = int(rng.choice(len(self.chains), p=votes[i]))
            sample = covariance_scaled(belief.mean, belief.place_covariance, mixture.scale, 1, rng)
            sample = projected(self.model, sample)[0]
            tree = interpretation_tree(
                self.model, sample, [self.chains[c]], camera, targets, _TREE, rng
            )
            if len(tree):
                leaves.setdefault((int(i), c), []).append(tree.params)
        return {key: np.concatenate(found) for key, found in sorted(leaves.items())}

    def _jumped(
        self,
        component: Component,
        parent: int,
        ready: PreparedChain,
        starts: Floats,
        log_share: float,
        should_stop: Callable[[], bool] | None,
    ) -> _Proposals:
        names = self.model.transform.names
        columns = np.array([names.index(name) for name in ready.chain.parameters])
        low, high = self.model.bounds(component.belief.mean)[columns].T
        ranges = np.clip(high - low, 1e-3, 2.0 * np.pi)
        terms = pulled(self.model, component.terms, component.belief, columns)
        found = self._minima(terms, starts, 1, should_stop)
        others = np.setdiff1d(np.arange(self._size), columns)
        known = component.belief.place_covariance[np.ix_(others, others)]
        log = log_share + np.log(max(component.weight, _WEIGHTLESS)) + log_normal(known)
        log -= float(np.log(ranges).sum())
        spread = np.zeros(self._size)
        spread[columns] = ranges / np.sqrt(12.0)
        belief = component.belief.released(columns, spread, self._speed())
        origin = f"{ready.chain.name} jumped"
        return _Proposals(found, component.terms, parent, origin, belief, float(log))

    def _minima(
        self, terms: FrameTerms, starts: Floats, most: int,
        should_stop: Callable[[], bool] | None, is_far: bool = False,
    ) -> Minima:  # fmt: skip
        return minima(self.model, self.settings.solver, terms, starts, most, should_stop, is_far)

    def _weighed(self, proposals: Sequence[_Proposals], is_first: bool) -> Mixture:
        """Return the distinct minima of largest posterior mass.

        The mass is exp(−cost) times the prior's normalisation times √det(2π C), what the bell of covariance C around the
        minimum holds (Laplace): a wide minimum of the same cost is more probable than a narrow one.
        """
        params = np.concatenate([p.found.params for p in proposals])
        cost = np.concatenate([p.found.cost for p in proposals])
        hessian = np.concatenate([p.found.hessian for p in proposals])
        source = np.repeat(np.arange(len(proposals)), [len(p.found.cost) for p in proposals])
        known = np.asarray(np.flatnonzero(np.isfinite(cost)), dtype=int)
        if not len(known):
            raise HandtrackError(
                f"'{self.model.name}': every pose that was tried lies behind a camera. Look at the first pose and at the "
                "cameras' calibration."
            )
        prior = np.array([p.log_prior for p in proposals])
        log = np.full(len(cost), -np.inf)
        log[known] = prior[source[known]] - cost[known]
        if not is_first:
            volume = 0.5 * self._size * np.log(2.0 * np.pi)
            log[known] += volume - 0.5 * np.linalg.slogdet(hessian[known])[1]
        kept = known[distinct(params[known], -log[known], np.deg2rad(MERGE_DEG))]
        quick = by_keypoints_alone(proposals[0].terms)
        most = self.settings.mixture.carried if quick else 0
        kept = [int(row) for row in kept[self._apart(params[kept], most)]]
        weights = np.exp(log[kept] - log[kept].max())
        weights /= weights.sum()
        hypotheses = []
        for row, weight in zip(kept, weights, strict=True):
            via = proposals[source[row]]
            spread = covariance(hessian[row])[0]
            belief = (
                MotionBelief.at_rest(params[row], spread, self._speed())
                if is_first
                else via.belief.updated(params[row], spread)
            )
            terms = without_memory(via.terms)
            seen = stage_problem(self.model, terms, terms.stages - 1, params[row])
            found = MovingHypothesis(
                params[row], float(cost[row]), spread, float(weight), via.origin, belief,
                seen.linearize(params[row]),
            )  # fmt: skip
            hypotheses.append(with_wrapped_turn(found))
        return Mixture(tuple(hypotheses), tuple(proposals[source[row]].parent for row in kept))

    def _apart(self, params: Floats, carried: int) -> Ints:
        """Return the rows of params (N, P), heaviest first, that are carried on.

        First come those to be shown, which differ in shape (the mean over the joints' distances, the root's place apart):
        what nearly looks like a heavier one is no alternative yet. Then the heaviest of the others: where a limb passes
        through the image plane, alternatives begin as small differences.
        """
        limit = 1e-3 * APART_MM
        shown = self.settings.tracker.hypotheses
        kept: list[int] = []
        shapes: list[Floats] = []
        for row, pose in enumerate(params):
            if len(kept) == shown:
                break
            bones = self.model.bones(pose)
            shape = self.model.joint_positions(bones) - bones.reference
            if all(np.linalg.norm(shape - s, axis=1).mean() >= limit for s in shapes):
                kept.append(row)
                shapes.append(shape)
        others = np.setdiff1d(np.arange(len(params)), kept)
        return np.array([*kept, *others[: max(carried - len(kept), 0)]], dtype=int)

    @property
    def _size(self) -> int:
        return len(self.model.transform.names)

    def _speed(self) -> Floats:
        speed = np.full(self._size, _SPEED_RAD)
        speed[:3] = _SPEED_M
        return speed

    def _rng(self, observation: Observation) -> np.random.Generator:
        return np.random.default_rng([self.settings.tracker.seed, observation.frame])


def _drawn(weights: Floats, draws: int, rng: np.random.Generator) -> Ints:
    """Return which components are drawn: half of the draws in turn, half by weight."""
    turn = np.arange(draws // 2) % len(weights)
    return np.concatenate([turn, rng.choice(len(weights), draws - len(turn), p=weights)])


def _eye(observation: Observation) -> tuple[Camera, ImageKeypoints | None] | None:
    """Return the camera whose lines of sight the flips keep: the one with most keypoints, else the first of the views."""
    images = [seen for seen in observation.keypoints if isinstance(seen, ImageKeypoints)]
    if images:
        best = max(images, key=lambda seen: int(np.isfinite(seen.pixels).all(axis=1).sum()))
        return best.camera, best
    if observation.silhouettes:
        return observation.silhouettes[0].camera, None
    if observation.images:
        return observation.images[0].camera, None
    return None


def _of(model: ArticulatedModel, seen: ImageKeypoints | None) -> Floats | None:
    """Return where the model's joints (J, 2) are seen [px], NaN where they are not."""
    if seen is None:
        return None
    pixels = np.full((len(model.joint_names), 2), np.nan)
    for name, place in zip(seen.names, seen.pixels, strict=True):
        pixels[model.joint_names.index(name)] = place
    return pixels
