"""FrameResult: the pose found for one frame. TrackResult: those of a whole sequence, stacked, with the model that they are of, and as
tables and arrays with named axes.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from html import escape
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any, TypeVar, dataclass_transform

import numpy as np

from handtrack.arrays import (
    D2,
    D3,
    D4,
    D21,
    Array,
    Axes,
    B,
    F,
    Floats,
    J,
    K,
    P,
    S,
    array_dataclass,
    indices,
)
from handtrack.errors import HandtrackError, unknown_name
from handtrack.model.articulated import (
    FINGERS,
    JOINT_CENTRES,
    ArticulatedModel,
    HandScale,
    Landmarks,
    definition_among,
    keypoint_names,
)
from handtrack.model.model_file import (
    MODELS,
    load_model,
    model_from_definition,
    scale_from,
    scale_table,
)
from handtrack.tracking.frame.motion_belief import MotionBelief
from handtrack.tracking.frame.reason import Reason, Status
from handtrack.tracking.frame.result_fields import (
    Column,
    column,
    columns,
    joined,
    per_frame,
    pose,
    result_fields,
    stacked,
    tensor,
    vector,
)
from handtrack.version import VERSION

if TYPE_CHECKING:
    import pandas
    import xarray

PARTS = ("palm", *FINGERS)
"""of a hand, of which it is said how probably each is off"""
_PARAMETERS = "rad; m for root_tx, root_ty, root_tz"


@array_dataclass
class Alternative:
    """One of several poses that may be a frame's, where `tracker.hypotheses` is above 1."""

    parameters: Floats[S]
    """joint parameters [m, rad]"""
    energy: float
    weight: float
    """share of the posterior among the frame's hypotheses"""
    parent: int
    """which of the frame before's it continues; −1 in a first frame"""
    origin: str
    """how it was found: followed, or by which jump"""


def _reason(_words: str, kind: str, where: Array[D2], numbers: Floats[D2]) -> Reason | None:
    if not kind:
        return None
    (part, camera), (number, other) = where.tolist(), numbers.tolist()
    return Reason(str(kind), part, camera, number, other)


def _energies(values: Floats[K], names: tuple[str, ...]) -> dict[str, float]:
    pairs = zip(names, values.tolist(), strict=True)
    return {name: value for name, value in pairs if np.isfinite(value)}


def _alternatives(*rows: Array) -> tuple[Alternative, ...]:
    """Return the poses of rows in the order of Alternative's fields."""
    poses = zip(*rows, strict=True)
    return tuple(
        Alternative(p.copy(), float(energy), float(weight), int(parent), str(origin))
        for p, energy, weight, parent, origin in poses
        if np.isfinite(weight)
    )


