"""First poses of a hand of unknown size: its size is let go of together with the pose."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from handtrack.model.articulated import ArticulatedModel, HandScale
from handtrack.model.size import SizeParameters
from handtrack.tracking.search.evidence.start_shapes import shape_of
from handtrack.tracking.search.laid_shapes import Laid, StartSource
from handtrack.tracking.search.start_search import (
    NARROW_M,
    WIDE_M,
    narrowly_measured,
    problem_around,
)
from handtrack.tracking.size.sized_problem import fit_size

Resize = Callable[[ArticulatedModel, HandScale], ArticulatedModel]
"""makes the same hand in another size"""


def sized(sources: Sequence[StartSource], laid: Laid, resize: Resize) -> Laid:
    """Return a pose with the overall size that explains what was seen best with it, and its cost there.

    The parts keep their shares: one frame, seen with a pose still wrong, would blame a bent finger on its length. What is
    looked at stays the same, so that costs can be compared.
    """
    for band_m in (WIDE_M, NARROW_M):
        problem = problem_around(sources, laid, band_m)
        model = laid.shape.model
        free = np.array([name == "overall" for name in SizeParameters(model).names])
        scale, (params,) = fit_size([problem], [laid.params], free)
        model = resize(model, scale)
        shape = shape_of(model, model.joint_params(params), laid.shape.posture)
        laid = replace(laid, shape=replace(shape, reach=laid.shape.reach), params=params)
    return narrowly_measured(sources, laid)
