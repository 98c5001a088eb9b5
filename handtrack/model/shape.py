"""A person's shape against the mean adult's, number by number, in % and mm."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from handtrack.errors import unknown_name
from handtrack.model.articulated import ArticulatedModel, HandScale
from handtrack.model.size import SizeParameters

_MEASURED = 0.9  # of adults' standard deviation is left: a fifth of their variance is told
_GROUPS = {
    "flesh": ("flesh",), "forearm": ("forearm",), "palm": ("palm", "knuckle"), "thumb": ("thumb", "thenar"),
    "fingers": ("girth", "depth"),
}  # fmt: skip
"""what a proportion's name has in it, the first that fits; a length is of no other"""


@dataclass(frozen=True)
class ShapeNumber:
    """One number of a person's shape."""

    name: str
    """as a person's file has it: `overall`, a part, a proportion"""
    group: str
    value: float
    """by which it differs from the mean adult's; of a part, beside the whole"""
    std: float | None
    """None where it was given"""
    sigma: float
    """standard deviation of adults"""
    unit: str
    """of all three: `%` or `mm`"""

    @property
    def label(self) -> str:
        return "whole" if self.name == "overall" else self.name.replace("_", " ")

    @property
    def is_measured(self) -> bool:
        """Whether it was measured: clearly better known than adults are alike."""
        return self.std is not None and self.std < _MEASURED * self.sigma

    @property
    def words(self) -> str:
        """Its value, and how sure that is."""
        value = f"{self.value:+.1f}".replace("-", "−")
        if self.std is None:
            return f"{value} {self.unit}" if self.value else "as in the mean"
        if self.is_measured:
            return f"{value} ± {self.std:.1f} {self.unit}"
        here = "as in the mean" if abs(self.value) < (1.0 - _MEASURED) * self.sigma else value
        return f"{here} ± {self.std:.1f} {self.unit}, not measured"


def shape_numbers(model: ArticulatedModel) -> list[ShapeNumber]:
    """Return the shape of a model's person: the whole, its parts, its proportions, by groups."""
    size, rows = SizeParameters(model), []
    for name, at, own in zip(
        size.names, size.deviations(model.scale), size.units.tolist(), strict=True
    ):
        effect, unit = _effect(model, name, own)
        sigma = 100.0 * effect if unit == "%" else effect
        value = 100.0 * np.expm1(at * effect) if unit == "%" else at * effect
        std = model.scale.std.get(name)
        known = None if std is None else std * sigma / own
        if effect:
            rows.append(ShapeNumber(name, _group(name, model), float(value), known, sigma, unit))
    groups = list(dict.fromkeys(["length", "fingers", "palm", "thumb", *(r.group for r in rows)]))
    return sorted(rows, key=lambda row: groups.index(row.group))


def with_number(model: ArticulatedModel, name: str, value: float) -> HandScale:
    """Return the person of a model with one of `shape_numbers` set to a value in its unit, of which is not known how sure it is.

    Raises HandtrackError for another name.
    """
    size = SizeParameters(model)
    if name not in size.names:
        raise unknown_name("number of a shape", name, size.names)
    k, at, came = size.names.index(name), size.deviations(model.scale), model.scale
    effect, unit = _effect(model, name, float(size.units[k]))
    at[k] = (np.log1p(value / 100.0) if unit == "%" else value) / effect
    known = came.covariance
    if known is not None:
        known = known.only([one for one in known.names if one != name])
    std = {key: one for key, one in came.std.items() if key != name}
    return replace(size.scale(at), std=std, covariance=known, source=came.source)


def _effect(model: ArticulatedModel, name: str, own: float) -> tuple[float, str]:
    """Return the most that a standard deviation changes, of a factor its logarithm, and its unit; 0: nothing that the model has."""
    if name not in model.proportion_names:
        return (own if name == "overall" or name in model.groups else 0.0), "%"
    known, k = model.proportions, model.proportion_names.index(name)
    assert known is not None
    if (stretch := float(np.abs(known.stretch[k]).max())) > 0.0:
        return stretch, "%"
    return 1e3 * max(
        float(np.linalg.norm(by[k], axis=1).max()) for by in (known.moves, known.shift)
    ), "mm"


def _group(name: str, model: ArticulatedModel) -> str:
    if name in model.proportion_names and "length" not in name:
        found = (group for group, parts in _GROUPS.items() if any(part in name for part in parts))
        return next(found, "length")
    return "forearm" if name == "forearm" else "length"
