"""A person's size as parameters: how many standard deviations from the mean adult, and what they do to the bones."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property

import numpy as np

from handtrack.arrays import D3, B, Floats, Ints, J, K, N, Q, array_dataclass
from handtrack.errors import HandtrackError, index_of
from handtrack.model.articulated import (
    BODY_PARTS,
    FINGERS,
    ArticulatedModel,
    HandScale,
    keypoint_names,
)
from handtrack.model.kinematics import BoneFields, BonePoses
from handtrack.model.kinematics_kernels import scale_change_fields
from handtrack.model.shape import ShapeNumber

# adult hands differ by about this share in length (ANSUR II: 5–95 % is ±10 %); statures of men and women together by ±6 %, children
# and other markers beyond
_SIGMA = 0.10
POPULATION_SIGMA = 0.065
"""by which adult hands differ in length, as a logarithm: men 193 ± 10 mm, women 181 ± 10 mm (ANSUR II, Gordon et al. 2014), both together"""
_FINGER_SIGMA = 0.04  # and a finger's share of the hand by this (Alexander & Viktor 2010)
_ARM_SIGMA = 0.12  # forearms differ more in girth than hands in length (ANSUR II: wrist to forearm circumference)
# a detector's points lie 10 to 15 mm from the joints at the thumb's base and the knuckles, less elsewhere (measured with
# MediaPipe's on real hands): 10 mm root mean square, in three directions. OpenPose's and two others' lie 16 to 50 mm from the joint centres
# that markers say, farthest at hip and knee (Needham et al. 2021, "The accuracy of several pose estimation methods for 3D joint
# centre localisation", Sci. Rep. 11): 30 mm
_OFFSET_SIGMAS_M = {"hand": 0.010 / np.sqrt(3.0), "body": 0.030 / np.sqrt(3.0)}
_ACROSS = {
    "left_": -1.0,
    "right_": 1.0,
}  # which way x goes in the bones of a side; the middle plane has x = 0
_SEGMENT_SIGMA = 0.06  # a segment's share of stature: about ±4 % (de Leva 1996), and markers differ

_PARTS = {
    "hand": dict.fromkeys(FINGERS, _FINGER_SIGMA) | {"forearm": _ARM_SIGMA},
    "body": dict.fromkeys(BODY_PARTS, _SEGMENT_SIGMA),
}

FOREARM_END = "forearm_end"
"""the proportion that is a recording's, and no person's: where the arm ends that its masks show"""
_WITHIN = (-4.0, 4.0)  # standard deviations that anybody may be from the mean, as in fits
_ALONG = [0, 9, 10, 11, 12]  # of `keypoint_names`: from the wrist along the middle finger
_GROUPS = {
    "flesh": ("flesh",),
    "forearm": ("forearm",),
    "palm": ("palm", "knuckle"),
    "thumb": ("thumb", "thenar"),
    "fingers": ("girth", "depth"),
}
"""what a proportion's name has in it, the first that fits; a length is of no other"""


def hand_length_mm(model: ArticulatedModel) -> float:
    """Return how far it is from the wrist along the middle finger to its tip; NaN for bodies and simpler hands."""
    if model.kind != "hand" or not model.has_keypoints21:
        return float("nan")
    points = model.keypoints21(model.bones(model.params_from({})))[_ALONG]
    return 1e3 * float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def hand_length_slope(size: SizeParameters, scale: HandScale) -> Floats[N]:
    """Return by how much each deviation makes the hand of a person longer, see `hand_length_mm` [mm]."""
    model = size.rescaled(size.deviations(scale))
    bones = model.bones(model.params_from({}))
    along = [model.joint_names.index(keypoint_names()[k]) for k in _ALONG]
    places, own = model.joint_positions(bones)[along], model.joint_bone[along]
    field = size.fields(bones, np.arange(len(size.names))).joints[own]
    turn = field[:, 3:].reshape(len(along), 3, 3, -1)
    velocity = field[:, :3] + np.einsum("kijn,kj->kin", turn, places - bones.reference)
    way = np.diff(places, axis=0)
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    return 1e3 * np.einsum("ki,kin->n", way, np.diff(velocity, axis=0))


