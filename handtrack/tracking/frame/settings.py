"""Every setting of the tracker, declared once, by the names that `--set` and `[tracking]` take."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any, Literal

from handtrack.errors import HandtrackError, unknown_name
from handtrack.setting import Setting, declared, setting
from handtrack.solver.solver_settings import SolverSettings
from handtrack.tracking.frame.methods import METHODS, Traits

# beyond that a term drowns all others in rounding: half of a double's 16 digits are left to them
_WEIGHT = {"level": "user", "low": 0.0, "high": 1e8, "slider": (0.0, 4.0, 0.05)}
_SPREAD = {"level": "user", "about": "hand", "slider": (-2.0, 3.0, 0.05)}
_DISTANCES = {
    "d1": "d1 = (k − 1) · least radius, k the ellipsoid's level: simple, and too short beside its long ends.",
    "d2": "d2 is measured along the line to the ellipsoid's centre: near the truth outside, without bound inside.",
    "d3": "d3 is d1 inside and d2 outside: nowhere without bound, and nearest to the truth.",
}
_FINGERS = ("index", "middle", "ring", "little")
_JOINT_SIGMA_PX = 5.0  # MediaPipe's joints are 4 to 5 px from where two cameras agree on them (real hands of 640 x 480 px)


@dataclass(frozen=True)
class ModelSettings:
    """Which hand."""

    name: str = setting(
        "",
        "A model other than that of [hand], or a definition's path. `glove9`: thumb and one mitten; `ball6`: the palm alone, "
        "for poor clouds.",
        label="Model",
        level="user",
        about="hand",
        words={"": "as session.toml", "hand26": "hand26", "glove9": "glove9", "ball6": "ball6"},
    )
    coupling: Literal["26", "21", "18"] = setting(
        "26",
        "Degrees of freedom. 26: all free; 21: DIP = 2/3 PIP; 18: abduction coupled as well.",
        label="Degrees of freedom",
        level="user",
        about="hand",
        words={"26": "26, all free", "21": "21, DIP coupled to PIP", "18": "18, abduction coupled"},
    )
    forearm: Literal["auto", "true", "false"] = setting(
        "auto",
        "Whether the model has a forearm. Automatic: if the silhouettes of most frames extend 2 cm beyond the wrist, as long "
        "as they show it.",
        label="Forearm",
        level="user",
        about="hand",
        words={"auto": "automatic", "true": "with", "false": "without"},
    )
    spread_index: float = setting(
        1.0,
        "The person's factor c of coupling 18: abduction of the index = c · spread. `handtrack person --spread` measures all "
        "four.",
        label="Index ×",
        **_SPREAD,
    )
    spread_middle: float = setting(
        0.1,
        "The same for the middle finger; positive: towards the thumb.",
        label="Middle ×",
        **_SPREAD,
    )
    spread_ring: float = setting(0.6, "The same for the ring finger.", label="Ring ×", **_SPREAD)
    spread_little: float = setting(
        1.2, "The same for the little finger.", label="Little ×", **_SPREAD
    )
    fallback: Literal["auto", "glove9", "ball6", "none"] = setting(
        "auto",
        "What replaces the hand while its only observation is a poor cloud: `auto`, viewing rays instead of points; `glove9` or "
        "`ball6`, the palm of these models as well; `none`, nothing.",
        label="If cloud is poor",
        level="user",
        about="hand",
        words={
            "auto": "use viewing rays",
            "glove9": "palm of glove9",
            "ball6": "palm of ball6",
            "none": "do nothing",
        },
    )
    fit_size: Literal["true", "later", "false"] = setting(
        "true",
        'With scale = "fit" in session.toml: `true`, fit the shape to silhouettes and keypoints; `false`, to keypoints alone; '
        "`later`, track, fit it to the tracked frames, and track again.",
        about="hand",
    )

    @property
    def spread(self) -> dict[str, float]:
        """The person's c by finger, as far as they are set: a definition's own hold where these are as usual."""
        usual = {f: getattr(ModelSettings, f"spread_{f}") for f in _FINGERS}
        own = {finger: getattr(self, f"spread_{finger}") for finger in _FINGERS}
        return {finger: value for finger, value in own.items() if value != usual[finger]}


@dataclass(frozen=True)
class SilhouetteSettings:
    """The silhouette term."""

    term: Literal["coverage", "conic_field"] = setting(
        "coverage",
        "`coverage`: unbiased, with a wide basin of convergence. `conic_field`: the 2007 paper's.",
        label="Outlines by",
        level="user",
        words={"coverage": "coverage", "conic_field": "conic field (2007)"},
    )
    weight: float = setting(
        1.0,
        "Factor on the silhouettes' cost. 1: as `outline_sigma_mm` implies; 0: silhouettes are not used.",
        label="Silhouettes",
        **_WEIGHT,
    )
    bands_mm: tuple[float, ...] = setting(
        (8.0, 4.0, 1.2),
        "Half-widths of the band around the contour, widest first, at the hand's distance; `coverage` "
        "only.",
        above=0.0,
        unit="mm",
    )
    outline_sigma_mm: float = setting(
        1.5,
        "Standard deviation of the distance between the model's contour and the silhouette's.",
        label="Outline error mm",
        level="user",
        unit="mm",
        above=0.0,
        slider=(0.2, 6.0, 0.1),
    )
    outline_correlation_mm: float = setting(
        10.0, "Correlation length of that error along the contour.", unit="mm", above=0.0
    )


@dataclass(frozen=True)
class CloudTermSettings:
    """The point cloud's term; [clouds] says where the cloud comes from."""

    weight: float = setting(
        1.0,
        "Factor on the cloud's cost. 1: as `sigma_mm` implies; 0: clouds are not used.",
        label="Cloud",
        **_WEIGHT,
    )
    balance: float = setting(
        0.5,
        "K of F = K·E1 + (1 − K)·E2: 1: only that points lie on the model; 0: only that no visible part of the "
        "model is without points. With viewing rays, E1 is the distance to the rays.",
        label="Balance K",
        level="user",
        low=0.0,
        high=1.0,
        slider=(0.0, 1.0, 0.01),
    )
    sigma_mm: float = setting(
        2.0,
        "Standard deviation of a point's distance from the model's surface: sensor noise and the ellipsoids' error. A smaller "
        "value measured from the recording replaces it.",
        label="Point error mm",
        level="user",
        unit="mm",
        above=0.0,
        slider=(0.2, 10.0, 0.1),
    )
    distance: Literal["d1", "d2", "d3"] = setting(
        "d3",
        "The approximate distance of a point to one ellipsoid, from which the metaball surface is made.",
        label="Distance",
        words={"d1": "d1, by the level", "d2": "d2, along the radius", "d3": "d3, both"},
        explanations=_DISTANCES,
    )
    sharpness_per_mm: float = setting(
        1.0,
        "β of the metaball surface at the mean hand's size. Less rounds and thickens the skin between ellipsoids, by log(n)/β "
        "where n are equally close; more shows creases.",
        label="β 1/mm",
        unit="1/mm",
        above=0.0,
        slider=(0.2, 4.0, 0.1),
    )
    doubt_depth: bool = setting(
        False,
        "Use each point's viewing ray, and its depth only as a mixture with outliers: for stereo mismatches. For clouds of "
        "one depth camera or one pair.",
    )
    crop_mm: float = setting(
        40.0,
        "Points further than this from the predicted hand are ignored.",
        unit="mm",
        above=0.0,
    )