def _carried(name: str, *axes: str, kind: type = float, missing: object = np.nan) -> Column:
    """Return how a field of Alternative is kept: (F, H, …), `missing` beyond a frame's last pose."""
    return Column(
        kind,
        ("H", *axes),
        missing,
        gaps="dropped",
        turned=lambda array, turn: None,  # that is not said of a turned world
        read=lambda poses: [getattr(p, name) for p in poses],
    )


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class FrameHead:
    """What is said of a frame's pose without its arrays."""

    frame: int = field(metadata=column(meaning="number of the frame, from 0"))
    time_s: float = field(metadata=column(finite=True, unit="s", meaning="time [s]"))
    status: Status = field(
        metadata=column(
            join=Status,
            meaning="0 tracked, 1 doubtful, 2 lost (holds the last estimate), 3 set by hand",
        )
    )
    energy: float = field(metadata=column(meaning="final cost; comparable within a session only"))
    """NaN where nothing was seen"""
    iterations: int
    energies: Mapping[str, float] = field(
        default_factory=dict,
        metadata=columns(
            _energies, energies=Column(axes=("T",), gaps="dropped", names="energy_names")
        ),
    )
    """each term's part of the energy, by the term's name; stacked (F, T), NaN where a frame has no such term"""
    reason: Reason | None = field(
        default=None,
        metadata=columns(
            _reason,
            reason=Column(
                str,
                missing="",
                gaps="missing",
                read=lambda r: r.words,
                meaning="why the frame has low confidence or is lost",
            ),
            reason_kind=Column(str, missing="", gaps="dropped", read=lambda r: r.kind),
            reason_where=Column(str, (2,), "", gaps="dropped", read=lambda r: (r.part, r.camera)),
            reason_numbers=Column(float, (2,), gaps="dropped", read=lambda r: (r.number, r.other)),
        ),
    )
    """stacked in words, and by kind, place and numbers"""
    p_off_25mm: float = field(
        default=float("nan"),
        metadata=column(
            gaps="missing",
            meaning="probability that some joint's error exceeds 25 mm, constant offsets of definition removed",
        ),
    )
    """NaN where nothing is said"""
    views: int = field(
        default=0,
        metadata=column(
            gaps="missing", meaning="number of silhouettes, clouds and images in the cost"
        ),
    )
    """0: not known"""

    def __repr__(self) -> str:
        note = f": {self.note}" if self.note else ""
        return f"<{type(self).__name__}: frame {self.frame}, {self.status.words}{note}>"

    @property
    def note(self) -> str:
        """Why the frame is doubtful or lost, in words; empty where it is neither."""
        return "" if self.reason is None else self.reason.words

    @property
    def reason_kind(self) -> str:
        """Of what kind the reason is, one of KINDS; empty where there is none."""
        return "" if self.reason is None else self.reason.kind

    @property
    def poor_cloud(self) -> bool:
        """Whether its cloud agreed with the hand so badly that the depths were doubted."""
        return self.reason_kind == "poor cloud"

    @property
    def clutters(self) -> bool:
        """Whether its cloud is poor, or shows other things beside the hand: a better fit tells little there."""
        return self.poor_cloud or (self.reason_kind == "cloud" and self.status != Status.LOST)

    @property
    def is_simplified(self) -> bool:
        """Whether a simpler hand took the whole one's place, so that nothing is said of the fingers."""
        return self.poor_cloud and self.reason is not None and self.reason.part != ""

    @property
    def fits(self) -> bool:
        """Whether the pose explains what was seen, be it much or little: nothing is gained by looking for another. It may be doubtful
        for all that: as the pose that tracking began with is, as nobody has such a hand, or as its joints may be elsewhere.
        """
        kinds = ("start", "size", "open", "off", "far off")
        return self.status == Status.TRACKED or self.reason_kind in kinds


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class FrameResult(FrameHead):
    """The pose of one frame, all of which is saved. A lost frame holds the last estimate, with infinite parameter_std."""

    parameters: Floats[S] = field(metadata=column(finite=True, unit=_PARAMETERS))
    """joint parameters [m, rad], all of the model's, whatever the coupling"""
    parameter_std: Floats[S] = field(
        metadata=column(missing=np.inf, gaps="missing", unit=_PARAMETERS)
    )
    """[m, rad]; infinite where unobservable"""
    joint_covariance: Floats[J, D3, D3] = field(metadata=column(turned=tensor, unit="m2"))
    """[m²]"""
    T_world_bone: Floats[B, D4, D4] = field(metadata=column(finite=True, turned=pose, unit="m"))
    """bone → world"""
    joint_positions: Floats[J, D3] = field(metadata=column(finite=True, turned=vector, unit="m"))
    """world [m]"""
    keypoints21: Floats[D21, D3] | None = field(
        default=None, metadata=column(finite=True, turned=vector, unit="m")
    )
    """world [m]; hands only"""
    p_off_10mm: Floats[K] | None = field(
        default=None,
        metadata=column(
            gaps="missing",
            names="part_names",
            known_names=PARTS,
            meaning="probability that the error of some joint of {} exceeds 10 mm",
        ),
    )
    """hands only"""
    alternatives: tuple[Alternative, ...] = field(
        default=(),
        metadata=columns(
            _alternatives,
            hypothesis_parameters=_carried("parameters", "S"),
            hypothesis_energy=_carried("energy"),
            hypothesis_weight=_carried("weight"),
            hypothesis_parent=_carried("parent", kind=int, missing=-1),
            hypothesis_origin=_carried("origin", kind=str, missing=""),
        ),
    )
    """all poses carried on, heaviest first, where `tracker.hypotheses` is above 1; the first is this result's pose"""


@array_dataclass
class Step:
    """A frame that is solved, with what those after it need of it: what a store keeps to go on from."""

    result: FrameResult
    belief: Floats[P, P] | None = None
    """covariance of the solver parameters; None where nothing is said of them"""
    beliefs: tuple[MotionBelief, ...] = ()
    """how each of the result's alternatives moves, where several poses are carried along"""
    search_due: bool = False
    """a search would have been made, had it been allowed (`Control.searches`); not kept"""


