"""ArticulatedModel = skeleton + couplings + limits + flesh + named joints."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, Any

import numpy as np
from msgspec import Meta

from handtrack.arrays import (
    D3,
    D6,
    D21,
    Array,
    Axes,
    B,
    Floats,
    Ints,
    J,
    K,
    N,
    P,
    S,
    array_dataclass,
    check_shape,
    indices,
)
from handtrack.errors import HandtrackError
from handtrack.model import kinematics
from handtrack.model.ellipsoids import Ellipsoids
from handtrack.model.kinematics import BonePoses, Skeleton
from handtrack.model.part_mesh import Superquadrics
from handtrack.model.transform import Limits, MovingLimits, ParameterTransform, moving_limits

FINGERS: tuple[str, ...] = ("thumb", "index", "middle", "ring", "little")
HAND_PARTS: tuple[str, ...] = (*FINGERS, "forearm")
BODY_PARTS: tuple[str, ...] = (
    "trunk",
    "head",
    "clavicles",
    "upper_arms",
    "forearms",
    "hands",
    "thighs",
    "shins",
    "feet",
)


JOINT_CENTRES = "joints"
"""the definition of the model's own points: joint centres, and fingertips on the skin"""
UNNAMED_LANDMARKS = "detector"
"""of offsets of which nobody says whose points they lead to"""
SURFACE_MARKS = "surface21"
"""points on the skin of the back of the hand above the joints, and fingertips"""
MEAN = " (mean)"
"""what follows a definition's name where the offsets are those of other people"""
_FAR = 100.0  # [m] nothing is further from the world's origin
_Offset = Annotated[float, Meta(gt=-100, lt=100)]  # half a hand: beyond, a file is not meant
_CONTRADICTION = 1e-6  # [m, rad] values that were written with six digits agree


@dataclass(frozen=True)
class ShapeCovariance:
    """Covariance of numbers of a person's shape: logarithms of `overall` and parts, proportions, offsets (`index_tip x`) in mm."""

    names: tuple[str, ...]
    rows: tuple[tuple[float, ...], ...]
    """the lower triangle: of each with those before it, and with itself"""

    @property
    def matrix(self) -> Floats[N, N]:
        lower = np.zeros((len(self.names), len(self.names)))
        lower[np.tril_indices(len(self.names))] = [value for row in self.rows for value in row]
        return lower + np.tril(lower, -1).T

    @classmethod
    def of(cls, names: Sequence[str], matrix: Floats[N, N]) -> ShapeCovariance:
        """Return that of a symmetric matrix."""
        rows = (tuple(row[: k + 1]) for k, row in enumerate(matrix.tolist()))
        return cls(tuple(names), tuple(rows))

    def only(self, wanted: Sequence[str]) -> ShapeCovariance:
        """Return that of some of the numbers, whatever the others are."""
        kept = [k for k, name in enumerate(self.names) if name in wanted]
        return self.of([self.names[k] for k in kept], self.matrix[np.ix_(kept, kept)])


@dataclass(frozen=True)
class HandScale:
    """A person's hand or body as factors on the definition: overall, and each part's on top of it."""

    overall: float = 1.0
    parts: dict[str, float] = field(default_factory=dict)
    """by group of bones: `thumb` … `little`, `forearm`; of a body `trunk`, `thighs` …; 1 where absent"""
    proportions: dict[str, float] = field(default_factory=dict)
    """by name, as the definition has them: breadths, depths, places of joints, in standard deviations of adults; 0 where absent"""
    offsets_mm: dict[str, tuple[_Offset, _Offset, _Offset]] = field(default_factory=dict)
    """by joint: where a detector sees it, from the joint, in its bone's frame [mm of the mean adult's right hand]; 0 where absent"""
    landmark_definition: str = field(default=UNNAMED_LANDMARKS, compare=False)
    """whose points the offsets lead to: `mediapipe21`, `openpose21`, a marker set's own name"""
    source: str = field(default="", compare=False)
    """what it was found from, in words"""
    std: dict[str, Annotated[float, Meta(ge=0, le=sys.float_info.max)]] = field(
        default_factory=dict, compare=False
    )
    """where it was fitted, standard deviations: of `length_mm` [mm], and of the logarithms of `overall` and each part"""
    covariance: ShapeCovariance | None = field(default=None, compare=False)
    """where it was fitted, how what was found of it errs together"""

    def factor(self, group: str) -> float:
        """Return the factor of a group of bones: `palm`, a finger, `forearm`."""
        return self.overall * self.parts.get(group, 1.0)


