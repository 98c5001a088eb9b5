"""Several hypotheses carried over time (2003 paper, §4; docs/how-to/one_camera.md): where starts come from, to which minima they lead, what
those weigh, and which are carried on.

Of a first frame: minima near the start in any heading, and what the interpretation trees of the best hold. Of every other: each
hypothesis followed, and jumped along chains that votes name.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby, islice

import numpy as np

from handtrack.arrays import D2, Floats, Ints, J, K, N, P, array_dataclass, indices
from handtrack.errors import HandtrackError
from handtrack.geometry.camera import Camera
from handtrack.geometry.rotation import closest_equivalent, rotation_matrix, rotation_vector
from handtrack.model.articulated import ArticulatedModel
from handtrack.sampling.chains import Chain, chain_votes, chains_of
from handtrack.sampling.diffusion import covariance_scaled, long_tailed, projected
from handtrack.sampling.interpretation_tree import interpretation_tree
from handtrack.sampling.suppression import apart_joints
from handtrack.solver.covariance import covariance
from handtrack.solver.levenberg_marquardt import SolveSummary
from handtrack.terms.priors import CorrelatedPrior, GaussianPrior, LinearPrior
from handtrack.terms.term import ParameterTerm
from handtrack.tracking.frame.constants import APART_MM, JUMP_SHARE, MERGE_DEG, MIXTURE_DESCENTS
from handtrack.tracking.frame.control import Round, Search, Tried
from handtrack.tracking.frame.descent import by_keypoints_alone, minima, stage_problem
from handtrack.tracking.frame.frame_task import FrameTask
from handtrack.tracking.frame.frame_terms import FrameTerms
from handtrack.tracking.frame.motion_belief import MotionBelief, unknown_speed
from handtrack.tracking.frame.result import Alternative, Step
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.frame.terms.priors import agility, motion_sigma
from handtrack.tracking.search.engine import Candidate, differing, report, run_rounds

_COARSE = 10.0  # times sigma, of a first frame's joints: a wide basin
_MEMORY_FRAMES = 10.0  # over about so many frames a belief remembers, so each counts this share of the static priors
_LEAVES = 96  # of a tree
WEIGHTLESS = np.finfo(float).tiny


@array_dataclass
class Source:
    """Where some starts come from, and what is known there before the frame is seen. A component is one: a hypothesis of the last frame
    moved to where it is expected now, its terms without the pull to it; of a first frame what it costs without any pull.
    """

    origin: str
    terms: FrameTerms
    """whose minima are sought: what the frame costs, pulled to the expected pose, or seen coarsely"""
    most: int
    """of the starts that descend, where the frame is not solved by keypoints alone"""
    belief: MotionBelief | None = None
    """None in a first frame"""
    parent: int = -1
    """hypothesis of the last frame; −1 in a first frame"""
    log_prior: float = 0.0
    """log of the weight, and of the prior's normalisation where the terms pull"""

    @property
    def predicted(self) -> MotionBelief:
        """Where the hand is expected, in a frame after others."""
        assert self.belief is not None
        return self.belief


@dataclass(frozen=True, eq=False, kw_only=True)
class Start(Candidate):
    """A start, or the minimum that it led to; its cost is −log of what the minimum weighs."""

    source: Source
    energy: float = np.inf
    """½ Σ r², priors included"""


