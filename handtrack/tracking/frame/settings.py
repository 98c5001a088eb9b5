"""Every setting of the tracker, declared once, by the names that `--set` and `[tracking]` take."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import reduce
from typing import Any, Literal

from handtrack.errors import HandtrackError, unknown_name
from handtrack.setting import NotAcceptedError, Setting, declared, setting
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
        "", "Another model than [hand] says, or a definition's path. glove9: thumb and one mitten; ball6: the palm alone, "
        "for poor clouds.", label="Model", level="user", about="hand",
        words={"": "as session.toml", "hand26": "hand26", "glove9": "glove9", "ball6": "ball6"},
    )  # fmt: skip
    coupling: Literal["26", "21", "18"] = setting(
        "26", "How many joint angles move on their own: all 26; 21, distal joints follow by 2/3; 18, abductions linked as "
        "well.", label="Freedoms", level="user", about="hand",
        words={"26": "26, all free", "21": "21, tips follow", "18": "18, spread linked"},
    )  # fmt: skip
    forearm: Literal["auto", "true", "false"] = setting(
        "auto", "Whether the model has a forearm: yes where the arm is bare and in view. Automatic: where silhouettes of "
        "most frames go on beyond the wrist by 2 cm, and as far as they do.", label="Forearm", level="user", about="hand",
        words={"auto": "automatic", "true": "with", "false": "without"},
    )  # fmt: skip
    spread_index: float = setting(
        1.0, "A person's own c of coupling 18, where the index' abduction is c · spread; `handtrack spread` measures all "
        "four.", label="Index ×", **_SPREAD,
    )  # fmt: skip
    spread_middle: float = setting(
        0.1,
        "Likewise the middle finger's; positive: towards the thumb.",
        label="Middle ×",
        **_SPREAD,
    )
    spread_ring: float = setting(0.6, "Likewise the ring finger's.", label="Ring ×", **_SPREAD)
    spread_little: float = setting(
        1.2, "Likewise the little finger's.", label="Little ×", **_SPREAD
    )
    fallback: Literal["auto", "glove9", "ball6", "none"] = setting(
        "auto", "What is done while a cloud that alone holds the hand is poor: `auto`, its depths are doubted; `glove9` or "
        "`ball6`, the palm of these models takes the hand's place as well; `none`, nothing.", label="If cloud is poor",
        level="user", about="hand",
        words={"auto": "doubt its depths", "glove9": "palm of glove9", "ball6": "palm of ball6", "none": "do nothing"},
    )  # fmt: skip
    fit_size: Literal["true", "later", "false"] = setting(
        "true", 'Where session.toml says scale = "fit": fit the size to silhouettes too, not to keypoints alone; `later`: '
        "track first, fit it to what was tracked, then track again.", about="hand",
    )  # fmt: skip

    @property
    def spread(self) -> dict[str, float]:
        """The person's c by finger, as far as they are set: a definition's own hold where these are as usual."""
        usual = {f: getattr(ModelSettings, f"spread_{f}") for f in _FINGERS}
        own = {finger: getattr(self, f"spread_{finger}") for finger in _FINGERS}
        return {finger: value for finger, value in own.items() if value != usual[finger]}


@dataclass(frozen=True)
class SilhouetteSettings:
    """How outlines pull."""

    term: Literal["coverage", "conic_field"] = setting(
        "coverage", "coverage: unbiased, wide basin. conic field: the 2007 paper's.", label="Outlines by", level="user",
        words={"coverage": "coverage", "conic_field": "conic field (2007)"},
    )  # fmt: skip
    weight: float = setting(
        1.0, "How strongly outlines pull: a factor on their cost. 1 takes `outline_sigma_mm` at its word, 0 leaves "
        "silhouettes out.", label="Silhouettes", **_WEIGHT,
    )  # fmt: skip
    bands_mm: tuple[float, ...] = setting(
        (8.0, 4.0, 1.2), "Half-widths of the band around the outline, widest first, at the hand's distance; `coverage` "
        "only.", above=0.0, unit="mm",
    )  # fmt: skip
    outline_sigma_mm: float = setting(
        1.5, "How far the model's outline is from a real one.", label="Outline error mm", level="user", unit="mm",
        above=0.0, slider=(0.2, 6.0, 0.1),
    )  # fmt: skip
    outline_correlation_mm: float = setting(
        10.0, "Along how much of the outline that error stays the same.", unit="mm", above=0.0
    )


@dataclass(frozen=True)
class CloudTermSettings:
    """How a point cloud pulls; where it comes from is said in [clouds]."""

    weight: float = setting(
        1.0, "How strongly the cloud pulls: a factor on its cost. 1 takes `sigma_mm` at its word, 0 leaves clouds out.",
        label="Cloud", **_WEIGHT,
    )  # fmt: skip
    balance: float = setting(
        0.5, "K of F = K·E1 + (1 − K)·E2: 1 asks only that the cloud lies on the model, 0 only that no visible part of the "
        "model lies where the cloud is empty. Where depths are doubted, E1 is the lines of sight.", label="Balance K",
        level="user", low=0.0, high=1.0, slider=(0.0, 1.0, 0.01),
    )  # fmt: skip
    sigma_mm: float = setting(
        2.0, "How far a point is from the model's surface: noise, and a hand that is not made of ellipsoids. A cloud that "
        "is found to lie nearer counts for as exact as it lies.", label="Point error mm", level="user", unit="mm",
        above=0.0, slider=(0.2, 10.0, 0.1),
    )  # fmt: skip
    distance: Literal["d1", "d2", "d3"] = setting(
        "d3", "What is taken for the distance of a point to one ellipsoid, of which the merged surface is made.", label="Distance",
        words={"d1": "d1, by the level", "d2": "d2, along the radius", "d3": "d3, both"}, told=_DISTANCES,
    )  # fmt: skip
    sharpness_per_mm: float = setting(
        1.0, "β of the merged surface, of a hand of mean size: less rounds and thickens the skin between ellipsoids, by log(n)/β where "
        "n of them are equally close; more lets creases show.", label="β 1/mm", unit="1/mm", above=0.0, slider=(0.2, 4.0, 0.1),
    )  # fmt: skip
    doubt_depth: bool = setting(
        False, "Believe of each point only that the hand lies on its line of sight; its depth is right or anywhere, as where "
        "a stereo pair mismatches. Clouds of one depth camera or one pair.",
    )  # fmt: skip
    crop_mm: float = setting(
        40.0,
        "Points further than this from the predicted hand are not the hand's.",
        unit="mm",
        above=0.0,
    )


@dataclass(frozen=True)
class EdgeSettings:
    """How edges of the images pull the model's outline; no masks needed."""

    weight: float = setting(
        0.0, "How strongly edges in the images pull the outline; 0: not looked at. `--use edges` makes it 1.",
        label="Edges", **_WEIGHT,
    )  # fmt: skip
    sigma_px: float = setting(
        1.5, "How far a model's outline is from a real one.", unit="px", above=0.0
    )


