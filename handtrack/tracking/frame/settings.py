"""Every setting of the tracker, by the names that `--set` and `[tracking]` take."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, get_args, get_origin, get_type_hints

from handtrack.errors import HandtrackError, unknown_name
from handtrack.solver.levenberg_marquardt import SolverSettings
from handtrack.tracking.frame.mixture_settings import MixtureSettings


@dataclass(frozen=True)
class ModelSettings:
    """Which model; the session's [hand] table unless set."""

    name: str = ""
    """`hand26` …, or a definition's path; empty: what session.toml says"""
    coupling: str = "26"
    """`26` all freedoms, `21` distal joints follow by 2/3, `18` abductions linked as well"""
    forearm: str = "auto"
    """`true`, `false`, or `auto`: true where silhouettes go on beyond the wrist by 3 cm"""
    spread_index: float = 1.0
    """a person's own c of coupling 18, where the index' abduction is c · spread; `handtrack spread` measures all four"""
    spread_middle: float = 0.1
    """likewise the middle finger's; positive: towards the thumb"""
    spread_ring: float = 0.6
    """likewise the ring finger's"""
    spread_little: float = 1.2
    """likewise the little finger's"""
    narrowing: bool = True
    """bent fingers spread less: the range of abduction shrinks with flexion"""
    fallback: str = "auto"
    """what is done while a cloud that alone holds the hand is poor: `auto` its depths are doubted, `glove9` or `ball6` these
    models' palm takes the hand's place as well, `none` nothing"""
    fit_size: bool = True
    """where session.toml says scale = "fit": fit the size to silhouettes too, not to keypoints alone"""

    @property
    def spread(self) -> dict[str, float]:
        """The person's c by finger, as far as they are set: a definition's own hold where these are as usual."""
        names = {f"spread_{finger}": finger for finger in ("index", "middle", "ring", "little")}
        usual = {item.name: item.default for item in fields(self)}
        own = {name: getattr(self, name) for name in names}
        return {names[name]: value for name, value in own.items() if value != usual[name]}


@dataclass(frozen=True)
class SilhouetteSettings:
    """How outlines pull."""

    term: str = "coverage"
    """`coverage` (unbiased, wide basin) or `conic_field` (the 2007 paper's)"""
    weight: float = 1.0
    bands_mm: tuple[float, ...] = (8.0, 4.0, 1.2)
    """half-widths of the band around the outline, widest first, at the hand's distance; `coverage` only"""
    outline_sigma_mm: float = 1.5
    """how far a model's outline is from a real one"""
    outline_correlation_mm: float = 10.0
    """along how much of the outline that error stays the same"""
    forearm_seen_mm: float = 100.0
    """the forearm is looked at up to this far from the wrist, or to where the mask ends; what lies beyond is ignored"""


@dataclass(frozen=True)
class CloudSettings:
    """How a point cloud pulls."""

    weight: float = 1.0
    balance: float = 0.5
    """K of F = K·E1 + (1 − K)·E2: 1 asks only that the cloud lies on the model, 0 only that no visible
    part of the model lies where the cloud is empty"""
    sigma_mm: float = 2.0
    """how far a point is from the model's surface: noise, and a hand that is not made of ellipsoids; a cloud that is found to
    lie nearer counts for as exact as it lies"""
    patch_mm: float = 20.0
    """over how much of the surface that error stays the same: the breadth of a finger, since a hand's own shape is
    most of it and a sensor's noise the least; of a mean adult's hand"""
    doubt_depth: bool = False
    """believe of each point only that the hand lies on its line of sight; its depth is right or anywhere, as where a stereo
    pair mismatches. Clouds of one depth camera or one pair"""
    crop_mm: float = 40.0
    """points further than this from the predicted hand are not the hand's"""


@dataclass(frozen=True)
class EdgeSettings:
    """How edges of the images pull the model's outline; no masks needed."""

    weight: float = 0.0
    """0: edges are not looked at; `--use edges` makes it 1"""
    search_px: tuple[float, ...] = (16.0, 8.0, 4.0)
    """how far to either side of the predicted outline, one stage after the other"""
    sigma_px: float = 1.5
    """how far a model's outline is from a real one"""
    correlation_px: float = 10.0
    """along how much of the outline that error stays the same"""


