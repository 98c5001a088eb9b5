"""Hypotheses of a first frame: minima near the start in any heading, and what the interpretation trees of the best hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from handtrack.arrays import Floats, P
from handtrack.geometry.rotation import rotation_matrix, rotation_vector
from handtrack.sampling.diffusion import covariance_scaled, projected
from handtrack.sampling.hypotheses import distinct
from handtrack.sampling.interpretation_tree import interpretation_tree
from handtrack.solver.covariance import covariance
from handtrack.tracking.frame.constants import MIXTURE_DESCENTS
from handtrack.tracking.frame.frame_terms import FrameTerms
from handtrack.tracking.hypotheses.mixture_landscape import (
    TREE,
    Eye,
    MixtureLandscape,
    Source,
    Start,
)
from handtrack.tracking.hypotheses.mixture_terms import coarse

_LEAVES = 96  # of a tree


@dataclass(frozen=True, eq=False)
class FirstHypotheses(MixtureLandscape):
    """A first frame; see engine.Landscape. From a start that is far off, first as if joints were seen coarsely."""

    terms: FrameTerms
    """what the frame costs, without any pull to an expected pose"""
    start: Floats[P]
    """(P,)"""

    def propose(self, proposer: str, found: Sequence[Start], most: int) -> list[Start]:
        if proposer == "headings, seen coarsely":
            far = Source("start", self.terms, coarse(self.terms), most)
            return self.starts(far, self._turned(most))
        if proposer == "the start and what was found":
            near = Source("start", self.terms, self.terms, len(found))
            return self.starts(near, np.array([self.start, *(c.params for c in found)]))
        assert proposer == "interpretation trees of the best"
        if self.eye is None or not self.chains:
            return []
        source = Source("first tree", self.terms, self.terms, MIXTURE_DESCENTS)
        latest = [c for c in found if c.source is found[-1].source]
        return self.starts(source, self._trees_of_best(latest, self.eye, most))

    def _turned(self, ways: int) -> Floats:
        """Return starts (N, P): the start turned all about the root's own y axis: who stands may face anywhere."""
        joint = self.model.joint_params(self.start)
        turns = np.arange(float(ways))[:, None] * np.array([0.0, 2.0 * np.pi / ways, 0.0])
        facing = rotation_matrix(joint[3:6]) @ rotation_matrix(turns)
        rows = np.tile(joint, (ways, 1))
        rows[1:, 3:6] = rotation_vector(facing[1:])
        return np.array([self.model.transform.solver_params(row) for row in rows])

    def _trees_of_best(self, found: Sequence[Start], eye: Eye, most: int) -> Floats:
        """Return starts (N, P): leaves of the whole body's tree at a few of the best minima, and samples around them."""
        mixture, starts = self.settings.mixture, []
        params, costs = np.array([c.params for c in found]), np.array([c.cost for c in found])
        for row in distinct(params, costs)[:most]:
            here, normal = params[row], found[row].normal
            assert normal is not None
            tree = interpretation_tree(
                self.model, here, self.chains, eye.camera, eye.joints, TREE, self.rng
            )
            leaves = tree.params
            if len(leaves) > _LEAVES:
                leaves = leaves[self.rng.choice(len(leaves), _LEAVES, replace=False)]
            spread = covariance(normal)[0]
            around = covariance_scaled(here, spread, mixture.scale, mixture.draws // 2, self.rng)
            starts += [here[None], leaves, projected(self.model, around)]
        return np.concatenate(starts)
