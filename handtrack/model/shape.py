"""One number of a person's shape, as it is shown."""

from __future__ import annotations

from dataclasses import dataclass

_MEASURED = 0.9  # of adults' standard deviation is left: a fifth of their variance is told


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
        if not self.is_measured and abs(self.value) < (1.0 - _MEASURED) * self.sigma:
            value = "mean"
        return f"{value} ± {self.std:.1f} {self.unit}"