@dataclass(frozen=True)
class IntensitySettings:
    """How the model's texture, carried from the frame before, pulls."""

    weight: float = 0.0
    """0: no texture is carried; `--use intensity` makes it 1"""
    smooth_px: tuple[float, ...] = (4.0, 2.0, 1.0)
    """by how much images are smoothed, one stage after the other"""
    sigma: float = 10.0
    """how far a point's colour is from what it was [grey levels of 0 … 255]"""
    memory: float = 0.5
    """share of the texture that is carried from the first frame, whose pose was given; the rest from the last one"""
    correlation_px: float = 6.0
    """over how much of the image that error stays the same"""


@dataclass(frozen=True)
class KeypointSettings:
    """How given points pull."""

    weight: float = 1.0
    sigma_mm: float = 8.0
    """how well a first frame's keypoints are known, and joints of one hand agree with another's"""
    sigma_px: float = 5.0
    """how far a detector's 2D joints are from the model's, where it is sure of them"""


@dataclass(frozen=True)
class PriorSettings:
    """What is assumed where nothing is seen."""

    rest_sigma_deg: float = 80.0
    """how far joint angles are from the relaxed hand's; 0 switches the prior off"""
    posture: float = 1.0
    """strength of what is known of joints that go together (neighbouring fingers, last two joints); 0: none"""
    collision: bool = True
    """a body's parts keep out of each other; hands are left alone"""
    motion_sigma_deg: float = 12.0
    """how far a joint angle, and the hand's turn, is from its prediction one frame later"""
    motion_sigma_mm: float = 15.0
    """how far the wrist is from its prediction one frame later"""


@dataclass(frozen=True)
class FollowSettings:
    """From frame to frame."""

    prediction: str = "constant_velocity"
    """`constant_velocity` or `none` (start where the last frame ended)"""
    smoothing: float = 1.0
    """strength of the pull towards the prediction; 0 switches it off"""
    escape: bool = True
    """look for lost fingers over their whole range when a frame fits worse than usual"""
    escape_every: int = 16
    """and in every so many frames however well it fits, since a finger hidden in a fist may settle wrongly; 0: never"""
    jumps: bool = True
    """look for a hand in doubt or lost again, around where it was last and with fingers flipped; taken only where it fits
    clearly better"""
    hypotheses: int = 1
    """how many poses are carried from frame to frame where one view leaves several open; 1: one, without sampling"""
    doubtful_overlap: float = 0.65
    """a frame whose silhouettes overlap less (intersection over union) is doubtful"""
    lost_overlap: float = 0.45
    """and less than this: lost"""
    doubtful_part: float = 0.5
    """a frame in which less of two neighbouring bones lies inside a silhouette is doubtful; 0: never"""
    doubtful_cloud: float = 0.7
    """a frame with a smaller share of its points within 6 mm of the surface is doubtful"""
    lost_cloud: float = 0.35
    """and a smaller share than this: lost"""
    doubtful_mm: float = 15.0
    """a frame whose hand may be further off than this, by its own covariance (root mean square of the joints' standard
    deviations), is doubtful however well it fits; 0: never"""


@dataclass(frozen=True)
class TrackerSettings:
    """All settings; immutable. `with_values` gives a changed copy."""

    model: ModelSettings = field(default_factory=ModelSettings)
    silhouettes: SilhouetteSettings = field(default_factory=SilhouetteSettings)
    cloud: CloudSettings = field(default_factory=CloudSettings)
    edges: EdgeSettings = field(default_factory=EdgeSettings)
    intensity: IntensitySettings = field(default_factory=IntensitySettings)
    keypoints: KeypointSettings = field(default_factory=KeypointSettings)
    prior: PriorSettings = field(default_factory=PriorSettings)
    solver: SolverSettings = field(default_factory=lambda: SolverSettings(iterations=30))
    tracker: FollowSettings = field(default_factory=FollowSettings)
    mixture: MixtureSettings = field(default_factory=MixtureSettings)

    @property
    def looks_at_images(self) -> bool:
        """Whether a frame's images are needed, beside masks and clouds."""
        return self.edges.weight > 0 or self.intensity.weight > 0

    def flat(self) -> dict[str, Any]:
        """Return every setting by its dotted name."""
        return {
            f"{group.name}.{item.name}": getattr(getattr(self, group.name), item.name)
            for group in fields(self)
            for item in fields(getattr(self, group.name))
        }

    def with_values(self, values: Mapping[str, Any]) -> TrackerSettings:
        """Return a copy with dotted settings replaced; strings are read as their type.

        Raises HandtrackError for an unknown name (listing the known ones) or a value of a wrong kind.
        """
        settings = self
        for dotted, value in values.items():
            group, _, name = dotted.partition(".")
            if dotted not in settings.flat():
                raise unknown_name("setting", dotted, sorted(settings.flat()))
            table = getattr(settings, group)
            kind = get_type_hints(type(table))[name]
            changed = replace(table, **{name: _converted(value, kind, dotted)})
            settings = replace(settings, **{group: changed})
        _check(settings)
        return settings