@array_dataclass
class MixtureObjective(FrameTask):
    """A frame of which several hypotheses are looked for; see engine.Objective. docs/how-to/one_camera.md.

    A first frame begins far off, first as if joints were seen coarsely. In all others each component is optimised from where it is
    expected. Then components are drawn; of each, a chain by its vote, a covariance-scaled sample, and the sample's interpretation tree
    over the chain. Leaves are optimised under the temporal prior of a jump, which is flat in the parameters of the chain that jumped.
    """

    components: Sequence[Source] = ()
    """hypotheses of the last frame; of a first frame one without a belief"""

    @property
    def is_first(self) -> bool:
        """Whether no frame came before."""
        return self.components[0].belief is None

    @property
    def chains(self) -> Sequence[Chain]:
        """Along which poses are flipped."""
        return chains_of(self.model, self.settings.mixture.chains)

    @cached_property
    def rng(self) -> np.random.Generator:
        return np.random.default_rng([self.settings.tracker.seed, self.observation.frame])

    @cached_property
    def reference(self) -> tuple[Camera, Floats[J, D2] | None] | None:
        """The camera whose lines of sight the flips keep: the one with most keypoints, else the first of the views; and where it sees the
        model's joints [px], NaN where it does not.
        """
        if images := self.observation.image_keypoints:
            names = self.model.joint_names
            most = max(images, key=lambda seen: int(np.isfinite(seen.pixels).sum()))
            joints = np.full((len(names), 2), np.nan)
            joints[indices(names, most.names)] = most.pixels
            return most.camera, joints
        views = self.observation.silhouettes or self.observation.images
        return (views[0].camera, None) if views else None

    def starts(self, source: Source, params: Floats[N, P]) -> list[Start]:
        """Return a start at each of params (N, P)."""
        return [Start(self.model, x, origin=source.origin, source=source) for x in params]

    def minimum(self, candidates: Sequence[Start], iterations: int) -> list[Start]:
        """Optimise by the frame's schedule; for image joints alone all starts at once by the compiled solver."""
        found: list[Start] = []
        for _, group in groupby(candidates, key=lambda c: id(c.source)):
            first, *others = group
            starts, source = np.array([c.params for c in (first, *others)]), first.source
            is_far, stop = source.belief is None, self.control.should_stop
            ended = minima(source.terms, starts, source.most, stop, is_far)
            minimum = self._by_mass(source, *ended)
            if self.settings.traits.closest_prior and not self.is_first:
                minimum = self._by_closest_density(minimum)
            found += minimum
        return found

    def _by_mass(
        self, source: Source, params: Floats[N, P], cost: Floats[N], normal: Floats[N, P, P]
    ) -> list[Start]:
        """Return the minima that a source's starts led to, with what they weigh.

        The mass is exp(−cost) times the prior's normalisation times √det(2π C), what the Gaussian of covariance C around the
        minimum holds (Laplace): a wide minimum of the same cost is more probable than a narrow one. Nothing came before a
        first frame: there costs alone decide.
        """
        known = np.isfinite(cost)
        log = np.where(known, source.log_prior - cost, -np.inf)
        if source.belief is not None:
            volume = 0.5 * params.shape[1] * np.log(2.0 * np.pi)
            log[known] += volume - 0.5 * np.linalg.slogdet(normal[known])[1]
        return [
            Start(
                self.model,
                params[n],
                -float(log[n]),
                source.origin,
                normal=normal[n],
                source=source,
                energy=float(cost[n]),
            )
            for n in range(len(log))
        ]

    def distinct(self, candidates: Sequence[Start], most: int) -> list[Start]:
        return differing(candidates, most, np.deg2rad(MERGE_DEG))

    def coarse_headings(self, found: Sequence[Start], most: int) -> list[Start]:
        """Propose the start at headings all around the root's y axis, with image joints of ten times the standard deviation."""
        joint = self.model.joint_params(self.start)
        turns = np.arange(float(most))[:, None] * np.array([0.0, 2.0 * np.pi / most, 0.0])
        facing = rotation_matrix(joint[3:6]) @ rotation_matrix(turns)
        rows = np.tile(joint, (most, 1))
        rows[1:, 3:6] = rotation_vector(facing[1:])
        far = Source("start", self.components[0].terms.coarser(_COARSE), most)
        return self.starts(far, np.array([self.model.solver_params(row) for row in rows]))

    def start_and_candidates(self, found: Sequence[Start], most: int) -> list[Start]:
        """Propose the start and all candidates so far."""
        near = replace(self.components[0], most=len(found))
        return self.starts(near, np.array([self.start, *(c.params for c in found)]))

    def interpretation_trees_of_best(self, found: Sequence[Start], most: int) -> list[Start]:
        """Propose the interpretation trees of the best minima, and samples around these minima."""
        if not self.chains or self.reference is None:
            return []
        mixture, starts = self.settings.mixture, list[Floats]()
        latest = [c for c in found if c.source is found[-1].source]
        for best in differing(latest, most):
            here, normal = best.params, best.normal
            assert normal is not None
            leaves = interpretation_tree(
                self.model, here, self.chains, *self.reference, True, self.rng
            )
            if len(leaves) > _LEAVES:
                leaves = leaves[self.rng.choice(len(leaves), _LEAVES, replace=False)]
            around = covariance_scaled(
                here,
                covariance(normal)[0],
                mixture.scale,
                mixture.draws // 2,
                self.rng.standard_normal,
            )
            starts += [here[None], leaves, projected(self.model, around)]
        source = replace(self.components[0], origin="first tree")
        return self.starts(source, np.concatenate(starts))

    def motion_prediction(self, found: Sequence[Start], most: int) -> list[Start]:
        """Propose each hypothesis of the last frame, moved by its predicted motion."""
        return [start for source in self.components for start in self._followed(source)]

    def kinematic_jumps(self, found: Sequence[Start], most: int) -> list[Start]:
        """Propose kinematic jumps: hypotheses sampled by weight, flipped in depth along chains sampled by covariance."""
        return [
            start
            for (i, c), params in self._leaves.items()
            for start in self.starts(self._jump(i, c), params)
        ]

    @property
    def _jump_share(self) -> float:
        return JUMP_SHARE if self.chains and self.reference is not None else 0.0

    def _followed(self, component: Source) -> list[Start]:
        belief = component.predicted
        if self.settings.traits.closest_prior:
            return self.starts(component, belief.mean[None])
        log = np.log1p(-self._jump_share) + component.log_prior
        log += log_normal(belief.place_covariance)
        terms = pulled(self.model, component.terms, belief, ())
        source = replace(component, terms=terms, log_prior=float(log))
        # where a limb passes through the image plane, its flips are near enough to need no jump
        nearby = [params for (i, _), params in self._leaves.items() if i == component.parent]
        return self.starts(source, np.concatenate([belief.mean[None], *nearby]))

    def _jump(self, i: int, c: int) -> Source:
        """Return the source of starts in which a component's chain is anywhere within its limits."""
        component, chain = self.components[i], self.chains[c]
        model, belief, names = self.model, component.predicted, self.model.transform.names
        jumped = replace(component, origin=f"{chain.name} jumped", most=1)
        if self.settings.traits.closest_prior:
            return jumped
        columns = np.array(indices(names, chain.parameters))
        low, high = model.bounds(belief.mean)[columns].T
        ranges = np.clip(high - low, 1e-3, 2.0 * np.pi)
        others = np.setdiff1d(np.arange(len(names)), columns)
        known = belief.place_covariance[np.ix_(others, others)]
        log = float(np.log(self._jump_share * max(self._votes[i][c], WEIGHTLESS)))
        log += component.log_prior + log_normal(known)
        log -= float(np.log(ranges).sum())
        spread = np.zeros(len(names))
        spread[columns] = ranges / np.sqrt(12.0)
        return replace(
            jumped,
            terms=pulled(model, component.terms, belief, columns),
            belief=belief.released(columns, spread, unknown_speed(len(names))),
            log_prior=float(log),
        )

    def _by_closest_density(self, found: Sequence[Start]) -> list[Start]:
        """Return minima with what they weigh by the density that is closest to where they end, wherever they were come by.

        That is the 2003 paper's (fig. 4, step 5): exp(−cost) times weight and height of the long-tailed density of the last
        frame that is closest by Mahalanobis' distance.
        """
        params = np.array([one.params for one in found])
        heights, distances = zip(*(self._density(c, params) for c in self.components), strict=True)
        closest = np.argmin(distances, axis=0)
        return [
            replace(
                one,
                cost=one.energy - float(heights[i][n]),
                source=replace(one.source, parent=int(i), belief=None),
            )
            for n, (one, i) in enumerate(zip(found, closest, strict=True))
        ]

    def _density(self, component: Source, params: Floats) -> tuple[Floats, Floats]:
        """Return the log of a component's weight and height at params (N, P), and squared distances to it (N,)."""
        belief, params = component.predicted, params.copy()
        for row in params:
            row[3:6] = closest_equivalent(row[3:6], belief.mean[3:6])
        height, distance = long_tailed(belief.mean, belief.place_covariance, params)
        return component.log_prior + height, distance

    @cached_property
    def _votes(self) -> list[Floats]:
        """Of each component (C,) how probable it is that each chain jumps."""
        return [
            chain_votes(self.model, c.predicted.mean, c.predicted.place_covariance, self.chains)
            for c in self.components
        ]

    @cached_property
    def _leaves(self) -> dict[tuple[int, int], Floats]:
        """The leaves (N, P) of all draws by component and chain."""
        reference, mixture = self.reference, self.settings.mixture
        if not self._jump_share or reference is None:
            return {}
        weights = np.exp([component.log_prior for component in self.components])
        leaves: dict[tuple[int, int], list[Floats]] = {}
        quick = by_keypoints_alone(self.components[0].terms)
        draws = mixture.draws if quick else min(mixture.draws, MIXTURE_DESCENTS)
        for i in _drawn(weights / weights.sum(), draws, self.rng):
            belief = self.components[i].predicted
            c = int(self.rng.choice(len(self.chains), p=self._votes[i]))
            sample = covariance_scaled(
                belief.mean, belief.place_covariance, mixture.scale, 1, self.rng.standard_normal
            )
            sample = projected(self.model, sample)[0]
            tree = interpretation_tree(
                self.model,
                sample,
                [self.chains[c]],
                *reference,
                True,
                self.rng,
            )
            if len(tree):
                leaves.setdefault((int(i), c), []).append(tree)
        return {key: np.concatenate(found) for key, found in sorted(leaves.items())}


