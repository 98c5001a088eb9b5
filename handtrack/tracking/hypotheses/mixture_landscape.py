"""A frame with several hypotheses as the search engine sees it: where starts come from, to which minima they lead, what those weigh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from handtrack.arrays import D2, Floats, J, N, P
from handtrack.geometry.camera import Camera
from handtrack.model.articulated import ArticulatedModel
from handtrack.observation.observation import ImageKeypoints, Observation
from handtrack.sampling.chains import PreparedChain
from handtrack.sampling.hypotheses import distinct
from handtrack.sampling.interpretation_tree import TreeSettings
from handtrack.tracking.frame.constants import MERGE_DEG
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.descent import Minima, minima
from handtrack.tracking.frame.frame_terms import FrameTerms
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.hypotheses.motion_belief import MotionBelief
from handtrack.tracking.search.engine import Candidate, Fit

TREE = TreeSettings(failing="nearest", stretched="sample")


@dataclass(frozen=True, eq=False)
class Source:
    """Where some starts come from, and what is known there before the frame is seen."""

    origin: str
    terms: FrameTerms
    """what the frame costs, without any pull to the expected pose"""
    sought: FrameTerms
    """the terms whose minima are sought: the same, pulled or seen coarsely"""
    most: int
    """of the starts that descend, where the frame is not solved by keypoints alone"""
    belief: MotionBelief | None = None
    """None in a first frame"""
    parent: int = -1
    """hypothesis of the last frame; −1 in a first frame"""
    log_prior: float = 0.0
    """log of the weight and of the prior's normalisation"""


@dataclass(frozen=True, eq=False, kw_only=True)
class Start(Candidate):
    """A start, or the minimum that it led to; its cost is −log of what the minimum weighs."""

    source: Source
    energy: float = np.inf
    """½ Σ r², priors included"""


@dataclass(frozen=True, eq=False)
class Eye:
    """The camera whose lines of sight the flips keep: the one with most keypoints, else the first of the views."""

    camera: Camera
    joints: Floats[J, D2] | None
    """where the model's joints are seen [px], NaN where they are not"""

    @classmethod
    def of(cls, model: ArticulatedModel, observation: Observation) -> Eye | None:
        images = [seen for seen in observation.keypoints if isinstance(seen, ImageKeypoints)]
        if images:
            most = max(images, key=lambda seen: int(np.isfinite(seen.pixels).sum()))
            joints = np.full((len(model.joint_names), 2), np.nan)
            joints[[model.joint_names.index(name) for name in most.names]] = most.pixels
            return cls(most.camera, joints)
        views = observation.silhouettes or observation.images
        return cls(views[0].camera, None) if views else None


@dataclass(frozen=True, eq=False)
class MixtureLandscape:
    """What first frames and all others share; see engine.Landscape."""

    model: ArticulatedModel
    settings: TrackerSettings
    chains: Sequence[PreparedChain]
    eye: Eye | None
    rng: np.random.Generator

    def starts(self, source: Source, params: Floats[N, P]) -> list[Start]:
        """Return a start at each of params (N, P)."""
        return [Start(self.model, x, origin=source.origin, source=source) for x in params]

    def fit(self, fit: Fit, candidates: Sequence[Start], control: Control) -> list[Start]:
        """Return the minima that starts lead to: those of one source together."""
        groups = [list(group) for _, group in groupby(candidates, key=lambda c: id(c.source))]
        return [found for group in groups for found in self._minima(group, control)]

    def _minima(self, group: Sequence[Start], control: Control) -> list[Start]:
        """Return minima with what they weigh.

        The mass is exp(−cost) times the prior's normalisation times √det(2π C), what the bell of covariance C around the
        minimum holds (Laplace): a wide minimum of the same cost is more probable than a narrow one. Nothing came before a
        first frame: there costs alone decide.
        """
        source, model, is_first = group[0].source, self.model, group[0].source.belief is None
        found = minima(
            model, self.settings.solver, source.sought, np.array([c.params for c in group]),
            source.most, control.should_stop, is_far=is_first,
        )  # fmt: skip
        return self.weighed(source, found)

    def weighed(self, source: Source, found: Minima) -> list[Start]:
        """Return the minima that a source's starts led to, with what they weigh."""
        known = np.isfinite(found.cost)
        log = np.where(known, source.log_prior - found.cost, -np.inf)
        if source.belief is not None:
            volume = 0.5 * found.params.shape[1] * np.log(2.0 * np.pi)
            log[known] += volume - 0.5 * np.linalg.slogdet(found.hessian[known])[1]
        return [self.minimum(source, found, n, float(log[n])) for n in range(len(log))]

    def minimum(self, source: Source, found: Minima, n: int, log: float) -> Start:
        """Return one of the minima, with the log of what it weighs."""
        return Start(
            self.model, found.params[n], -log, source.origin,
            normal=found.hessian[n], source=source, energy=float(found.cost[n]),
        )  # fmt: skip

    def distinct(self, candidates: Sequence[Start], most: int) -> list[Start]:
        params = np.array([c.params for c in candidates])
        rows = distinct(params, np.array([c.cost for c in candidates]), np.deg2rad(MERGE_DEG))
        return [candidates[row] for row in rows[:most]]