@dataclass(frozen=True)
class EdgeSettings:
    """The term of image edges; it needs no masks."""

    weight: float = setting(
        0.0,
        "Factor on the cost of image edges; 0: not used. `--use edges` sets 1.",
        label="Edges",
        **_WEIGHT,
    )
    sigma_px: float = setting(
        1.5,
        "Standard deviation of the distance between the model's contour and an edge.",
        unit="px",
        above=0.0,
    )


@dataclass(frozen=True)
class IntensitySettings:
    """The term of the texture carried from earlier frames."""

    weight: float = setting(
        0.0,
        "Factor on the cost of the carried texture; 0: none is carried. `--use intensity` sets 1.",
        label="Intensity",
        **_WEIGHT,
    )
    sigma: float = setting(
        10.0,
        "Standard deviation of a point's change of intensity, 0 … 255.",
        unit="grey levels",
        above=0.0,
    )
    memory: float = setting(
        0.5,
        "Share of the texture that comes from the first frame; the rest comes from the previous one.",
        low=0.0,
        high=1.0,
    )


@dataclass(frozen=True)
class KeypointSettings:
    """The term of keypoints."""

    weight: float = setting(
        1.0,
        "Factor on the keypoints' cost. 1: as their standard deviation implies; 0: keypoints are not used.",
        label="Keypoints",
        **_WEIGHT,
    )
    sigma_mm: float = setting(
        8.0,
        "Standard deviation of 3D keypoints: noise, and joints placed differently on different hands.",
        label="Point error mm",
        level="user",
        unit="mm",
        above=0.0,
        slider=(1.0, 30.0, 0.5),
    )
    sigma_px: float = setting(
        0.0,
        "Standard deviation of a detector's 2D joints. 0: measured from the disagreement of the cameras, or 5 px where that is not "
        "possible.",
        label="Joint error px",
        level="user",
        unit="px",
        low=0.0,
        slider=(0.0, 40.0, 0.5),
    )

    @property
    def detected_px(self) -> float:
        """Standard deviation of detected joints where no recording tells it [px]."""
        return self.sigma_px or _JOINT_SIGMA_PX