def is_unmeasured(scale: HandScale) -> bool:
    """Return whether a size was not measured, but held at the population's."""
    return scale.std.get("overall", 0.0) >= POPULATION_SIGMA


def without_forearm_end(scale: HandScale) -> HandScale:
    """Return a person without what a recording says of itself: where the arm ended in its masks."""
    if FOREARM_END not in scale.proportions:
        return scale
    moved, std = (
        {name: value for name, value in table.items() if name != FOREARM_END}
        for table in (scale.proportions, scale.std)
    )
    known = scale.covariance
    known = known and known.only([name for name in known.names if name != FOREARM_END])
    return replace(scale, proportions=moved, std=std, covariance=known)


def scale_known_to(model: ArticulatedModel, scale: HandScale) -> HandScale:
    """Return a person as another model knows them: the same, or without internal proportions that it has not, and so without the
    offsets and deviations that were found with these.
    """
    known = model.proportions.names
    if scale.proportions.keys() <= {*known}:
        return scale
    own = {name: scale.proportions[name] for name in known if name in scale.proportions}
    return HandScale(scale.overall, scale.parts, own, source=scale.source)


def unmeasured_size(build: Callable[[HandScale], ArticulatedModel], scale: HandScale) -> HandScale:
    """Return a size that nothing measured, as uncertain as adults differ. build: the model of a size."""
    std_mm = POPULATION_SIGMA * hand_length_mm(build(scale))
    return replace(scale, std={"length_mm": std_mm, "overall": POPULATION_SIGMA})