FIELDS = result_fields(fields(FrameResult))
"""fields of a frame's result"""
COLUMNS = {name: column for known in FIELDS.values() for name, column in known.columns.items()}
"""arrays of a sequence, which they are stacked into"""


def is_length(parameter: str) -> bool:
    """Return whether a joint parameter is a translation [m]; the others are angles [rad]."""
    return parameter.endswith(("_tx", "_ty", "_tz"))


def unconfirmed(result: FrameResult, confidence: float) -> FrameResult:
    """Return a frame as doubtful for the pose that tracking began with. confidence: of that, 0 to 1."""
    return replace(result, status=Status.DOUBTFUL, reason=Reason("start", number=confidence))


@dataclass(frozen=True)
class TrackLabels:
    """What the numbers of a tracked sequence mean, and where they come from: the same for all its frames."""

    parameter_names: tuple[str, ...] = field(metadata=column(axes=("S",)))
    bone_names: tuple[str, ...] = field(metadata=column(axes=("B",)))
    joint_names: tuple[str, ...] = field(metadata=column(axes=("J",)))
    model: str = ""
    side: str = ""
    scale: str = ""
    """JSON: the hand's size, overall and by finger"""
    session: str = ""
    settings: str = ""
    """JSON: every setting by its dotted name"""
    version: str = ""
    start_confidence: float | None = None
    """how sure the first pose was, 0 to 1, where the program found it"""
    hand_length_mm: float | None = None
    """from the wrist to the middle finger's tip, where the size was fitted"""
    hand_length_std_mm: float | None = None
    """its standard deviation"""
    definition: str | None = None
    """JSON of the model's definition: with side and scale the model can be built again"""
    fps: float | None = None
    """[1/s] of the recording; the median where frames have times of their own"""
    cameras: str | None = None
    """JSON: name, size, matrix, distortions, rotation, translation [m] of each, as calibration.toml has them"""
    refinement: str | None = None
    """JSON of `tracking.whole.refinement.Refinement`: what was found that all frames share"""

    @classmethod
    def of(cls, model: ArticulatedModel, **more: Any) -> TrackLabels:
        """Return the labels of a model's results by this version; more: the other fields."""
        bones, joints = tuple(model.skeleton.bone_names), tuple(model.joint_names)
        names = model.parameter_names, bones, joints, model.name, model.side
        own: dict[str, Any] = {
            "scale": json.dumps(scale_table(model.scale)),
            "definition": model.definition_text,
        }
        return cls(*names, version=VERSION, **own | more)

    def track(self, frames: Iterable[FrameResult]) -> TrackResult:
        """Return frames as one result, ascending; of several of one number the last counts. Raises HandtrackError for none."""
        latest = {one.frame: one for one in frames}
        if not latest:
            raise HandtrackError("no frame was tracked; a result holds at least one.")
        frames = [latest[number] for number in sorted(latest)]
        track = TrackResult(**vars(self) | stacked(FIELDS, frames))
        named = (len(self.parameter_names), len(self.bone_names), len(self.joint_names))
        found = (
            track.parameters.shape[1],
            track.T_world_bone.shape[1],
            track.joint_positions.shape[1],
        )
        assert found == named, f"{found} parameters, bones, joints; {named} names"
        return track


_Class = TypeVar("_Class", bound=type)


@dataclass_transform(kw_only_default=True, frozen_default=True)
def _with_columns(own: _Class) -> _Class:
    """Make a dataclass that has an array for each of COLUMNS beside its own fields; those that may be left out are None."""
    for name in COLUMNS:
        own.__annotations__[name] = "Array[F]"
    for known in FIELDS.values():
        if known.is_optional:
            for name in known.columns:
                setattr(own, name, None)
    return dataclass(frozen=True, eq=False, repr=False, kw_only=True)(own)