@dataclass(frozen=True)
class PriorSettings:
    """The priors."""

    rest_sigma_deg: float = setting(
        80.0,
        "Standard deviation of joint angles about the relaxed hand; 0: no such prior.",
        label="Towards relaxed °",
        level="user",
        unit="°",
        low=0.0,
        slider=(0.0, 90.0, 1.0),
    )
    posture: float = setting(
        1.0,
        "Factor on the prior of correlated joints (neighbouring fingers, DIP with PIP); 0: none.",
        low=0.0,
    )
    collision: bool = setting(
        True,
        "Penalise fingers that intersect each other or the palm, and a body's limbs.",
    )
    motion_sigma_deg: float = setting(
        12.0,
        "Standard deviation of a joint angle, and of the hand's orientation, about its prediction for the next frame.",
        label="Turn per frame °",
        level="user",
        unit="°",
        above=0.0,
        slider=(1.0, 45.0, 0.5),
    )
    motion_sigma_mm: float = setting(
        15.0,
        "Standard deviation of the wrist's position about its prediction for the next frame.",
        unit="mm",
        above=0.0,
    )


@dataclass(frozen=True)
class FollowSettings:
    """From frame to frame."""

    prediction: Literal["constant_velocity", "none"] = setting(
        "constant_velocity",
        "Where a frame starts: `constant_velocity` predicts; `none` takes the previous pose.",
    )
    smoothing: float = setting(
        1.0,
        "Factor on the cost of deviating from the predicted pose; 0: none.",
        label="Smoothing",
        level="user",
        low=0.0,
        slider=(0.0, 5.0, 0.1),
    )
    escape: bool = setting(
        True,
        "Search lost fingers, the forearm, and a body's arms and legs over their whole range when the residual is larger than usual, and at intervals.",
    )
    recovery: bool = setting(
        True,
        "Search again for a hand that is lost or of low confidence, near its last position and with fingers flipped. The result is "
        "used only if it fits clearly better.",
        label="Recovery",
        level="user",
    )
    estimate: Literal["forward", "whole"] = setting(
        "whole",
        "`forward`: each frame from the frames before it. `whole`: then jointly optimise all tracked frames, along the most "
        "probable trajectory if several hypotheses are carried. Texture needs `forward`.",
        label="Estimate",
        level="user",
        words={"forward": "as frames come", "whole": "whole recording"},
    )
    hypotheses: int = setting(
        1,
        "Poses carried from frame to frame where one view is ambiguous; 1: only the best, without sampling.",
        label="Hypotheses",
        level="user",
        low=1,
        slider=(1, 16, 1),
    )
    seed: int = setting(
        0,
        "Seed of all random numbers (hypotheses, thinning of clouds). The same seed gives the same result. `--seed` sets it.",
        low=0,
    )
    doubtful_mm: float = setting(
        15.0,
        "A frame with a larger uncertainty than this (root mean square of the joints' standard deviations) has low "
        "confidence; 0: no such limit.",
        unit="mm",
        low=0.0,
    )


@dataclass(frozen=True)
class MixtureSettings:
    """Sampling of other poses, with `tracker.hypotheses` above 1."""

    draws: int = setting(24, "Samples per frame, each flipped along one kinematic chain.", low=0)
    scale: float = setting(
        4.0,
        "Scatter of samples around a hypothesis, in standard deviations; the 2003 paper uses 4 to 6.",
        above=0.0,
    )
    carried: int = setting(
        20,
        "Hypotheses carried in all: `tracker.hypotheses` distinct ones, and the most probable of the others. With keypoints alone "
        "only.",
        low=0,
    )
    chains: tuple[str, ...] = setting(
        ("all",),
        "Chains along which samples may be flipped: `thumb`, `index`, … of a hand; `neck`, `left_arm`, "
        "`right_leg`, … of a body.",
    )