@array_dataclass
class SizeParameters:
    """Deviations (N,) of a person from the mean adult: overall, of each part, of each internal proportion; then of the places
    where a detector sees joints.

    The first two are logarithms of factors over sigma: a bone grows about its proximal end by its part's factor, with
    all that is fixed to it, and so moves what hangs on it. A proportion scales bones along their own axes, moves their heads, and shifts
    their ellipsoids. Mathematics: docs/explanation/trajectory.md.
    """

    model: ArticulatedModel
    """of any size; others are described by how much they have grown from it"""
    observed: tuple[str, ...] = ()
    """joints whose offsets are among the deviations: a body's of left and right are mirror images, and one of its middle plane stays in it"""

    @property
    def names(self) -> tuple[str, ...]:
        """(N,)"""
        offsets = (f"{joint} {axis}" for joint in self._offset_of for axis in "xyz")
        return ("overall", *self._sigmas, *self.model.proportions.names, *offsets)

    @property
    def offset_count(self) -> int:
        """How many of the deviations are of offsets: the last."""
        return 3 * len(self._offset_of)

    @property
    def units(self) -> Floats[N]:
        """One deviation of each: of a logarithm, of a proportion in its own, of an offset [m]."""
        own = [1.0] * len(self.model.proportions.names)
        return np.array(
            [_SIGMA, *self._sigmas.values(), *own, *[self._offset_sigma_m] * self.offset_count]
        )

    def deviations(self, scale: HandScale) -> Floats[N]:
        """Return how unusual a person is among adults; the inverse of `scale`."""
        logs = [np.log(scale.overall) / _SIGMA]
        logs += [np.log(scale.parts.get(name, 1.0)) / sigma for name, sigma in self._sigmas.items()]
        logs += [scale.proportions.get(n, 0.0) for n in self.model.proportions.names]
        offsets = [
            np.mean(
                [m * scale.offsets_mm.get(joint, (0.0, 0.0, 0.0)) for joint, m in same.items()],
                axis=0,
            )
            for same in self._offset_of.values()
        ]
        return np.concatenate([logs, np.ravel(offsets) * 1e-3 / self._offset_sigma_m])

    def scale(self, deviations: Floats[N]) -> HandScale:
        """Return the person that is so many standard deviations from the mean adult."""
        deviations, offsets = np.split(deviations, [len(deviations) - self.offset_count])
        split = 1 + len(self._sigmas)
        factors = np.exp(deviations[:split] * self.units[:split]).tolist()
        moved = dict(zip(self.model.proportions.names, deviations[split:].tolist(), strict=True))
        places = (offsets * self._offset_sigma_m * 1e3).reshape(-1, 3)
        seen = dict(self.model.scale.offsets_mm)
        for place, same in zip(places, self._offset_of.values(), strict=True):
            for joint, mirror in same.items():
                x, y, z = (mirror * place).tolist()
                seen[joint] = (x, y, z)
        return HandScale(
            factors[0],
            dict(zip(self._sigmas, factors[1:], strict=True)),
            moved,
            seen,
            landmark_definition=self.model.scale.landmark_definition,
        )

    def rescaled(self, deviations: Floats[N]) -> ArticulatedModel:
        """Return the model with its bones as large as a person's is who deviates so; what is fixed to them grows with them."""
        more, skeleton, known = deviations - self._at, self.model.skeleton, self.model.proportions
        scale_change, by = np.exp(self._rates @ more), more[self._proportions]
        offset, shift = skeleton.offset, None
        if known.names:
            offset = offset + np.tensordot(by, known.moves, axes=1)
            shift = np.tensordot(by, known.shift, axes=1) * scale_change
        offset, length = (
            offset * scale_change[skeleton.parent],
            skeleton.length * scale_change[:, 1],
        )
        larger = replace(
            skeleton, offset=offset, length=length, scale_change=scale_change, shift=shift
        )
        seen = self.model.offset
        if self.observed:
            seen = (0.0 if seen is None else seen) + self.offset_moves @ more
        return replace(self.model, skeleton=larger, scale=self.scale(deviations), offset=seen)

    @cached_property
    def offset_moves(self) -> Floats[J, D3, N]:
        """By how much each of the deviations moves the points that a detector sees, in their bones' frames, before these grow [m]."""
        model = self.model
        moves = np.zeros((len(model.joint_names), 3, len(self.names)))
        side = np.array([-1.0 if model.side == "left" else 1.0, 1.0, 1.0])
        first = len(self.names) - self.offset_count
        for k, same in enumerate(self._offset_of.values()):
            at = slice(first + 3 * k, first + 3 * k + 3)
            for name, mirror in same.items():
                joint = model.joint_names.index(name)
                factor = np.exp(self._rates[model.joint_bone[joint]] @ self._at)
                moves[joint, :, at] = np.diag(self._offset_sigma_m * factor * side * mirror)
        return moves

    def fields(self, bones: BonePoses, unknowns: Ints[K]) -> BoneFields:
        """Return how the bones of a person move and deform by some of the deviations (K of N).

        A bone's head moves as far as those above it have grown, and no bone turns.

        Parameters
        ----------
        bones
            Those of `rescaled`.
        """
        assert bones.scale_change is not None
        joints, surface = scale_change_fields(
            self._scale_changes, bones.frames, bones.scale_change, unknowns
        )
        return BoneFields(
            joints, surface, self.offset_moves[:, :, unknowns], np.zeros(len(unknowns))
        )

    @property
    def _proportions(self) -> slice:
        first = 1 + len(self._sigmas)
        return slice(first, first + len(self.model.proportions.names))

    @cached_property
    def _offset_of(self) -> dict[str, dict[str, Floats[D3]]]:
        """By offset, the joints that have it, each with what mirrors it (x to the other side)."""
        found: dict[str, dict[str, Floats[D3]]] = {}
        for joint in self.observed:
            side = "" if self._is_hand else next((s for s in _ACROSS if joint.startswith(s)), "")
            across = 1.0 if self._is_hand else _ACROSS.get(side, 0.0)
            similar = found.setdefault(joint.removeprefix(side), {})
            similar[joint] = np.array([across, 1.0, 1.0])
        return found

    @property
    def _offset_sigma_m(self) -> float:
        return float(_OFFSET_SIGMAS_M[self.model.kind])

    @property
    def _is_hand(self) -> bool:
        return self.model.kind == "hand"

    @property
    def _sigmas(self) -> dict[str, float]:
        """By part, how much its logarithm differs among adults."""
        return _PARTS[self.model.kind]

    @cached_property
    def _scale_changes(
        self,
    ) -> tuple[Ints[B], Floats[B, D3, N], Floats[Q, B, D3], Floats[Q, B, D3], int]:
        """What `scale_change_fields` takes."""
        parent, known = np.array(self.model.skeleton.parent, np.int64), self.model.proportions
        return parent, self._rates, known.moves, known.shift, self._proportions.start

    @cached_property
    def _at(self) -> Floats:
        return self.deviations(self.model.scale)

    @cached_property
    def _rates(self) -> Floats:
        """(B, 3, N) by how much the logarithms of a bone's factors grow with each deviation."""
        rates = np.zeros((self.model.skeleton.bone_count, 3, len(self.names)))
        rates[:, :, 0] = _SIGMA
        for k, (part, sigma) in enumerate(self._sigmas.items(), start=1):
            rates[np.array(self.model.groups) == part, :, k] = sigma
        rates[:, :, self._proportions] = self.model.proportions.stretch.transpose(1, 2, 0)
        return rates


