"""The first frame without a first pose: hands everywhere, the best descend, the rest is told apart by energy."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from handtrack.model.articulated import ArticulatedModel
from handtrack.observation.observation import Observation
from handtrack.terms.keypoints import KeypointTerm
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.search.engine import Candidate, run_rounds
from handtrack.tracking.search.global_search import (
    FIRST_POSE,
    GIVEN_JOINTS,
    GlobalObjective,
    Resize,
)
from handtrack.tracking.search.scores.hand_shapes import hand_shapes
from handtrack.tracking.search.start_confidence import (
    SIZE_SIGMA,
    fit_quality,
    p_in_basin,
    shares,
)

Progress = Callable[[float, str], None]
"""called with the share that is done and what is being done"""


def auto_start(
    models: Sequence[ArticulatedModel],
    settings: TrackerSettings,
    seen: Observation,
    should_stop: Callable[[], bool] | None = None,
    on_progress: Progress | None = None,
    size_sigma: float = SIZE_SIGMA,
    resize: Resize | None = None,
    found: Sequence[Candidate] = (),
) -> list[Candidate]:
    """Return first poses for what was seen of one frame, the surest first; empty where no hand can be seen.

    Looks everywhere: nothing is assumed of position, rotation and posture but that the hand is rather open than closed.

    Parameters
    ----------
    models
        those that may explain it, say without and with a forearm
    size_sigma
        the share to which their size is known
    resize
        makes them in other sizes, where it is not; the best poses then find theirs
    found
        poses by joints in images, of which silhouettes and cloud decide instead of a search over `models`
    """
    report = on_progress or (lambda share, text: None)
    search = GIVEN_JOINTS if found else FIRST_POSE
    control = Control() if should_stop is None else Control(should_stop)
    report(0.0, "looking for the hand")
    count = len(search.rounds)
    objective = GlobalObjective.of(seen, settings)
    if objective is None:
        return []
    objective = replace(
        objective,
        shapes=[shape for model in models for shape in hand_shapes(model)] if models else (),
        resize=resize,
        control=control,
    )
    done = run_rounds(
        search, objective, found, lambda n, tried: report(n / count, f"{tried} poses are tried")
    )
    return _compared(objective, done, size_sigma, search.most)


def _compared(
    objective: GlobalObjective,
    done: Sequence[Candidate],
    size_sigma: float,
    most: int,
) -> list[Candidate]:
    """Return the best distinct poses among finished ones, at most so many, and how sure each is."""
    kept = objective.distinct([c for c in done if c.solved is not None], most)
    if not kept:
        return []
    settings = objective.settings
    kept = sorted(objective.compared(kept), key=lambda c: c.cost)
    quality = fit_quality(kept[0].model, settings, objective.observation, kept[0].params)
    count = objective.independent_errors(kept[0])
    share = shares(np.array([c.cost for c in kept]), count)
    found = []
    for candidate, part in zip(kept, share, strict=True):
        problem = objective.narrow_problem(candidate)
        given = [
            KeypointTerm(candidate.model, joints) for joints in objective.observation.keypoints
        ]
        problem = replace(problem, observation_terms=[*problem.observation_terms, *given])
        near = p_in_basin(problem, candidate.params, count, size_sigma, settings.tracker.seed)
        found.append(replace(candidate, confidence=float(quality * part * near), p_in_basin=near))
    return found