@array_dataclass
class Proportions:
    """What a standard deviation of each of K internal proportions, which a person's scale may have, changes at the bones."""

    names: tuple[str, ...]
    moves: Floats[K, B, D3]
    """of each bone's proximal end, in its parent's frame [m]"""
    stretch: Floats[K, B, D3]
    """logarithms of scale factors along each bone's own axes, of all that is fixed to it"""
    shift: Floats[K, B, D3]
    """of each bone's ellipsoids, in its frame [m]"""


@array_dataclass
class Landmarks:
    """A definition of points for the named joints."""

    point: Floats[J, D3]
    """in their bones' frames [m]"""
    sigma_m: Floats[J]
    """by how much people's differ from them along each axis; 0 of a person's own"""


@array_dataclass
class ArticulatedModel:
    """What moves and how, for one person. Solver parameters (P,) are what is estimated.

    Compared by identity, so it can be the key of a cache.
    """

    definition: Mapping[str, Any]
    """the tables that it was built from; with side, scale and forearm it can be built again"""
    side: str
    """of a body `right`: it is never mirrored"""
    scale: HandScale
    coupling: str
    skeleton: Skeleton
    transform: ParameterTransform
    limits: Limits
    ellipsoids: dict[str, Ellipsoids]
    """sets of ellipsoids: `fine` for silhouettes, `metaballs` for clouds."""
    joint_names: tuple[str, ...]
    joint_bone: Ints[J]
    """the bone that carries each named joint."""
    joint_point: Floats[J, D3]
    """in that bone's frame [m]."""
    proportions: Proportions
    offset: Floats[J, D3] | None = None
    """where a detector sees each named joint, from it, in its bone's frame [m]; None: at the joint"""
    mean_landmarks: Mapping[str, Landmarks] = field(default_factory=dict)
    """by detectors' names, where they see the joints of other people"""
    superquadrics: Superquadrics | None = None
    """the parts of a body; hands have none"""

    @property
    def name(self) -> str:
        """Of its definition."""
        return self.definition["name"]

    @property
    def kind(self) -> str:
        """`hand` or `body`."""
        return self.definition.get("kind", "hand")

    @cached_property
    def definition_text(self) -> str:
        """JSON of its definition."""
        return json.dumps(self.definition)

    @cached_property
    def groups(self) -> tuple[str, ...]:
        """(B,) which part of a person's size each bone belongs to: `palm`, a finger, `thighs` …"""
        group = {bone["name"]: bone["group"] for bone in self.definition["bone"]}
        return tuple(group[name] for name in self.skeleton.bone_names)

    @cached_property
    def rest(self) -> Floats[S]:
        """Joint parameters of the relaxed pose; the root's are zero."""
        return self._angles("rest_deg", 0.0)

    @cached_property
    def stabilise(self) -> Floats[S] | None:
        """[rad] widths of the prior that holds hard-to-measure freedoms near rest, infinite for others; None: none."""
        widths = self._angles("stabilise_deg", np.inf)
        return widths if np.isfinite(widths).any() else None

    def _angles(self, key: str, usual: float) -> Floats[S]:
        """Return what the definition says of each freedom [rad]; the root's are as usual."""
        turns = (turn for bone in self.definition["bone"] for turn in bone.get("freedoms", []))
        said = {turn["name"]: turn.get(key, usual) for turn in turns}
        return np.deg2rad([said.get(name, usual) for name in self.parameter_names])

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """All joint parameters (S), whatever the coupling."""
        return self.skeleton.parameter_names

    @property
    def has_forearm(self) -> bool:
        return "forearm" in self.skeleton.bone_names

    def is_forearm(self, bone: Ints[*Axes]) -> Array[*Axes]:
        """Return, for bones of any shape, whether they are the forearm."""
        return bone == (self.skeleton.bone("forearm") if self.has_forearm else -1)

    def joint_params(self, params: Floats[*Axes]) -> Floats[*Axes]:
        """Return the joint parameters (…, S) of solver parameters (…, P)."""
        return self.transform.joint_params(params)

    def solver_params(self, joint_params: Floats[S]) -> Floats[P]:
        """Return the solver parameters of joint parameters, the nearest that the coupling allows."""
        return self.transform.solver_params(joint_params)

    def bones(self, params: Floats[P]) -> BonePoses:
        """Return the bones' poses for solver parameters."""
        return kinematics.bone_poses(self.skeleton, self.joint_params(params))

    def linearize(self, params: Floats[P]) -> tuple[BonePoses, Floats[B, D6, S], Floats[S]]:
        """Return bone poses, twist Jacobian and joint parameters at params."""
        joint_params = self.joint_params(params)
        bones, jacobian = kinematics.linearize(self.skeleton, joint_params)
        return bones, jacobian, joint_params

    @cached_property
    def moving_limits(self) -> MovingLimits:
        """The solver parameters' limits, and what they move with."""
        return moving_limits(self.limits, self.transform)

    def bounds(self, params: Floats[*Axes]) -> Floats[*Axes]:
        """Return the solver parameters' limits (…, P, 2) that hold at params (…, P)."""
        return self.transform.reduce_bounds(self.limits.bounds(self.joint_params(params)))

    def clipped(self, params: Floats[*Axes]) -> Floats[*Axes]:
        """Return params (…, P) moved into their limits."""
        bounds = self.bounds(params)
        return np.clip(params, bounds[..., 0], bounds[..., 1])

    @cached_property
    def driving_joints(self) -> tuple[int, ...]:
        """(P,) for each solver parameter the joint parameter that stands for it."""
        known, columns = self.parameter_names, np.abs(self.transform.matrix).T
        return tuple(
            known.index(name) if name in known else int(column.argmax())
            for name, column in zip(self.transform.names, columns, strict=True)
        )

    def params_within_limits(self, joint_params: Floats[S]) -> Floats[P]:
        """Return solver parameters, within limits, for joint parameters that a person set; under a coupling the driving joints
        count, and the driven ones follow.
        """
        values = np.clip(np.nan_to_num(joint_params, nan=0.0), -_FAR, _FAR)
        rows, columns = list(self.driving_joints), np.arange(len(self.driving_joints))
        return self.clipped(values[rows] / self.transform.matrix[rows, columns])

    def bones_within_limits(self, joint_params: Floats[S]) -> BonePoses:
        """Return the bones of a pose that a person set."""
        return self.bones(self.params_within_limits(joint_params))

    def named(self, joint_params: Floats[S]) -> dict[str, float]:
        """Return joint parameters by their names."""
        return dict(zip(self.parameter_names, joint_params.tolist(), strict=True))

    def checked(self, params: Floats[P], what: str) -> Floats[P]:
        """Return solver parameters as an array of floats. Raises HandtrackError naming `what` where they are not this model's."""
        try:
            values = np.asarray(params, float)
        except (TypeError, ValueError) as error:
            raise HandtrackError(
                f"{what}: {type(params).__name__}; expected solver parameters, an array: `params` of a pose that find_pose "
                "found, or model.params_from({'name': value, …})."
            ) from error
        check_shape(
            values, (len(self.transform.names),), f"{what}: solver parameters of '{self.name}'"
        )
        if not np.isfinite(values).all():
            odd = self.transform.names[int(np.flatnonzero(~np.isfinite(values))[0])]
            raise HandtrackError(f"{what}: {odd} is not a finite number.")
        return values

    def rest_params(self) -> Floats[P]:
        """Return the solver parameters of the relaxed pose at the world's origin."""
        return self.solver_params(self.rest)

    def joint_positions(self, bones: BonePoses) -> Floats[J, D3]:
        """Return the named joints and fingertips, world [m]."""
        return bones.to_world(self.joint_bone, self.joint_point)

    def bone_ends(self, bones: BonePoses) -> Floats[B, D3]:
        """Return the distal ends of the bones, world [m]."""
        return bones.position + bones.rotation[:, :, 1] * self.skeleton.length[:, None]

    @property
    def observed_point(self) -> Floats[J, D3]:
        """Return what a detector means by each named joint, in its bone's frame [m]."""
        return self.joint_point if self.offset is None else self.joint_point + self.offset

    @property
    def landmark_definitions(self) -> dict[str, Landmarks]:
        """The definitions in which it has points for the named joints: the person's own before those of the mean and of the skin."""
        exact, own = np.zeros(len(self.joint_names)), self.scale.landmark_definition
        known = {JOINT_CENTRES: Landmarks(self.joint_point, exact)}
        if self.scale.offsets_mm:
            known[own] = Landmarks(self.observed_point, exact)
        known |= {
            name + MEAN: mean for name, mean in self.mean_landmarks.items() if name not in known
        }
        if self.kind == "hand" and self.has_keypoints21:
            is_tip = [name.endswith("_tip") for name in self.joint_names]
            skin = self.ellipsoids["fine"].skin_above(self.joint_bone, self.joint_point)
            marks = np.where(np.array(is_tip)[:, None], self.joint_point, skin)
            known[SURFACE_MARKS] = Landmarks(marks, exact)
        return known

    @property
    def has_keypoints21(self) -> bool:
        """Whether the model has all 21 joints of a hand."""
        return set(keypoint_names()) <= set(self.joint_names)

    def keypoints21(self, bones: BonePoses) -> Floats[D21, D3]:
        """Return the keypoints, world [m]: wrist, then thumb to little from base to tip; whole hands only have them."""
        names = keypoint_names()
        if not self.has_keypoints21:
            raise HandtrackError(
                f"the model '{self.name}' has no 21 hand keypoints; its joints: {self.joint_names}"
            )
        return self.joint_positions(bones)[indices(self.joint_names, names)]

    def params_from(self, values: Mapping[str, float], nearest: bool = False) -> Floats[P]:
        """Return solver parameters from joint parameters by name [m, rad].

        Those that are not given follow those that are, where the coupling ties them together, and
        are 0 elsewhere.

        Parameters
        ----------
        nearest
            Return the pose that it allows, with the least squares of what it has to change, instead of the
            second error.

        Raises
        ------
        HandtrackError
            For an unknown name, and for values that the coupling does not allow together.
        """
        joint = np.zeros(len(self.parameter_names))
        given = np.zeros(len(joint), bool)
        for name, value in values.items():
            at = self.skeleton.parameter(name)
            joint[at], given[at] = value, True
        params = self.transform.solver_params(joint, given)
        off = np.where(given, np.abs(self.joint_params(params) - joint), 0.0)
        if not nearest and off.max() > _CONTRADICTION:
            at = int(off.argmax())
            raise HandtrackError(
                f"the coupling '{self.coupling}' of '{self.name}' does not allow {self.parameter_names[at]} = {joint[at]:.4g} together "
                f"with the other values: it would be {self.joint_params(params)[at]:.4g} at the nearest. Leave out what follows from "
                "others, load the model without the coupling, or ask for the nearest pose (nearest=True)."
            )
        return params


def definition_among(known: Iterable[str], wanted: str | None) -> str | None:
    """Return the known definition of the points that are wanted, be it a person's own or the mean; None where there is none."""
    asked = (wanted or "").removesuffix(MEAN)
    return next((name for name in known if name.removesuffix(MEAN) == asked), None)


def keypoint_names() -> tuple[str, ...]:
    """Return the 21 joint names in OpenPose's order: wrist, then thumb to little, base to tip."""
    names = ["wrist"]
    for finger in FINGERS:
        joints = ("cmc", "mcp", "ip", "tip") if finger == "thumb" else ("mcp", "pip", "dip", "tip")
        names += [f"{finger}_{joint}" for joint in joints]
    return tuple(names)