def shape_numbers(model: ArticulatedModel) -> list[ShapeNumber]:
    """Return the shape of a model's person: the whole, its parts, its proportions, by groups."""
    size, rows = SizeParameters(model), []
    for name, at, own in zip(
        size.names, size.deviations(model.scale), size.units.tolist(), strict=True
    ):
        effect, unit = _effect(model, name, own)
        sigma = 100.0 * effect if unit == "%" else effect
        value = 100.0 * np.expm1(at * effect) if unit == "%" else at * effect
        std = model.scale.std.get(name)
        known = None if std is None else std * sigma / own
        if effect:
            rows.append(ShapeNumber(name, _group(name, model), float(value), known, sigma, unit))
    groups = list(dict.fromkeys(["length", "fingers", "palm", "thumb", *(r.group for r in rows)]))
    return sorted(rows, key=lambda row: groups.index(row.group))


def with_number(model: ArticulatedModel, name: str, value: float) -> HandScale:
    """Return the person of a model with one of `shape_numbers` set to a value in its unit, of which is not known how sure it is.

    Raises HandtrackError for another name.
    """
    size = SizeParameters(model)
    k, came = index_of("number of a shape", name, size.names), model.scale
    at = size.deviations(came)
    effect, unit = _effect(model, name, float(size.units[k]))
    if not (np.isfinite(value) and effect and value > (-100.0 if unit == "%" else -np.inf)):
        raise HandtrackError(f"{name} of the shape: {value:g} {unit} is no size that it can have.")
    at[k] = np.clip((np.log1p(value / 100.0) if unit == "%" else value) / effect, *_WITHIN)
    known = came.covariance
    if known is not None:
        known = known.only([one for one in known.names if one != name])
    std = {key: one for key, one in came.std.items() if key != name}
    return replace(size.scale(at), std=std, covariance=known, source=came.source)


def _effect(model: ArticulatedModel, name: str, own: float) -> tuple[float, str]:
    """Return the most that a standard deviation changes, of a factor its logarithm, and its unit; 0: nothing that the model has."""
    known = model.proportions
    if name not in known.names:
        return (own if name == "overall" or name in model.groups else 0.0), "%"
    k = known.names.index(name)
    if (stretch := float(np.abs(known.stretch[k]).max())) > 0.0:
        return stretch, "%"
    return 1e3 * max(
        float(np.linalg.norm(by[k], axis=1).max()) for by in (known.moves, known.shift)
    ), "mm"


def _group(name: str, model: ArticulatedModel) -> str:
    if name in model.proportions.names and "length" not in name:
        found = (group for group, parts in _GROUPS.items() if any(part in name for part in parts))
        return next(found, "length")
    return "forearm" if name == "forearm" else "length"
