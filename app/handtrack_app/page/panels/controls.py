"""Which settings of the tracker the page draws, folder by folder; what each is like stands where it is declared."""

from __future__ import annotations

from handtrack.setting import Setting
from handtrack.tracking.frame.settings import SETTINGS

OPEN = ("Model", "Weights")
"""folders that are open at first"""
EXPERT = "For experts"
"""the folder of what only `--set` and session.toml had else"""
_FOLDERS = {
    "Model": ("model.name", "model.fallback", "model.coupling", "model.forearm"),
    "Weights": (
        "silhouettes.weight",
        "cloud.weight",
        "cloud.balance",
        "keypoints.weight",
        "edges.weight",
        "intensity.weight",
    ),
    "Linked spread (18 freedoms)": (
        "model.spread_index",
        "model.spread_middle",
        "model.spread_ring",
        "model.spread_little",
    ),
    "Silhouettes": ("silhouettes.term", "silhouettes.outline_sigma_mm"),
    "Point cloud": ("cloud.sigma_mm",),
    "Keypoints": ("keypoints.sigma_px", "keypoints.sigma_mm"),
    "Motion": (
        "tracker.estimate",
        "tracker.smoothing",
        "prior.motion_sigma_deg",
        "prior.rest_sigma_deg",
    ),
    "Other poses": ("tracker.recovery", "tracker.hypotheses"),
    "Solver": ("solver.iterations",),
    EXPERT: ("method", "cloud.distance", "cloud.sharpness_per_mm"),
}
CONTROLS: dict[str, tuple[Setting, ...]] = {
    folder: tuple(SETTINGS[name] for name in names) for folder, names in _FOLDERS.items()
}