@_with_columns
class TrackResult(TrackLabels):
    """A tracked sequence of F frames in ascending order; the arrays of poses.npz (contracts §5).

    Beside its labels it has the fields of FrameResult as arrays with a row for each frame, by the names in COLUMNS; None where no
    frame has any.
    """

    energy_names: tuple[str, ...] | None = field(default=None, metadata=column(axes=("T",)))
    """terms of the energy; None where they were not kept"""
    part_names: tuple[str, ...] | None = field(default=None, metadata=column(axes=("K",)))
    """PARTS"""
    take: int | None = None
    """number of the take in the session's store that it is"""
    pins: str | None = None
    """JSON, as the session's pins.json: where a person pointed at joints"""
    keypoint_definition: str | None = None
    """whose points `joint_positions` and `keypoints21` are, where `in_landmarks` was asked for others than the model's own"""

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any: ...

    def __len__(self) -> int:
        return len(self.frame)

    def __getitem__(self, row: int) -> FrameResult:
        """Return the frame in a row, from 0 or from the end; `at` takes frame numbers."""
        return self._rows([range(len(self))[row]])[0]

    def __repr__(self) -> str:
        counts = [(int((self.status == s).sum()), s.words) for s in Status]
        found = ", ".join(f"{count} {name}" for count, name in counts if count)
        what = " ".join(filter(None, (self.side, self.model)))
        return (
            f"<TrackResult: {len(self)} frames of {what or 'a model'}, {self.frame[0]} to {self.frame[-1]} ({found}); "
            f"{len(self.parameter_names)} parameters, {len(self.joint_names)} joints>"
        )

    def _repr_html_(self) -> str:
        """Return the same for notebooks, with what the frames of low confidence lack most often."""
        why = (
            Counter(text for text in self.reason if text) if self.reason is not None else Counter()
        )
        rows = [("frames", f"{len(self)}, {self.frame[0]} to {self.frame[-1]}")]
        rows += [(s.words, f"{int((self.status == s).sum())}") for s in Status]
        rows += [("model", " ".join(filter(None, (self.side, self.model))))]
        if self.hand_length_mm is not None:
            rows += [("length", f"{self.hand_length_mm:.0f} mm")]
        rows += [
            ("parameters", ", ".join(self.parameter_names[:8]) + ", …"),
            ("joints", f"{len(self.joint_names)}"),
        ]
        rows += [("most often", escape(f"{text} ({count})")) for text, count in why.most_common(2)]
        cells = "".join(f"<tr><th>{name}</th><td>{value}</td></tr>" for name, value in rows)
        return f"<table><caption>TrackResult</caption>{cells}</table>"

    def angle(self, name: str, degrees: bool = True) -> Floats[F]:
        """Return a joint's angle in every frame, such as `index_pip_flex`. Raises HandtrackError for a name it does not have."""
        angles = [n for n in self.parameter_names if not is_length(n)]
        if name not in angles:
            raise unknown_name("angle", name, angles)
        value = self.parameters[:, self.parameter_names.index(name)]
        return np.rad2deg(value) if degrees else value.copy()

    def std(self, name: str, degrees: bool = True) -> Floats[F]:
        """Return an angle's standard deviation in every frame; infinite where it is open. Raises HandtrackError as `angle`."""
        self.angle(name)
        value = self.parameter_std[:, self.parameter_names.index(name)]
        return np.rad2deg(value) if degrees else value.copy()

    def joint(self, name: str) -> Floats[F, D3]:
        """Return a joint's place in every frame, world [m]. Raises HandtrackError for a name it does not have."""
        if name not in self.joint_names:
            raise unknown_name("joint", name, self.joint_names)
        return self.joint_positions[:, self.joint_names.index(name)].copy()

    def to_dataframe(self) -> pandas.DataFrame:
        """Return a table with a row for each frame (its index): the columns of the CSV, and each angle's standard deviation.

        Angles in degrees, places in metres, as their names say. Raises HandtrackError where pandas is not installed.
        """
        columns = {name: values for name, values, _ in frame_columns(self, with_std=True)}
        index = _library("pandas").Index(columns.pop("frame"), name="frame")
        return _library("pandas").DataFrame(columns, index=index)

    def to_xarray(self) -> xarray.Dataset:
        """Return a dataset with the axes time, space, keypoints, individuals and parameter, as `movement` takes it and
        `handtrack export --to netcdf` writes it, in radians and metres; positions of lost frames are NaN.

        Raises HandtrackError where xarray is not installed.
        """
        coordinates, known, attributes = labelled(self)
        arrays = {n: (axes, values, {"units": unit}) for n, (axes, values, unit) in known.items()}
        words = {name: (name, np.asarray(values)) for name, values in coordinates.items()}
        return _library("xarray").Dataset(arrays, words, attributes)

    @cached_property
    def landmark_definitions(self) -> Mapping[str, Landmarks]:
        """The points that it has besides the model's joints, in their bones' frames, by whose they are: first those fitted to
        the person, such as `mediapipe21`, then those of the mean person, `mediapipe21 (mean)`, and on the skin, `surface21`.
        """
        try:
            known = model_of(self).landmark_definitions
        except HandtrackError:  # of a program that does not say how its model is built
            return {}
        return {name: points for name, points in known.items() if name != JOINT_CENTRES}

    @property
    def landmark_definition(self) -> str | None:
        """Whose points `landmarks` are: the first of `landmark_definitions`; None where it has none."""
        return next(iter(self.landmark_definitions), None)

    @cached_property
    def landmarks(self) -> Floats[F, D21, D3] | None:
        """The keypoints as a detector or a marker set means them, world [m]: joint centres plus constant offsets; hands only."""
        name = self.landmark_definition
        return None if name is None else self.in_landmarks(name).keypoints21

    @property
    def landmark_covariance(self) -> Floats[F, D21, D3, D3] | None:
        """[m²] of the landmarks: of their joints, on whose bones they are, and of people's offsets about the mean ones. With the pose
        alone unknown a fitted one's is the same to a tenth (standard deviations, marked real hand); of its offset nothing is said.
        """
        name = self.landmark_definition
        if name is None or self.keypoints21 is None:
            return None
        rows = indices(self.joint_names, keypoint_names())
        return self.in_landmarks(name).joint_covariance[:, rows]

    def in_landmarks(self, definition: str, source: str = "this result") -> TrackResult:
        """Return the same with the points of another definition as joints and keypoints: `joints`,
        or one of `landmark_definitions`, of which it takes the mean one for a detector's without fitted offsets.

        Parameters
        ----------
        source
            Where it is from, for errors.

        Raises
        ------
        HandtrackError
            For a definition in which it has none.
        """
        if definition == (self.keypoint_definition or JOINT_CENTRES):
            return self
        model = model_of(self, source)
        known = model.landmark_definitions
        name = definition_among(known, definition)
        if name is None:
            raise HandtrackError(
                f"{source}: no landmarks '{definition}'; it has {' and '.join(known)}. Those of a detector are found where two "
                "cameras or more see its joints from different sides, or come with a person's saved hand."
            )
        T = self.T_world_bone[:, model.joint_bone]
        places = np.einsum("fjab,jb->fja", T[..., :3, :3], known[name].point) + T[..., :3, 3]
        before = known[definition_among(known, self.keypoint_definition) or JOINT_CENTRES]
        more = known[name].sigma_m ** 2 - before.sigma_m**2
        rows = [self.joint_names.index(n) for n in keypoint_names() if n in self.joint_names]
        keypoints = None if self.keypoints21 is None else places[:, rows]
        return replace(
            self,
            joint_positions=places,
            joint_covariance=self.joint_covariance + more[:, None, None] * np.eye(3),
            keypoints21=keypoints,
            keypoint_definition=None if name == JOINT_CENTRES else name,
        )

    @property
    def labels(self) -> TrackLabels:
        """What its numbers mean, without the numbers."""
        return TrackLabels(
            **{entry.name: getattr(self, entry.name) for entry in fields(TrackLabels)}
        )

    def between(self, frames: range) -> TrackResult:
        """Return the part whose frame numbers lie in `frames`. HandtrackError when there is none."""
        rows = np.flatnonzero(np.isin(self.frame, np.asarray(frames)))
        if not len(rows):
            raise HandtrackError(
                f"no tracked frame between {frames.start} and {frames.stop - 1}; "
                f"this result has frames {self.frame[0]} to {self.frame[-1]}."
            )
        part = {name: getattr(self, name) for name in COLUMNS}
        return replace(self, **{n: None if a is None else a[rows] for n, a in part.items()})

    def at(self, frame: int) -> FrameResult:
        """Return one frame, by its number. HandtrackError when it was not tracked."""
        rows = np.flatnonzero(self.frame == frame)
        if not len(rows):
            raise HandtrackError(
                f"frame {frame} was not tracked; this result has {len(self)} frames from "
                f"{self.frame[0]} to {self.frame[-1]}."
            )
        return self._rows(rows[:1])[0]

    def frames(self) -> list[FrameResult]:
        """Return every frame as an own result, as the tracker gave them."""
        return self._rows(range(len(self)))

    def _rows(self, rows: Iterable[int]) -> list[FrameResult]:
        return [FrameResult(**known) for known in joined(FIELDS, self, rows)]


