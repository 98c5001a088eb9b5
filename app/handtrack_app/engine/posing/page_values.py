"""Joint parameters as the page has them, beside the solver's: couplings drive, limits bound, names carry over."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from handtrack.arrays import Floats, P, S
from handtrack.model.articulated import ArticulatedModel

_FAR = 100.0  # [m] nobody's hand is further from the world's origin


def drivers(model: ArticulatedModel) -> list[int]:
    """Return (P,) for each solver parameter the joint parameter that stands for it on the page."""
    chosen = []
    for p, name in enumerate(model.transform.names):
        same = name in model.parameter_names
        column = np.abs(model.transform.matrix[:, p])
        chosen.append(model.parameter_names.index(name) if same else int(np.argmax(column)))
    return chosen


def params_of(model: ArticulatedModel, values: Floats[S]) -> Floats[P]:
    """Return solver parameters, within limits, for joint parameters as set on the page.

    Under a coupling the driving joints count and the driven ones follow.
    """
    values = np.clip(np.nan_to_num(values, nan=0.0), -_FAR, _FAR)
    transform = model.transform
    params = np.array(
        [
            (values[s] - transform.offset[s]) / transform.matrix[s, p]
            for p, s in enumerate(drivers(model))
        ]
    )
    return model.clipped(params)


def renamed(
    values: Floats[S], names: Sequence[str], new_names: Sequence[str], others: Floats[S]
) -> Floats[S]:
    """Return joint parameters of another model by name; those that are not known are `others`."""
    known: dict[str, float] = dict(zip(names, values.tolist(), strict=True))
    return np.array([known.get(name, other) for name, other in zip(new_names, others, strict=True)])