def _drawn(weights: Floats, draws: int, rng: np.random.Generator) -> Ints:
    """Return which components are drawn: half of the draws in turn, half by weight."""
    turn = np.arange(draws // 2) % len(weights)
    return np.concatenate([turn, rng.choice(len(weights), draws - len(turn), p=weights)])


FIRST_HYPOTHESES = Search(
    situation="multiple hypotheses, first frame",
    when="`tracker.hypotheses` above 1",
    rounds=(
        Round(
            ((MixtureObjective.coarse_headings, 4),),
            fits=((MixtureObjective.minimum, 0),),
        ),
        Round(
            ((MixtureObjective.start_and_candidates, 0),),
            keep=0,
            fits=((MixtureObjective.minimum, 0),),
        ),
        Round(
            ((MixtureObjective.interpretation_trees_of_best, 6),),
            adds=True,
            fits=((MixtureObjective.minimum, 0),),
            times=3,
        ),
    ),
    measure="cost",
    margin=1.0,
    taken="distinct minima, the heaviest by exp(−cost)",
)
NEXT_HYPOTHESES = Search(
    situation="multiple hypotheses, later frames",
    when="`tracker.hypotheses` above 1",
    rounds=(
        Round(
            (
                (MixtureObjective.motion_prediction, 0),
                (MixtureObjective.kinematic_jumps, 0),
            ),
            fits=((MixtureObjective.minimum, 0),),
        ),
    ),
    measure="−log of the posterior weight: exp(−cost) × prior × width of the minimum (Laplace)",
    taken="distinct minima of largest weight",
)


def pulled(
    model: ArticulatedModel, terms: FrameTerms, belief: MotionBelief, free: Sequence[int] | Ints[K]
) -> FrameTerms:
    """Return the terms with the pull to where a belief expects the pose, but for the columns that are free."""
    others = np.setdiff1d(np.arange(len(belief.mean)), np.asarray(free, dtype=int))
    information = np.zeros((len(belief.mean), len(belief.mean)))
    inner = belief.place_covariance[np.ix_(others, others)]
    information[np.ix_(others, others)] = np.linalg.inv(inner)
    back = np.linalg.pinv(model.transform.matrix)
    information = back.T @ (0.5 * (information + information.T)) @ back
    prior = CorrelatedPrior(model.joint_params(belief.mean), information)
    known = without_memory(terms)
    return replace(known, priors=(*known.priors, prior))


def without_memory(terms: FrameTerms) -> FrameTerms:
    """Return the terms as one frame of many counts them: static priors, and joints in images whose errors last."""
    seen = terms.coarser(terms.settings.traits.new_share**-0.5)
    return replace(seen, priors=tuple(map(_shared_out, terms.priors)))


def _shared_out(prior: ParameterTerm) -> ParameterTerm:
    """Return what is known of poses as one frame of many counts it: the belief already holds it from those before."""
    if isinstance(prior, GaussianPrior):
        return replace(prior, sigma=prior.sigma * np.sqrt(_MEMORY_FRAMES))
    if isinstance(prior, LinearPrior):
        return replace(prior, weight=prior.weight / _MEMORY_FRAMES)
    return prior


def log_normal(spread: Floats[P, P]) -> float:
    """Return the log of a Gaussian's height at its mean, −½ log det(2π C)."""
    return -0.5 * float(np.linalg.slogdet(spread)[1] + len(spread) * np.log(2.0 * np.pi))


# ---- hypotheses carried over time


def searched(
    objective: MixtureObjective,
) -> tuple[tuple[MotionBelief, ...], tuple[Alternative, ...]]:
    """Return the hypotheses of a frame, the heaviest of the distinct minima that are found, with the motion of each."""
    search, why = NEXT_HYPOTHESES, f"carried on: {len(objective.components)}"
    if objective.is_first:
        search, why = FIRST_HYPOTHESES, "a first frame"
    tried: Tried = []
    found = run_rounds(search, objective, (), tried=tried)
    found = [c for c in found if np.isfinite(c.cost)]
    if not found:
        raise HandtrackError(
            f"'{objective.model.name}': every pose that was tried lies behind a camera. Look at the first pose and at the "
            "cameras' calibration."
        )
    kept = _carried(objective, objective.distinct(found, len(found)))
    report(search, objective.control, objective.observation.frame, why, tried, kept[0])
    cost = np.array([c.cost for c in kept])
    weights = np.exp(cost.min() - cost)
    weights /= weights.sum()
    hypotheses = [_hypothesis(c, float(w)) for c, w in zip(kept, weights, strict=True)]
    beliefs, alternatives = zip(*hypotheses, strict=True)
    return beliefs, alternatives


def _carried(objective: MixtureObjective, found: Sequence[Start]) -> list[Start]:
    """Return those of the distinct minima, heaviest first, that are carried on.

    First come those to be shown, which differ in shape (the mean over the joints' distances, the root's place apart):
    what nearly looks like a heavier one is no alternative yet. Then the heaviest of the others: where a limb passes
    through the image plane, alternatives begin as small differences.
    """
    model, settings = objective.model, objective.settings
    bones = [model.bones(c.params) for c in found]
    shapes = np.array([model.joint_positions(b) - b.reference for b in bones])
    limit = 0.0 if settings.traits.closest_prior else 1e-3 * APART_MM
    differing = apart_joints(range(len(found)), shapes, limit)
    shown = list(islice(differing, settings.tracker.hypotheses))
    others = [n for n in range(len(found)) if n not in shown]
    quick = by_keypoints_alone(found[0].source.terms)
    more = max(settings.mixture.carried - len(shown), 0) if quick else 0
    return [found[n] for n in [*shown, *others[:more]]]


def _hypothesis(found: Start, weight: float) -> tuple[MotionBelief, Alternative]:
    """Return a minimum's motion, and the minimum as a frame's result has it."""
    params, source = found.params, found.source
    assert found.normal is not None
    spread = covariance(found.normal)[0]
    belief = (
        MotionBelief.at_rest(params, spread, unknown_speed(len(params)))
        if source.belief is None
        else source.belief.updated(params, spread)
    )
    belief = belief.with_wrapped_turn()
    joint = found.model.joint_params(belief.mean)
    return belief, Alternative(joint, found.energy, weight, source.parent, source.origin)


def speed_of_change(model: ArticulatedModel, settings: TrackerSettings) -> Floats[P]:
    """Return (P,) the unknown acceleration a frame, a standard deviation [m, rad]."""
    push = motion_sigma(settings.prior, len(model.transform.names))
    push *= agility(model)[list(model.driving_joints)]
    return push / np.sqrt(max(settings.tracker.smoothing, 1e-6))


def solve_mixture(task: FrameTask) -> Step:
    """Return a frame at the heaviest of the hypotheses that explain it, and all that are carried on; where nothing is seen they stay as
    they are.
    """
    params, terms = task.opened()
    carried = task.state.beliefs
    known = task.previous[-1].alternatives if carried else ()
    if not terms.has_observations:
        held = tuple(replace(one, parent=n) for n, one in enumerate(known))
        return _with_alternatives(task.unseen(), carried, held)
    components = list[Source]()
    most = max(MIXTURE_DESCENTS // max(len(carried), 1), 2)
    push = speed_of_change(task.model, task.settings)
    goes_on = task.settings.tracker.prediction == "constant_velocity"
    for n, (belief, one) in enumerate(zip(carried, known, strict=True)):
        texture = task.state.texture
        texture = texture and replace(texture, bones=task.model.bones(belief.mean))
        state = replace(task.state, texture=texture)
        ahead = belief.ahead(push, max(task.ahead, 1), goes_on)
        ahead = replace(ahead, mean=task.model.clipped(ahead.mean))
        seen = replace(task, expected=None, state=state).terms(ahead.mean)
        log = float(np.log(max(one.weight, WEIGHTLESS)))
        components.append(Source("followed", seen, most, ahead, n, log))
    if not components:
        components = [Source("start", terms.without_motion(), MIXTURE_DESCENTS)]
    about = vars(task) | {"start": params, "components": components}
    beliefs, alternatives = searched(MixtureObjective(**about))
    best, terms = beliefs[0].mean, components[alternatives[0].parent].terms
    problem = stage_problem(terms, best)
    found = SolveSummary(best, 0, "converged", problem.linearize(best))
    solved = task.solved(terms, found, problem)
    return _with_alternatives(solved, beliefs, alternatives)


def _with_alternatives(
    solved: Step, beliefs: tuple[MotionBelief, ...], alternatives: tuple[Alternative, ...]
) -> Step:
    result = replace(solved.result, alternatives=alternatives)
    return replace(solved, result=result, beliefs=beliefs)
