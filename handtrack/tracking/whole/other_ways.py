"""What of the other ways through a recording stays with its frames: poses that may be, and a doubt where they are elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from handtrack.arrays import F, Ints
from handtrack.model.articulated import ArticulatedModel
from handtrack.tracking.frame.reason import Reason
from handtrack.tracking.frame.result import Alternative, FrameResult, Status
from handtrack.tracking.whole.lattice import Lattice
from handtrack.tracking.whole.ways import APART_M

_LEAST = 0.03
"""probability below which another way is left out"""


def with_other_ways(
    model: ArticulatedModel,
    results: Sequence[FrameResult],
    lattice: Lattice,
    best: Ints[F],
    shown: int = 1,
) -> list[FrameResult]:
    """Return refined frames with the other poses that all frames together leave open, the most probable first, behind the
    frame's own; one that was tracked is doubtful where another has a joint more than `APART_M` away.

    best: which minimum of each frame the refined way went through; shown: how many poses a frame has that were asked for,
    however probable.
    """
    found = []
    rows = zip(results, lattice.minima, lattice.probabilities, best, strict=True)
    for result, minima, share, own in rows:
        others = [k for k in np.argsort(-share, kind="stable").tolist() if k != own]
        others = [k for n, k in enumerate(others, 1) if share[k] > _LEAST or n < shown]
        if not others:
            found.append(result)
            continue
        known = [
            Alternative(
                model.joint_params(minima[k].pose), minima[k].system.cost, float(share[k]), -1,
                minima[k].origin,
            )
            for k in others
        ]  # fmt: skip
        held = Alternative(result.parameters, result.energy, float(share[own]), -1, "refined")
        doubt = _doubt(model, result, known)
        if result.status == Status.TRACKED and doubt is not None:
            result = replace(result, status=Status.DOUBTFUL, reason=doubt)
        found.append(replace(result, alternatives=(held, *known)))
    return found


def _doubt(
    model: ArticulatedModel, result: FrameResult, others: Sequence[Alternative]
) -> Reason | None:
    """Return which joint may be elsewhere, how far, and how probable that is; None where all are near."""
    far, share = None, 0.0
    for other in others:
        bones = model.bones(model.transform.solver_params(other.parameters))
        off = np.linalg.norm(model.joint_positions(bones) - result.joint_positions, axis=1)
        worst = int(off.argmax())
        if off[worst] <= APART_M or other.weight <= _LEAST:
            continue
        share += other.weight
        if far is None or off[worst] > far[1]:
            far = worst, float(off[worst])
    if far is None:
        return None
    name = model.joint_names[far[0]].replace("_", " ")
    return Reason("other way", name, number=share, other=1e3 * far[1])
