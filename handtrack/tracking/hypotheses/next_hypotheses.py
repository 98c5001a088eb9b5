"""Hypotheses of every frame but the first: each one followed, and jumped along chains that votes name (2003 paper, §4)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from handtrack.arrays import Floats, Ints
from handtrack.geometry.rotation import closest_equivalent
from handtrack.sampling.chain_vote import chain_votes
from handtrack.sampling.diffusion import covariance_scaled, long_tailed, projected
from handtrack.sampling.interpretation_tree import interpretation_tree
from handtrack.tracking.frame.constants import JUMP_SHARE, MIXTURE_DESCENTS
from handtrack.tracking.frame.descent import Minima, by_keypoints_alone
from handtrack.tracking.frame.frame_terms import FrameTerms
from handtrack.tracking.hypotheses.mixture_landscape import TREE, MixtureLandscape, Source, Start
from handtrack.tracking.hypotheses.mixture_terms import log_normal, pulled
from handtrack.tracking.hypotheses.motion_belief import MotionBelief, unknown_speed

_WEIGHTLESS = np.finfo(float).tiny


@dataclass(frozen=True, eq=False)
class Component:
    """One bell of the temporal prior: a hypothesis of the last frame moved to where it is expected now."""

    belief: MotionBelief
    terms: FrameTerms
    """what the frame costs, without any pull to the expected pose"""
    weight: float


@dataclass(frozen=True, eq=False)
class NextHypotheses(MixtureLandscape):
    """A frame after others; see engine.Landscape. docs/explanation/one_camera.md.

    Each component is optimised from where it is expected. Then components are drawn; of each, a chain by its vote,
    a covariance-scaled sample, and the sample's interpretation tree over the chain. Leaves are optimised under the
    temporal prior of a jump, which is flat in the parameters of the chain that jumped.
    """

    components: Sequence[Component]

    def propose(self, proposer: str, found: Sequence[Start], most: int) -> list[Start]:
        if proposer == "each followed":
            return [start for i in range(len(self.components)) for start in self._followed(i)]
        assert proposer == "each jumped along chains"
        return [
            start
            for (i, c), params in self._leaves.items()
            for start in self.starts(self._jump(i, c), params)
        ]

    @property
    def _jump_share(self) -> float:
        return JUMP_SHARE if self.chains and self.eye is not None else 0.0

    def _followed(self, i: int) -> list[Start]:
        component = self.components[i]
        belief = component.belief
        if self.settings.traits.closest_prior:
            most = max(MIXTURE_DESCENTS // len(self.components), 2)
            source = Source("followed", component.terms, component.terms, most, belief, i)
            return self.starts(source, belief.mean[None])
        log = np.log1p(-self._jump_share) + np.log(max(component.weight, _WEIGHTLESS))
        log += log_normal(belief.place_covariance)
        source = Source(
            "followed", component.terms, pulled(self.model, component.terms, belief, ()),
            max(MIXTURE_DESCENTS // len(self.components), 2), belief, i, float(log),
        )  # fmt: skip
        # where a limb passes through the image plane, its flips are near enough to need no jump
        nearby = [params for (at, _), params in self._leaves.items() if at == i]
        return self.starts(source, np.concatenate([belief.mean[None], *nearby]))

    def _jump(self, i: int, c: int) -> Source:
        """Return the source of starts in which a component's chain is anywhere within its limits."""
        component, chain = self.components[i], self.chains[c].chain
        model, belief, names = self.model, component.belief, self.model.transform.names
        if self.settings.traits.closest_prior:
            return Source(f"{chain.name} jumped", component.terms, component.terms, 1, belief, i)
        columns = np.array([names.index(name) for name in chain.parameters])
        low, high = model.bounds(belief.mean)[columns].T
        ranges = np.clip(high - low, 1e-3, 2.0 * np.pi)
        others = np.setdiff1d(np.arange(len(names)), columns)
        known = belief.place_covariance[np.ix_(others, others)]
        log = float(np.log(self._jump_share * max(self._votes[i][c], _WEIGHTLESS)))
        log += np.log(max(component.weight, _WEIGHTLESS)) + log_normal(known)
        log -= float(np.log(ranges).sum())
        spread = np.zeros(len(names))
        spread[columns] = ranges / np.sqrt(12.0)
        return Source(
            f"{chain.name} jumped", component.terms, pulled(model, component.terms, belief, columns), 1,
            belief.released(columns, spread, unknown_speed(len(names))), i, float(log),
        )  # fmt: skip

    def weighed(self, source: Source, found: Minima) -> list[Start]:
        """Return minima with what they weigh: by where they come from, or by the bell that is closest to where they end.

        The second is the 2003 paper's (fig. 4, step 5): exp(−cost) times weight and height of the long-tailed bell of the last
        frame that is closest by Mahalanobis' distance, wherever a minimum was come by.
        """
        if not self.settings.traits.closest_prior:
            return super().weighed(source, found)
        heights, distances = zip(
            *(self._bell(c, found.params) for c in self.components), strict=True
        )
        closest = np.argmin(distances, axis=0)
        return [
            self.minimum(
                replace(source, parent=int(i), belief=None),
                found, n, -float(found.cost[n]) + float(heights[i][n]),
            )
            for n, i in enumerate(closest)
        ]  # fmt: skip

    def _bell(self, component: Component, params: Floats) -> tuple[Floats, Floats]:
        """Return the log of a component's weight and height at params (N, P), and squared distances to it (N,)."""
        belief, params = component.belief, params.copy()
        for row in params:
            row[3:6] = closest_equivalent(row[3:6], belief.mean[3:6])
        height, distance = long_tailed(belief.mean, belief.place_covariance, params)
        return np.log(max(component.weight, _WEIGHTLESS)) + height, distance

    @cached_property
    def _votes(self) -> list[Floats]:
        """Of each component (C,) how probable it is that each chain jumps."""
        chains = [ready.chain for ready in self.chains]
        return [
            chain_votes(self.model, c.belief.mean, c.belief.place_covariance, chains)
            for c in self.components
        ]

    @cached_property
    def _leaves(self) -> dict[tuple[int, int], Floats]:
        """The leaves (N, P) of all draws by component and chain."""
        eye, mixture = self.eye, self.settings.mixture
        if not self._jump_share or eye is None:
            return {}
        weights = np.array([component.weight for component in self.components])
        leaves: dict[tuple[int, int], list[Floats]] = {}
        quick = by_keypoints_alone(self.components[0].terms)
        draws = mixture.draws if quick else min(mixture.draws, MIXTURE_DESCENTS)
        for i in _drawn(weights / weights.sum(), draws, self.rng):
            belief = self.components[i].belief
            c = int(self.rng.choice(len(self.chains), p=self._votes[i]))
            sample = covariance_scaled(
                belief.mean, belief.place_covariance, mixture.scale, 1, self.rng
            )
            sample = projected(self.model, sample)[0]
            tree = interpretation_tree(
                self.model, sample, [self.chains[c]], eye.camera, eye.joints, TREE, self.rng
            )
            if len(tree):
                leaves.setdefault((int(i), c), []).append(tree.params)
        return {key: np.concatenate(found) for key, found in sorted(leaves.items())}


def _drawn(weights: Floats, draws: int, rng: np.random.Generator) -> Ints:
    """Return which components are drawn: half of the draws in turn, half by weight."""
    turn = np.arange(draws // 2) % len(weights)
    return np.concatenate([turn, rng.choice(len(weights), draws - len(turn), p=weights)])