@dataclass(frozen=True)
class IntensitySettings:
    """How the model's texture, carried from earlier frames, pulls."""

    weight: float = setting(
        0.0, "How strongly the texture of earlier frames pulls; 0: none is carried. `--use intensity` makes it 1.",
        label="Intensity", **_WEIGHT,
    )  # fmt: skip
    sigma: float = setting(
        10.0,
        "How far a point's colour is from what it was, of 0 … 255.",
        unit="grey levels",
        above=0.0,
    )
    memory: float = setting(
        0.5, "Share of the texture that is carried from the first frame, whose pose was given; the rest from the last one.",
        low=0.0, high=1.0,
    )  # fmt: skip


@dataclass(frozen=True)
class KeypointSettings:
    """How given points pull."""

    weight: float = setting(
        1.0, "How strongly given points pull: a factor on their cost. 1 takes the points' sigma at its word, 0 leaves them "
        "out.", label="Keypoints", **_WEIGHT,
    )  # fmt: skip
    sigma_mm: float = setting(
        8.0, "How well a first frame's keypoints are known, and joints of one hand agree with another's.",
        label="Point error mm", level="user", unit="mm", above=0.0, slider=(1.0, 30.0, 0.5),
    )  # fmt: skip
    sigma_px: float = setting(
        0.0, "Standard deviation of a detector's 2D joints. 0: as the recording's own cameras disagree, 5 px where they cannot "
        "tell.", label="Joint error px", level="user", unit="px", low=0.0, slider=(0.0, 40.0, 0.5),
    )  # fmt: skip

    @property
    def detected_px(self) -> float:
        """Standard deviation of detected joints where no recording tells it [px]."""
        return self.sigma_px or _JOINT_SIGMA_PX


@dataclass(frozen=True)
class PriorSettings:
    """What is assumed where nothing is seen."""

    rest_sigma_deg: float = setting(
        80.0, "How far joint angles are from the relaxed hand's; 0 switches this pull off.", label="Towards relaxed °",
        level="user", unit="°", low=0.0, slider=(0.0, 90.0, 1.0),
    )  # fmt: skip
    posture: float = setting(
        1.0, "Strength of what is known of joints that go together (neighbouring fingers, last two joints); 0: none.",
        low=0.0,
    )  # fmt: skip
    collision: bool = setting(
        True, "Fingers keep out of each other and out of the palm; a body's limbs out of each other.",
    )  # fmt: skip
    motion_sigma_deg: float = setting(
        12.0, "How far a joint angle, and the hand's turn, is from its prediction one frame later.",
        label="Turn per frame °", level="user", unit="°", above=0.0, slider=(1.0, 45.0, 0.5),
    )  # fmt: skip
    motion_sigma_mm: float = setting(
        15.0, "How far the wrist is from its prediction one frame later.", unit="mm", above=0.0
    )