@dataclass(frozen=True)
class TrackerSettings:
    """All settings; immutable. `with_values` gives a changed copy."""

    method: Literal["default", "paper2007", "paper2004", "paper2003"] = setting(
        "default",
        "handtrack's method, or that of one of the three papers with its settings (`docs/explanation/papers.md`). Other settings "
        "override it.",
        label="Method",
        explanations={name: method.words for name, method in METHODS.items()},
        words={
            "default": "handtrack",
            "paper2007": "2007, conic fields",
            "paper2004": "2004, metaballs",
            "paper2003": "2003, jumps",
        },
    )
    model: ModelSettings = ModelSettings()
    silhouettes: SilhouetteSettings = SilhouetteSettings()
    cloud: CloudTermSettings = CloudTermSettings()
    edges: EdgeSettings = EdgeSettings()
    intensity: IntensitySettings = IntensitySettings()
    keypoints: KeypointSettings = KeypointSettings()
    prior: PriorSettings = PriorSettings()
    solver: SolverSettings = SolverSettings()
    tracker: FollowSettings = FollowSettings()
    mixture: MixtureSettings = MixtureSettings()
    traits: Traits = Traits()
    """the method's, where no setting says it"""

    @property
    def uses_images(self) -> bool:
        """Whether a frame's images are needed, beside masks and clouds."""
        return self.edges.weight > 0 or self.intensity.weight > 0

    @property
    def refines(self) -> bool:
        """Whether all frames are looked at together once they are tracked: not where texture is carried from one to the next."""
        return self.tracker.estimate == "whole" and self.intensity.weight == 0

    def flat(self) -> dict[str, Any]:
        """Return every setting by its dotted name."""
        return {name: reduce(getattr, name.split("."), self) for name in SETTINGS}

    @property
    def usual(self) -> dict[str, Any]:
        """Every setting as the method has it where nothing else is said."""
        own = METHODS[self.method].values
        return {name: own.get(name, known.default) for name, known in SETTINGS.items()}

    def with_values(self, values: Mapping[str, Any]) -> TrackerSettings:
        """Return a copy with dotted settings replaced; strings are read as their kind.

        A method is taken first, so that it comes over what was set before, and what is given beside it over the method. Raises HandtrackError for an unknown name (listing the known ones) or a value that a setting cannot have.
        """
        changed = self
        if "method" in values:
            changed = changed._with_method(_accepted("method", values["method"]))
        for given in sorted(
            (name for name in values if name != "method"), key=SETTINGS.__contains__
        ):  # other names first: the setting's own beside one wins
            changed = changed._with_value(given, values[given])
        if not any(getattr(changed.model, f"spread_{finger}") for finger in _FINGERS):
            raise HandtrackError(
                "settings 'model.spread_index' … 'model.spread_little' are all 0: no finger would ever spread."
            )
        return changed

    def _with_value(self, given: str, value: Any) -> TrackerSettings:
        name = ALIASES.get(given, given)
        if name not in SETTINGS:
            raise unknown_name("setting", name, sorted(SETTINGS))
        group, _, own = name.partition(".")
        changed = replace(getattr(self, group), **{own: _accepted(name, value, given)})
        return replace(self, **{group: changed})

    def _with_method(self, name: str) -> TrackerSettings:
        """Return the settings with a method's; what the one before had set, and this one does not, is as usual again."""
        before, now, flat = METHODS[self.method], METHODS[name], self.flat()
        left = {n: SETTINGS[n].default for n, value in before.values.items() if flat[n] == value}
        changed = replace(self, method=name, traits=now.traits)
        for known, value in (left | dict(now.values)).items():
            changed = changed._with_value(known, value)
        return changed

    def without_effect(self, kind: str) -> list[str]:
        """Return a sentence on each setting that was changed and means nothing to a model of this kind, hand or body."""
        flat, usual = self.flat(), self.usual
        return [
            f"{name} = {str(flat[name]).lower()} has no effect: it is about a {known.about}, and the model is a {kind}."
            for name, known in SETTINGS.items()
            if known.about not in ("", kind) and flat[name] != usual[name]
        ]


def _accepted(name: str, value: Any, given: str = "") -> Any:
    try:
        return SETTINGS[name].accept(value)
    except ValueError as error:
        raise HandtrackError(
            f"setting '{given or name}': expected {error}, found {value!r}."
        ) from None


GROUPS: dict[str, type] = {
    name: type(kind.default)
    for name, kind in TrackerSettings.__dataclass_fields__.items()
    if name not in ("method", "traits")
}
"""classes of the settings by the first part of their names"""
SETTINGS: dict[str, Setting] = dict(declared(TrackerSettings)) | {
    name: known
    for group, table in GROUPS.items()
    for name, known in declared(table, f"{group}.").items()
}
"""every setting of the tracker by its dotted name"""
ALIASES = {"tracker.jumps": "tracker.recovery"}
"""another name that scripts rely on → the setting's"""