def _library(name: str) -> ModuleType:
    """Return an optional library; HandtrackError that says how to install it."""
    try:
        return import_module(name)
    except ImportError:
        raise HandtrackError(
            f"{name} is not installed, which this table is made with: `pip install {name}`, or handtrack with the extra "
            "`tables`. Without it, `parameters` and `joint_positions` are plain arrays, with `parameter_names` and `joint_names`."
        ) from None


def model_of(track: TrackResult, source: str = "this result") -> ArticulatedModel:
    """Return the model that a result was tracked with, of the same size, without couplings.

    It is built from the result's definition; without one (format 1), a shipped model of that name
    is taken if it has the same bones, parameters and joints.

    Parameters
    ----------
    source
        Where the result is from, for errors.

    Raises
    ------
    HandtrackError
    """
    size, side = _scale(track, source), track.side or "right"
    forearm = "forearm" in track.bone_names
    if track.definition is not None:
        model = model_from_definition(track.definition, side, size, forearm, source)
    elif track.model in MODELS:
        model = load_model(track.model, side, size, forearm=forearm)
    else:
        raise HandtrackError(
            f"{source}: how its model '{track.model}' is built is not in the file, and no model of that name comes with "
            f"handtrack ({', '.join(MODELS)}). Files of format 1 do not have it: track the session again."
        )
    for what, theirs, ours in (
        ("bones", track.bone_names, model.skeleton.bone_names),
        ("parameters", track.parameter_names, model.parameter_names),
        ("joints", track.joint_names, model.joint_names),
    ):
        if tuple(theirs) != tuple(ours):
            odd = sorted(set(theirs) ^ set(ours)) or ["their order"]
            raise HandtrackError(
                f"{source}: its {what} are not those of the model '{track.model}' ({', '.join(odd[:3])} differ). Was the "
                "file made with another definition of that name? Track the session again."
            )
    return model