@dataclass(frozen=True)
class FollowSettings:
    """From frame to frame."""

    prediction: Literal["constant_velocity", "none"] = setting(
        "constant_velocity",
        "What a frame starts from: `constant_velocity`, or `none`, where the last frame ended.",
    )
    smoothing: float = setting(
        1.0, "Strength of the pull towards the predicted pose; 0 switches it off.", label="Smoothing", level="user",
        low=0.0, slider=(0.0, 5.0, 0.1),
    )  # fmt: skip
    escape: bool = setting(
        True,
        "Look for lost fingers over their whole range when a frame fits worse than usual, and every so often.",
    )
    recovery: bool = setting(
        True, "Look for a hand that is in doubt or lost again, near where it was last and with fingers flipped; taken only "
        "where it fits clearly better.", label="Recovery", level="user",
    )  # fmt: skip
    estimate: Literal["forward", "whole"] = setting(
        "whole", "`forward`: each frame by itself and those before it; `whole`: once all are tracked, all of them again "
        "together, each by those after it as well; where several hypotheses are carried, on the most probable way through them. "
        "Not where texture is carried.", label="Estimate",
        level="user", words={"forward": "as frames come", "whole": "whole recording"},
    )  # fmt: skip
    hypotheses: int = setting(
        1, "How many poses are carried along where one view leaves several open; 1: only the best, without sampling.",
        label="Hypotheses", level="user", low=1, slider=(1, 16, 1),
    )  # fmt: skip
    seed: int = setting(
        0, "Of everything random (hypotheses, thinning of clouds): another one gives other samples, the same gives the same "
        "result. `--seed` sets it.", low=0,
    )  # fmt: skip
    doubtful_mm: float = setting(
        15.0, "A frame whose hand may be further off than this, by its own covariance (root mean square of the joints' "
        "standard deviations), is doubtful however well it fits; 0: never.", unit="mm", low=0.0,
    )  # fmt: skip


@dataclass(frozen=True)
class MixtureSettings:
    """How other poses are looked for, where `tracker.hypotheses` is above 1."""

    draws: int = setting(24, "Samples a frame, each of them flipped along one chain.", low=0)
    scale: float = setting(
        4.0,
        "How far samples scatter around a hypothesis, in standard deviations; the 2003 paper has 4 to 6.",
        above=0.0,
    )
    carried: int = setting(
        20, "Hypotheses carried in all: `tracker.hypotheses` that differ, and the heaviest of those that do not yet. "
        "Keypoints alone: anything else takes too long.", low=0,
    )  # fmt: skip
    chains: tuple[str, ...] = setting(
        ("all",), "Chains that samples may be flipped along, by name: `thumb`, `index`, … of a hand; `neck`, `left_arm`, "
        "`right_leg`, … of a body.",
    )  # fmt: skip


@dataclass(frozen=True)
class TrackerSettings:
    """All settings; immutable. `with_values` gives a changed copy."""

    method: Literal["default", "paper2007", "paper2004", "paper2003"] = setting(
        "default", "Whose method: ours, or one of the three papers' own with its settings (`docs/explanation/papers.md`); settings given "
        "beside it win.", label="Method", told={name: method.words for name, method in METHODS.items()},
        words={"default": "ours", "paper2007": "2007, conic fields", "paper2004": "2004, metaballs", "paper2003": "2003, jumps"},
    )  # fmt: skip
    model: ModelSettings = field(default_factory=ModelSettings)
    silhouettes: SilhouetteSettings = field(default_factory=SilhouetteSettings)
    cloud: CloudTermSettings = field(default_factory=CloudTermSettings)
    edges: EdgeSettings = field(default_factory=EdgeSettings)
    intensity: IntensitySettings = field(default_factory=IntensitySettings)
    keypoints: KeypointSettings = field(default_factory=KeypointSettings)
    prior: PriorSettings = field(default_factory=PriorSettings)
    solver: SolverSettings = field(default_factory=SolverSettings)
    tracker: FollowSettings = field(default_factory=FollowSettings)
    mixture: MixtureSettings = field(default_factory=MixtureSettings)
    traits: Traits = Traits()
    """the method's, where no setting says it"""

    @property
    def looks_at_images(self) -> bool:
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
            changed = changed._with_value(ALIASES.get(given, given), values[given])
        if not any(getattr(changed.model, f"spread_{finger}") for finger in _FINGERS):
            raise HandtrackError(
                "settings 'model.spread_index' … 'model.spread_little' are all 0: no finger would ever spread."
            )
        return changed

    def _with_value(self, name: str, value: Any) -> TrackerSettings:
        if name not in SETTINGS:
            raise unknown_name("setting", name, sorted(SETTINGS))
        group, _, own = name.partition(".")
        changed = replace(getattr(self, group), **{own: _accepted(name, value)})
        return replace(self, **{group: changed})

    def _with_method(self, name: str) -> TrackerSettings:
        """Return the settings with a method's; what the one before had set, and this one does not, is as usual again."""
        before, now, flat = METHODS[self.method], METHODS[name], self.flat()
        left = {n: SETTINGS[n].default for n, value in before.values.items() if flat[n] == value}
        changed = replace(self, method=now.name, traits=now.traits)
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


def _accepted(name: str, value: Any) -> Any:
    try:
        return SETTINGS[name].accept(value)
    except NotAcceptedError as error:
        raise HandtrackError(f"setting '{name}': expected {error}, found {value!r}.") from None


GROUPS: dict[str, type] = {
    name: kind.default_factory  # type: ignore[misc]
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
