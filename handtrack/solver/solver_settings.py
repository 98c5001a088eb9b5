"""How hard the solver tries; light to import, as the page and the command line read it without solving."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from handtrack.setting import setting


@dataclass(frozen=True)
class SolverSettings:
    """How hard to try on a frame.

    What is not declared as a setting is the same in all of tracking; callers may choose it.
    """

    iterations: int = setting(
        30, "Linearisations a frame at most, all bands together.", label="Iterations", level="user", low=1,
        slider=(1, 100, 1),
    )  # fmt: skip
    limits: Literal["bounds", "projection", "none"] = setting(
        "bounds", "`bounds`: no step leaves the limits, found together with it, and those that move with another parameter "
        "are followed; `projection`: a step that knows no limits is moved back to them afterwards (the 2004 paper's), which "
        "can stick where joints work together; `none`: a joint may bend anywhere (the 2007 paper's).",
    )  # fmt: skip
    damping: float = 1e-2
    """first λ, as a share of the Hessian's diagonal; kept above `least_damping`, for two or three
    binary cameras leave weak directions"""
    least_damping: float = 1e-6
    relax: float = 0.4
    """λ is multiplied by this after a step that lowered the cost"""
    tighten: float = 4.0
    """and by this after one that did not; each further one at the same place doubles it (Nielsen 1999)"""
    cost_tolerance: float = 1e-7
    """stop when a step lowers the cost by a smaller share than this"""
    step_tolerance: float = 1e-7
    """stop when no parameter moves by more than this [m, rad]"""
    step_limit_m: float = 0.05
    """longest move of a translation in one step"""
    step_limit_rad: float = 0.5
    """widest turn of an angle in one step"""
