"""A person's hand size from what was seen: scale and poses of several frames fitted together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from handtrack.arrays import Floats, P
from handtrack.model.articulated import ArticulatedModel, HandScale
from handtrack.model.size import SizeParameters
from handtrack.observation.observation import Observation
from handtrack.solver.problem import Problem
from handtrack.tracking.frame.constants import POINTS_LAST
from handtrack.tracking.frame.frame_terms import frame_terms
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.size.sized_problem import fit_size

# narrow: the antisymmetric ramp makes radii r too small by w²/6r, 0.04 mm for a finger at the last
SIZE_BANDS_MM = (4.0, 1.5)
_POSE_ITERATIONS = 15
_USUAL_SIZES = 6  # tried with each band, about: only for telling how far it is
_LEAST_GAIN = 0.5  # [log-likelihood] what another step must bring: less is not known


def refine_scale(
    build: Callable[[HandScale], ArticulatedModel],
    settings: TrackerSettings,
    scale: HandScale,
    observations: Sequence[Observation],
    poses: Sequence[Floats[P]],
    should_stop: Callable[[], bool] | None = None,
    parts: bool = True,
    tell: Callable[[float, str], None] | None = None,
    seen: tuple[str, ...] = (),
    sizes: bool = True,
) -> HandScale:
    """Return the hand that explains the frames best, from `scale` on, with the poses moving along.

    poses: solver parameters of each observation, already tracked. Adults' spread is the prior. parts: fingers and
    forearm have sizes of their own; otherwise they keep those they have, and all grow together. tell: is called with
    the share that is done, 0 to 1, and what is done in words, after each frame that was fitted to a size. seen: joints of
    which it is found too where a detector sees them; sizes: if not, this alone is found.
    """
    usual = _USUAL_SIZES * len(poses)
    solver = replace(settings.solver, iterations=_POSE_ITERATIONS)
    current = [np.array(pose) for pose in poses]
    for stage, band in enumerate(SIZE_BANDS_MM):

        def fitted(count: int, stage: int = stage) -> None:
            if tell is not None:
                size, frame = divmod(count - 1, len(poses))
                words = f"size {size + 1} tried on frame {frame + 1} of {len(poses)}"
                tell((stage + count / max(usual, count + 1)) / len(SIZE_BANDS_MM), words)

        model = build(scale)
        problems = [
            _problem(model, settings, band, observed, pose, is_last=stage + 1 == len(SIZE_BANDS_MM))
            for observed, pose in zip(observations, current, strict=True)
        ]
        size = SizeParameters(model, seen)
        lengths = size.names[: len(size.names) - size.offset_count]
        shape = model.kind == "body" or all(seen.cloud is None for seen in observations)
        held = () if shape else model.proportion_names
        free = [sizes and (parts or name == "overall") and name not in held for name in lengths]
        free += [True] * size.offset_count
        scale, current = fit_size(
            problems, current, np.array(free), solver, should_stop, _LEAST_GAIN, fitted, seen,
            _repeated([observed.frame for observed in observations]),
        )  # fmt: skip
    return scale


def _repeated(frames: Sequence[int]) -> float:
    """Return how often a detector's error comes again in some frames: (1 + r) / (1 − r), r its correlation from one to the next."""
    gaps = np.abs(np.diff(np.sort(frames)))
    lasting = POINTS_LAST ** float(np.median(gaps)) if len(gaps) else 0.0
    return (1.0 + lasting) / (1.0 - lasting)


def _problem(
    model: ArticulatedModel,
    settings: TrackerSettings,
    band_mm: float,
    seen: Observation,
    pose: Floats,
    is_last: bool,
) -> Problem:
    """Return what a frame says with one narrow band, by itself; is_last: outlying joints are let go."""
    stage = replace(
        settings,
        silhouettes=replace(settings.silhouettes, bands_mm=(band_mm,)),
        tracker=replace(settings.tracker, smoothing=0.0),
    )
    start = model.bones(pose)
    terms = frame_terms(model, stage, seen, start, None)
    terms = terms if is_last else terms.wide()
    return Problem(model, terms.stage(0, start), terms.priors)