def _scale(track: TrackResult, source: str) -> HandScale:
    if not track.scale:
        return HandScale()
    try:
        table = json.loads(track.scale)
    except ValueError as error:
        raise HandtrackError(f"{source}: its `scale` is no JSON ({error}).") from None
    return scale_from(table, source)


# ---- tables and arrays

_USUAL_FPS = 30.0  # of a single frame, which says nothing of the rate
_XYZ = ("x", "y", "z")
_BEFORE_OTHERS = ("p_off_25mm", "p_off_10mm", "reason")
"""in this order after the joints, since scripts may read columns by position; what is declared later comes after them"""


def labelled(
    track: TrackResult,
) -> tuple[
    dict[str, Sequence[str] | Array[F]],
    dict[str, tuple[tuple[str, ...], Array[*Axes], str]],
    dict[str, str | float],
]:
    """Return what stands along each axis: `time` [s], else words; the axes, values and unit of a track's arrays, positions of lost frames
    being NaN; and attributes.

    The arrays are `position`, `position_std`, `position_covariance` and `confidence` by keypoint, `angle` and
    `angle_std` by parameter, `T_world_bone` by bone, `frame`, `status`, `energy`, and where they are known those of `per_frame`,
    such as `views`, `p_off_25mm`, `p_off_10mm` by part, `reason`.
    """
    time, angles = ("time",), ("time", "parameter")
    points = (*time, "space", "keypoints", "individuals")
    covariance = track.joint_covariance
    std = np.sqrt(np.maximum(np.diagonal(covariance, axis1=2, axis2=3), 0.0))
    lost = track.status == Status.LOST

    def shown(values: Array[*Axes]) -> Array:
        """(F, J, …) → (F, …, J, 1)."""
        hidden = lost.reshape(-1, *[1] * (values.ndim - 1))
        return np.moveaxis(np.where(hidden, np.nan, values), 1, -1)[..., None]

    coordinates: dict[str, Sequence[str] | Array[F]] = {
        "time": track.time_s,
        "space": _XYZ,
        "space_2": _XYZ,
        "keypoints": track.joint_names,
        "individuals": (track.side if track.keypoints21 is not None else track.model,),
        "parameter": track.parameter_names,
        "bone": track.bone_names,
    }
    named = {
        "position": (points, shown(track.joint_positions), "joint_positions"),
        "position_std": (points, shown(std), "joint_positions"),
        "position_covariance": (
            (*points[:2], "space_2", *points[2:]),
            shown(covariance),
            "joint_covariance",
        ),
        "confidence": (("time", *points[2:]), joint_confidence(track)[..., None], "p_off_25mm"),
        "angle": (angles, track.parameters, "parameters"),
        "angle_std": (angles, track.parameter_std, "parameter_std"),
        "T_world_bone": (("time", "bone", "row", "column"), track.T_world_bone, "T_world_bone"),
        **{name: (time, getattr(track, name), name) for name in ("frame", "status", "energy")},
    }
    arrays = {name: (*array, COLUMNS[of].unit) for name, (*array, of) in named.items()}
    for name, kept in per_frame(FIELDS):
        if (values := getattr(track, name)) is not None:
            axes = (kept.names.removesuffix("_names"),) if kept.names else ()
            coordinates |= {axis: getattr(track, kept.names) for axis in axes}
            arrays[name] = ((*time, *axes), values, kept.unit)
    attributes = {
        "source_software": "handtrack",
        "ds_type": "poses",
        "fps": frame_rate(track),
        "time_unit": "seconds",
        "session": track.session,
        "model": track.model,
        "side": track.side,
        "keypoint_definition": track.keypoint_definition or JOINT_CENTRES,
    }
    return coordinates, arrays, attributes


