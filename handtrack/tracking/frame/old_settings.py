"""Names that settings once had: old session.toml files and scripts still work, and a note says what became of each."""

from __future__ import annotations

from typing import Any

from handtrack.solver.solver_settings import SolverSettings
from handtrack.tracking.frame import constants
from handtrack.tracking.frame.methods import Traits

RENAMED = {"tracker.jumps": "tracker.recovery", "mixture.seed": "tracker.seed"}
"""old name → name; `tracker.jumps` is a name that scripts rely on, and is read for good"""
CONSTANTS: dict[str, tuple[str, Any]] = {
    f"solver.{name}": (f"SolverSettings.{name}", getattr(SolverSettings, name))
    for name in (
        "damping", "least_damping", "relax", "tighten", "cost_tolerance", "step_tolerance", "step_limit_m",
        "step_limit_rad",
    )
} | {
    old: (name, getattr(constants, name))
    for old, name in (
        ("edges.search_px", "EDGE_SEARCH_PX"),
        ("edges.correlation_px", "EDGE_CORRELATION_PX"),
        ("intensity.smooth_px", "TEXTURE_SMOOTH_PX"),
        ("intensity.correlation_px", "TEXTURE_CORRELATION_PX"),
        ("cloud.patch_mm", "CLOUD_PATCH_MM"),
        ("tracker.escape_every", "SEARCH_EVERY"),
        ("tracker.doubtful_overlap", "DOUBTFUL_OVERLAP"),
        ("tracker.lost_overlap", "LOST_OVERLAP"),
        ("tracker.doubtful_part", "DOUBTFUL_PART"),
        ("tracker.doubtful_cloud", "DOUBTFUL_CLOUD"),
        ("tracker.lost_cloud", "LOST_CLOUD"),
        ("mixture.jump_share", "JUMP_SHARE"),
        ("mixture.descents", "MIXTURE_DESCENTS"),
        ("mixture.merge_deg", "MERGE_DEG"),
        ("mixture.apart_mm", "APART_MM"),
        ("silhouettes.forearm_seen_mm", "FOREARM_SEEN_MM"),
    )
} | {"model.narrowing": ("Traits.narrowing", Traits.narrowing)}  # fmt: skip
"""old name → the constant that it is now, and its value"""

REPLACED = {"mixture.sequence": 'tracker.estimate = "whole"'}
"""old name → the setting whose value does the same, and more"""


def current_name(name: str) -> tuple[str | None, str]:
    """Return the name a setting has now, None for one that is no more, and a sentence where either is news."""
    if name in RENAMED:
        now = RENAMED[name]
        return now, f"the setting '{name}' is called '{now}' now; it was read as that."
    if name in CONSTANTS:
        constant, value = CONSTANTS[name]
        values = value if isinstance(value, tuple) else (value,)
        shown = ", ".join(str(v).lower() if isinstance(v, bool) else f"{v:g}" for v in values)
        return (
            None,
            f"'{name}' is no longer a setting but always {shown} ({constant}); what was given for it is not used.",
        )
    if name in REPLACED:
        return (
            None,
            f"'{name}' is no longer a setting: {REPLACED[name]}, the default, does what it did, and more.",
        )
    return name, ""
