"""Which settings of the tracker the page draws, and how."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Knob:
    """How one setting is drawn. Without choices or range it is a checkbox or a number."""

    name: str
    label: str
    hint: str = ""
    choices: dict[str, str] = field(default_factory=dict)
    """page's word → setting's value"""
    span: tuple[float, float, float] | None = None
    """low, high, step of a slider"""
    hands: bool = False
    """means nothing to a body"""


_WEIGHT = (0.0, 4.0, 0.05)
_SPREAD = (-2.0, 3.0, 0.05)
OPEN = ("Model", "Weights")
"""folders that are open at first"""

KNOBS: dict[str, tuple[Knob, ...]] = {
    "Model": (
        Knob("model.name", "Model", "glove9: thumb and one mitten; ball6: the palm alone, for poor clouds.",
             {"as session.toml": "", "hand26": "hand26", "glove9": "glove9", "ball6": "ball6"}, hands=True),
        Knob("model.fallback", "Poor cloud", "Where a cloud is poor: its depths are doubted, or a simpler hand takes over as well.",
             {"doubt depths": "auto", "glove9": "glove9", "ball6": "ball6", "nothing": "none"}, hands=True),
        Knob("model.coupling", "Freedoms", "How many joint angles move on their own.",
             {"26, all free": "26", "21, tips follow": "21", "18, spread linked": "18"}, hands=True),
        Knob("model.forearm", "Forearm", "Whether the model has a forearm: yes where the arm is bare and in view.",
             {"automatic": "auto", "with": "true", "without": "false"}, hands=True),
        Knob("model.narrowing", "Narrowing", "Bent fingers spread less: abduction's range shrinks with flexion.",
             hands=True),
        Knob("solver.limits", "Limits as", "Bounds inside the solver, or by projection at each step, as in 2004.",
             {"bounds": "bounds", "projection": "projection"}),
    ),
    "Weights": (
        Knob("silhouettes.weight", "Silhouettes", "How strongly outlines pull.", span=_WEIGHT),
        Knob("cloud.weight", "Cloud", "How strongly the cloud pulls.", span=_WEIGHT),
        Knob("cloud.balance", "Balance K", "Of the cloud: 1 is only cloud to model, 0 only model to cloud.", span=(0.0, 1.0, 0.01)),
        Knob("keypoints.weight", "Keypoints", "How strongly given points pull.", span=_WEIGHT),
        Knob("edges.weight", "Edges", "How strongly edges in the images pull the outline.", span=_WEIGHT),
        Knob("intensity.weight", "Intensity", "How strongly the texture of the last frame pulls.", span=_WEIGHT),
    ),
    "Linked spread (18 freedoms)": (
        Knob("model.spread_index", "Index ×", "The person's own share of the common spread.", span=_SPREAD, hands=True),
        Knob("model.spread_middle", "Middle ×", "Positive: towards the thumb.", span=_SPREAD, hands=True),
        Knob("model.spread_ring", "Ring ×", "The person's own share of the common spread.", span=_SPREAD, hands=True),
        Knob("model.spread_little", "Little ×", "The person's own share of the common spread.", span=_SPREAD, hands=True),
    ),
    "Silhouettes": (
        Knob("silhouettes.term", "Term", "coverage: unbiased, wide basin. conic field: the 2007 paper's.",
             {"coverage": "coverage", "conic field (2007)": "conic_field"}),
        Knob("silhouettes.outline_sigma_mm", "Outline error mm", "How far the model's outline is from a real one.",
             span=(0.2, 6.0, 0.1)),
        Knob("silhouettes.forearm_seen_mm", "Forearm seen mm", "The arm beyond this is ignored.", span=(20, 250, 5),
             hands=True),
    ),
    "Point cloud": (
        Knob("cloud.sigma_mm", "Point error mm", "How far a point is from the model's surface: noise, and a hand that "
             "is not made of ellipsoids.", span=(0.2, 10.0, 0.1)),
        Knob("cloud.crop_mm", "Crop mm", "Points further from the predicted hand are not the hand's.",
             span=(5.0, 150.0, 1.0)),
    ),
    "Keypoints": (
        Knob("keypoints.sigma_mm", "Point error mm", "How well given points are known.", span=(1.0, 30.0, 0.5)),
    ),
    "Motion": (
        Knob("tracker.smoothing", "Smoothing", "Pull towards the predicted pose; 0 is off.", span=(0.0, 5.0, 0.1)),
        Knob("tracker.prediction", "Prediction", "What a frame starts from.",
             {"constant velocity": "constant_velocity", "last pose": "none"}),
        Knob("prior.motion_sigma_deg", "Turn per frame °", "How far an angle may be from its prediction.",
             span=(1.0, 45.0, 0.5)),
        Knob("prior.motion_sigma_mm", "Move per frame mm", "How far the wrist may be from its prediction.",
             span=(1.0, 60.0, 0.5)),
        Knob("prior.rest_sigma_deg", "Towards relaxed °", "Width of the pull to the relaxed hand; 0 is off.",
             span=(0.0, 90.0, 1.0)),
    ),
    "Other poses": (
        Knob("tracker.jumps", "Jumps", "Restart a doubtful frame from kinematic jumps."),
        Knob("tracker.hypotheses", "Hypotheses", "How many poses are carried along; 1: only the best.",
             span=(1, 16, 1)),
        Knob("mixture.scale", "Scatter ×", "How far samples scatter, in standard deviations.", span=(1.0, 16.0, 0.5)),
        Knob("mixture.apart_mm", "Apart mm", "Poses carried along differ by at least this.", span=(1.0, 100.0, 1.0)),
        Knob("mixture.sequence", "Of a sequence", "What becomes of the hypotheses when the last frame is done.",
             {"best of each frame": "best", "best path": "path", "path, smoothed": "smooth"}),
    ),
    "Solver": (
        Knob("solver.iterations", "Iterations", "Steps a frame at most.", span=(1, 100, 1)),
    ),
}  # fmt: skip