def frame_columns(
    track: TrackResult, with_std: bool = False
) -> Iterator[tuple[str, Array[F], str]]:
    """Yield the columns of a table with a row for each frame: name, values and meaning.

    Angles in degrees, lengths in metres.

    Parameters
    ----------
    with_std
        Each parameter's standard deviation after it.
    """
    for name in ("frame", "time_s", "status", "energy"):
        yield name, getattr(track, name), COLUMNS[name].meaning
    for row, name in enumerate(track.parameter_names):
        unit, factor, meaning = "deg", 180.0 / np.pi, "angle [°]"
        if is_length(name):
            unit, factor, meaning = "m", 1.0, "position of the root in the world [m]"
        elif name.startswith("root_r"):
            meaning = "rotation of the root in the world: a rotation vector's component [°]"
        yield f"{name}_{unit}", factor * track.parameters[:, row], meaning
        if with_std:
            std = factor * track.parameter_std[:, row]
            yield f"{name}_std_{unit}", std, f"its standard deviation: {meaning}"
    for row, name in enumerate(track.joint_names):
        for axis, values in zip(_XYZ, track.joint_positions[:, row].T, strict=True):
            yield f"{name}_{axis}_m", values, f"{axis} of {name} in the world [m]"
    later = dict(per_frame(FIELDS))
    for name, kept in ({name: later[name] for name in _BEFORE_OTHERS} | later).items():
        if (values := getattr(track, name)) is not None:
            along = getattr(track, kept.names) if kept.names else ("",)
            for thing, own in zip(along, values.reshape(len(track), -1).T, strict=True):
                yield f"{name}_{thing}".rstrip("_"), own, kept.meaning.format(thing)


def frame_rate(track: TrackResult) -> float:
    """Return the frames a second of the recording; of its times where it was not kept."""
    if track.fps is not None:
        return track.fps
    steps = np.diff(track.time_s) / np.diff(track.frame)
    return float(1.0 / np.median(steps)) if len(steps) else _USUAL_FPS


def joint_confidence(track: TrackResult) -> Floats[F, J]:
    """Return how far each joint can be trusted, 0 to 1: 0 in lost frames; else 1 − P (its finger is more than 10 mm off), 1 −
    P (some joint is more than 25 mm off) where that alone is known, 1 where nothing is.
    """
    sure = np.ones((len(track), len(track.joint_names)))
    if track.p_off_25mm is not None:
        sure[:] = 1.0 - np.nan_to_num(track.p_off_25mm)[:, None]
    if track.p_off_10mm is not None and track.part_names is not None:
        parts = track.part_names
        for column, part in zip(track.p_off_10mm.T, parts, strict=True):
            own = np.array([_part(name, parts) == part for name in track.joint_names])
            known = np.isfinite(column)
            sure[np.ix_(known, own)] = 1.0 - column[known, None]
    sure[track.status == Status.LOST] = 0.0
    return sure


def _part(joint: str, parts: tuple[str, ...]) -> str:
    """Return the part of a hand that a joint belongs to: its finger, else the palm, which comes first."""
    finger = joint.split("_", maxsplit=1)[0]
    return finger if finger in parts else parts[0]