def _converted(value: Any, kind: Any, name: str) -> Any:
    try:
        if kind is bool:
            return _boolean(value)
        if get_origin(kind) is tuple:
            items = value.split(",") if isinstance(value, str) else value
            return tuple(get_args(kind)[0](item) for item in items)
        if kind in (float, int):
            number = float(_boolean(value)) if _is_boolean(value) else float(value)
            if number != number or abs(number) == float("inf") or kind(number) != number:
                raise ValueError
            return kind(number)
        return str(value).lower() if isinstance(value, bool) else str(value)
    except (TypeError, ValueError):
        label = getattr(kind, "__name__", str(kind))
        raise HandtrackError(
            f"setting '{name}': expected a value of kind {label}, found {value!r}."
        ) from None


def _is_boolean(value: Any) -> bool:
    return isinstance(value, bool) or str(value).lower() in ("true", "false")


def _boolean(value: Any) -> bool:
    if not _is_boolean(value):
        raise ValueError
    return str(value).lower() == "true"


_CHOICES = {
    "model.coupling": ("26", "21", "18"),
    "model.fallback": ("auto", "glove9", "ball6", "none"),
    "model.forearm": ("auto", "true", "false"),
    "silhouettes.term": ("coverage", "conic_field"),
    "solver.limits": ("bounds", "projection"),
    "tracker.prediction": ("constant_velocity", "none"),
    "mixture.sequence": ("best", "path", "smooth"),
}
_POSITIVE = (
    "silhouettes.outline_sigma_mm", "silhouettes.outline_correlation_mm", "keypoints.sigma_mm", "keypoints.sigma_px",
    "cloud.sigma_mm",
    "cloud.patch_mm",
    "cloud.crop_mm",
    "edges.sigma_px", "edges.correlation_px", "intensity.sigma", "intensity.correlation_px",
    "prior.motion_sigma_deg", "prior.motion_sigma_mm", "solver.iterations", "solver.damping",
    "tracker.hypotheses", "mixture.descents", "mixture.scale",
)  # fmt: skip


def _check(settings: TrackerSettings) -> None:
    flat = settings.flat()
    for name, choices in _CHOICES.items():
        if flat[name] not in choices:
            raise HandtrackError(
                f"setting '{name}': expected one of {', '.join(choices)}, found '{flat[name]}'."
            )
    for name, value in flat.items():
        above, least = ("above", 1e-12) if name in _POSITIVE else ("of at least", 0.0)
        signed = name.startswith("model.spread_")
        if isinstance(value, (int, float)) and value < least and not signed:
            raise HandtrackError(f"setting '{name}': expected a number {above} 0, found {value}.")
    if settings.intensity.memory > 1:
        raise HandtrackError(
            f"setting 'intensity.memory': expected a share between 0 and 1, found {settings.intensity.memory}."
        )
    if settings.cloud.balance > 1:
        raise HandtrackError(
            f"setting 'cloud.balance': expected K between 0 and 1, found {settings.cloud.balance}."
        )
    if not any(flat[name] for name in flat if name.startswith("model.spread_")):
        raise HandtrackError(
            "settings 'model.spread_index' … 'model.spread_little' are all 0: no finger would ever spread."
        )
    for name, least in (("edges.search_px", 1.0), ("intensity.smooth_px", 0.0)):
        if not flat[name] or min(flat[name]) < least:
            raise HandtrackError(
                f"setting '{name}': expected numbers of at least {least:g}, found {flat[name]}."
            )
    bands = settings.silhouettes.bands_mm
    if not bands or min(bands) <= 0:
        raise HandtrackError(
            f"setting 'silhouettes.bands_mm': expected widths above 0, found {bands}."
        )
