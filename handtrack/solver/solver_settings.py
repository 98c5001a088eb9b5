"""Settings of the solver; light to import, as the page and the command line read them without solving."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from handtrack.setting import setting


@dataclass(frozen=True)
class SolverSettings:
    """Iterations, limits and damping. Fields that are no `setting` are the same in all of tracking."""

    iterations: int = setting(
        30,
        "Most linearisations per frame, over all bands.",
        label="Iterations",
        level="user",
        low=1,
        slider=(1, 100, 1),
    )
    limits: Literal["bounds", "projection", "none"] = setting(
        "bounds",
        "Joint limits. `bounds`: each step is solved within them, also those that depend on another angle. `projection`: an "
        "unconstrained step is projected on them afterwards (the 2004 paper), which can stick where joints are coupled. "
        "`none`: no limits (the 2007 paper).",
    )
    damping: float = 1e-2
    """first λ, as a share of the Hessian's diagonal"""
    cost_tolerance: float = 1e-7
    """stop when a step lowers the cost by a smaller share than this"""
    least_gain: float = 0.0
    """stop when a step lowers the cost by less than this; ½ is one standard deviation"""
    step_tolerance: float = 1e-7
    """stop when no parameter moves by more than this [m, rad]"""
