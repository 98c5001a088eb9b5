"""The methods that can be tracked by, by name: ours, and each of the three papers' own. docs/explanation/papers.md is printed from here."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Traits:
    """What a method does otherwise than ours and no setting says; `replace(settings, traits=…)` turns one alone."""

    plain_sums: bool = False
    """each pixel and each point counts 1, squared: no robust loss, no neighbours that err alike, nothing that is near enough"""
    whole_surface: bool = False
    """E2 asks for a cloud on all of the model's surface, not only on what is in view"""
    inside: float = -1.0
    """what an observed field is inside a mask, before fields of −1 in the middle of an ellipsoid; the 2007 paper
    does not say it, and −0.7 is the mean of the model's own field over a hand"""
    narrowing: bool = True
    """bent fingers spread less: the range of abduction shrinks with flexion"""
    shifts_each_frame: bool = False
    """each frame is solved again from all fingers shifted to either side, and the least energy is taken"""
    joints_begin: bool = False
    """joints seen in images are all that a first frame is fitted to, and no other frame looks at them"""
    closest_prior: bool = False
    """hypotheses descend on what is seen alone, and count by the long-tailed density of the last frame that is closest to where they end;
    those that are shown may be near each other"""
    new_share: float = 1.0
    """of what one camera's joints say of a frame to hypotheses, how much earlier frames did not say: measured, where all frames are
    known"""


@dataclass(frozen=True)
class Method:
    """A way to track."""

    words: str
    source: str = ""
    """where it is said"""
    values: Mapping[str, object] = field(default_factory=dict)
    """the settings that it sets, by dotted name"""
    traits: Traits = Traits()
    clouds: Mapping[str, object] = field(default_factory=dict)
    """settings of [clouds] where that says nothing; False: off"""


_NO_PRIORS: dict[str, object] = {"prior.rest_sigma_deg": 0.0, "prior.posture": 0.0}
_FRAME_BY_FRAME: dict[str, object] = {
    "tracker.prediction": "none",
    "tracker.escape": False,
    "tracker.recovery": False,
    "tracker.estimate": "forward",
}
_OWN_SIZE: dict[str, object] = {"model.fit_size": "false"}
"""the papers set a person's size by hand; here it is that of the first pose's joints, where session.toml says fit"""
_HAND_ALONE: dict[str, object] = {"model.forearm": "false", **_OWN_SIZE}

METHODS: dict[str, Method] = {
    "default": Method("Ours: what the three papers have, and what came after."),
    "paper2007": Method(
        "Silhouettes by conic fields, 10 iterations a frame, and nothing else.",
        "Conic fields (2007), sections 2, 3 and 5",
        {
            "model.coupling": "26",
            **_HAND_ALONE,
            "silhouettes.term": "conic_field",
            "cloud.weight": 0.0,
            "keypoints.weight": 0.0,
            **_NO_PRIORS,
            "prior.collision": False,
            "solver.iterations": 10,
            "solver.limits": "none",
            **_FRAME_BY_FRAME,
            "tracker.smoothing": 0.0,
        },
        Traits(plain_sums=True, inside=-0.7, narrowing=False),
    ),
    "paper2004": Method(
        "A cloud by metaballs: F = K E1 + (1 − K) E2, 100 iterations, and fingers shifted to both sides in each frame.",
        "Metaballs (2004), sections 2.3, 3.3, 3.4 and 4",
        {
            "model.coupling": "21",
            **_HAND_ALONE,
            "model.fallback": "none",
            "silhouettes.weight": 0.0,
            "silhouettes.bands_mm": (1.2,),
            "cloud.balance": 0.5,
            "cloud.sigma_mm": 1.0,
            "cloud.distance": "d3",
            "cloud.sharpness_per_mm": 1.0,
            "cloud.doubt_depth": False,
            "cloud.crop_mm": 100.0,
            "keypoints.weight": 0.0,
            **_NO_PRIORS,
            "prior.collision": False,
            "solver.iterations": 100,
            "solver.limits": "projection",
            **_FRAME_BY_FRAME,
            "tracker.smoothing": 0.0,
        },
        Traits(plain_sums=True, narrowing=False, whole_surface=True, shifts_each_frame=True),
        {
            "stereo_method": "correlation",
            "component": "all",
            "voxel_m": False,
            "outlier_neighbours": False,
            "max_points": False,
        },
    ),
    "paper2003": Method(
        "Eight hypotheses by edges and the last frame's intensity; joints begin.",
        "Kinematic jumps (2003), sections 2, 4 and 5.2",
        {
            **_OWN_SIZE,
            "silhouettes.weight": 0.0,
            "cloud.weight": 0.0,
            "edges.weight": 1.0,
            "intensity.weight": 1.0,
            "intensity.memory": 0.0,
            **_NO_PRIORS,
            **_FRAME_BY_FRAME,
            "tracker.hypotheses": 8,
            "mixture.scale": 5.0,
            "mixture.carried": 8,
        },
        Traits(joints_begin=True, closest_prior=True),
    ),
}
