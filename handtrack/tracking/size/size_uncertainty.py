"""How well a person's shape is known: its covariance, and the standard deviation of the length in millimetres."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from handtrack.arrays import Floats, N
from handtrack.model.articulated import HandScale, ShapeCovariance
from handtrack.model.size import SizeParameters, hand_length_mm

_STEP = 1e-3  # of a deviation: the length is as good as linear in it
_MM = 1e3


def shape_covariance(size: SizeParameters, scale: HandScale) -> Floats[N, N]:
    """Return how well a saved person is known, by deviations; what their file does not tell is as uncertain as adults differ."""
    names, units = size.names, _units(size)
    std = [scale.std.get(name, unit) / unit for name, unit in zip(names, units, strict=True)]
    found = np.diag(np.square(std))
    if scale.covariance is not None:
        told = scale.covariance.only(names)
        at = [names.index(name) for name in told.names]
        found[at] = found[:, at] = 0.0
        found[np.ix_(at, at)] = told.matrix / np.outer(units[at], units[at])
    return found


def with_uncertainty(size: SizeParameters, scale: HandScale, covariance: Floats[N, N]) -> HandScale:
    """Return a person with what is known of their shape: the covariance, by deviations; standard deviations of sizes, and of
    `length_mm`.
    """
    units, count = _units(size), len(size.names) - size.offset_count
    std = np.sqrt(np.diag(covariance)) * units
    known = dict(zip(size.names[:count], std[:count].tolist(), strict=True))
    at, slope = size.deviations(scale), np.zeros(len(size.names))
    for k in range(count):
        step = np.zeros(len(slope))
        step[k] = _STEP
        ahead, behind = (hand_length_mm(size.rescaled(at + s)) for s in (step, -step))
        slope[k] = (ahead - behind) / (2 * _STEP)
    length = float(np.sqrt(slope @ covariance @ slope))
    return replace(
        scale,
        std=known if np.isnan(length) else {"length_mm": length} | known,
        covariance=ShapeCovariance.of(size.names, covariance * np.outer(units, units)),
    )


def _units(size: SizeParameters) -> Floats[N]:
    """Return one deviation of each as files have it: offsets in mm."""
    units, first = size.units, len(size.names) - size.offset_count
    return np.concatenate([units[:first], units[first:] * _MM])
