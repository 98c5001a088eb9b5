"""The person in a recording: size, proportions and where a detector sees joints, the same in all frames."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from handtrack.arrays import D3, Array, Axes, Floats, K, N, array_dataclass
from handtrack.errors import HandtrackError
from handtrack.model.articulated import FINGERS, ArticulatedModel, HandScale, ShapeCovariance
from handtrack.model.size import FOREARM_END, SizeParameters, hand_length_slope
from handtrack.observation.observation import ImageKeypoints, Observation, Silhouette
from handtrack.terms.term import JointSystem
from handtrack.tracking.frame.result import Status, TrackResult

_ANGLE = np.deg2rad(20.0)  # between two lines of sight
FEWEST_BY_JOINTS = 4
"""frames; fewer do not tell an offset from a posture"""


def is_observed_around(seen: Observation, place: Floats[D3]) -> bool:
    """Return whether silhouettes, or joints, show the hand from directions that differ enough to
    tell its size.

    From one side a hand that is larger and further back, or flatter, looks the same; a cloud is
    one-sided too.

    Parameters
    ----------
    place
        Where it is, world.
    """
    return _apart([*seen.silhouettes, *seen.image_keypoints], place)


def joints_around(used: Sequence[tuple[Observation, Floats[D3]]]) -> tuple[str, ...]:
    """Return the joints that a detector saw in frames enough, from directions that differ enough."""
    sets = [seen.image_keypoints for seen, place in used if _apart(seen.image_keypoints, place)]
    if len(sets) < FEWEST_BY_JOINTS:
        return ()
    return tuple(dict.fromkeys(name for points in sets for p in points for name in p.names))


def _apart(views: Sequence[Silhouette | ImageKeypoints], place: Floats[D3]) -> bool:
    directions: list[Floats[D3]] = [place - view.camera.centre for view in views]
    directions = [sight / np.linalg.norm(sight) for sight in directions]
    least = min((float(a @ b) for a in directions for b in directions), default=1.0)
    return least < np.cos(_ANGLE)


_MM = 1e3


def shape_covariance(size: SizeParameters, scale: HandScale) -> Floats[N, N]:
    """Return how well a saved person is known, by deviations; what their file does not tell is as uncertain as adults differ."""
    names, units = size.names, _units(size)
    std = [scale.std.get(name, unit) / unit for name, unit in zip(names, units, strict=True)]
    found = np.diag(np.square(std))
    if scale.covariance is not None:
        told = scale.covariance.only(names)
        at = [names.index(name) for name in told.names]
        found[at] = found[:, at] = 0.0
        found[np.ix_(at, at)] = told.matrix / np.outer(units[at], units[at])
    return found


def with_uncertainty(size: SizeParameters, scale: HandScale, covariance: Floats[N, N]) -> HandScale:
    """Return a person with what is known of their shape: the covariance, by deviations; standard deviations of sizes, and of
    `length_mm`.
    """
    units, count = _units(size), len(size.names) - size.offset_count
    std = np.sqrt(np.diag(covariance)) * units
    known = dict(zip(size.names[:count], std[:count].tolist(), strict=True))
    if size.model.kind == "hand" and size.model.has_keypoints21:
        slope = hand_length_slope(size, scale)
        known = {"length_mm": float(np.sqrt(slope @ covariance @ slope))} | known
    return replace(
        scale,
        std=known,
        covariance=ShapeCovariance.of(size.names, covariance * np.outer(units, units)),
    )


def _units(size: SizeParameters) -> Floats[N]:
    """Return one deviation of each as files have it: offsets in mm."""
    units, first = size.units, len(size.names) - size.offset_count
    return np.concatenate([units[:first], units[first:] * _MM])


SIZE_BANDS_MM = (4.0, 1.5)
"""narrow: the antisymmetric ramp makes radii r too small by w²/6r, 0.04 mm for a finger at the last"""
_REACHES = 2.0
"""standard deviations: 36 mm behind the wrist of a hand without a forearm in its model, whose masks show less than 28"""
_AT_LIMIT = 1e-9
FARTHEST = 4.0
"""standard deviations from the mean adult that a person may be"""


def is_stopped(
    values: Floats[*Axes],
    low: Floats[*Axes] | float,
    high: Floats[*Axes] | float,
    gradient: Floats[*Axes],
) -> Array[*Axes]:
    """Return which values lie at a limit that they would leave downhill."""
    at_low, at_high = values <= low + _AT_LIMIT, values >= high - _AT_LIMIT
    return (at_low & (gradient > 0)) | (at_high & (gradient < 0))


@dataclass(frozen=True)
class Subject:
    """What may be found of a person with all frames."""

    build: Callable[[HandScale], ArticulatedModel]
    """makes their model"""
    sizes: bool = True
    """lengths and girths; not those that a person gave: then only where the arm ends that masks show"""
    offsets: bool = False
    """where a detector sees joints; not those that came with a saved hand"""
    known: HandScale | None = None
    """what is known of them beforehand, as other recordings told; None: what is known of people"""


@array_dataclass
class PersonChange:
    """Those of a person's `SizeParameters` that are found with the poses, in standard deviations of people."""

    parameters: SizeParameters
    """of the model as it was tracked"""
    free: Array[N]
    values: Floats[N]
    known: HandScale | None = None
    """see Subject"""

    @classmethod
    def none(cls, model: ArticulatedModel) -> PersonChange:
        """Return the person as known: nothing changes."""
        parameters = SizeParameters(model)
        values = parameters.deviations(model.scale)
        return cls(parameters, np.zeros(len(values), bool), values)

    @classmethod
    def of(
        cls,
        model: ArticulatedModel,
        observations: Sequence[tuple[Observation, Floats[D3]]],
        subject: Subject,
    ) -> PersonChange:
        """Return what may change of a person by what some frames show, each with the hand's place; none of it yet changed.

        All of the shape where masks or joints see the hand from around, or a cloud shows it: of what lies on its other side the prior is left.
        """
        is_observed = any(
            one.cloud is not None or is_observed_around(one, place) for one, place in observations
        )
        seen = joints_around(observations) if subject.offsets else ()
        parameters = SizeParameters(model, seen)
        split = len(parameters.names) - parameters.offset_count
        masks = any(one.silhouettes for one, _ in observations)
        free = np.array([subject.sizes or (masks and n == FOREARM_END) for n in parameters.names])
        free[:split] &= is_observed
        free[split:] = True
        return cls(parameters, free, parameters.deviations(model.scale), subject.known)

    @property
    def count(self) -> int:
        """How many numbers there are."""
        return int(self.free.sum())

    def stepped(self, step: Floats[K]) -> PersonChange:
        """Return the person after a step of the free ones, within what people are."""
        values = self.values.copy()
        values[self.free] = np.clip(values[self.free] + step, -FARTHEST, FARTHEST)
        return replace(self, values=values)

    def stopped(self, gradient: Floats[K]) -> Array[K]:
        """Return which of the free ones lie where people end and would go further; gradient: of what they cost."""
        return is_stopped(self.values[self.free], -FARTHEST, FARTHEST, gradient)

    def prior(self) -> JointSystem:
        """Return what is known beforehand, of this person or of people, by the free ones (K,)."""
        mean = 0.0 if self.known is None else self.parameters.deviations(self.known)
        off = (self.values - mean)[self.free]
        information = np.linalg.inv(self._known_covariance[np.ix_(self.free, self.free)])
        return JointSystem(0.5 * float(off @ information @ off), information @ off, information)

    @cached_property
    def _known_covariance(self) -> Floats[N, N]:
        """Of all that is known beforehand; what is not free is as uncertain as it came."""
        if self.known is not None:
            return shape_covariance(self.parameters, self.known)
        came = shape_covariance(self.parameters, self.parameters.model.scale)
        return np.where(np.outer(~self.free, ~self.free), came, np.eye(len(came)))

    @cached_property
    def model(self) -> ArticulatedModel:
        """This person's, whose bones have grown."""
        return self.parameters.rescaled(self.values) if self.count else self.parameters.model

    @cached_property
    def with_long_arm(self) -> ArticulatedModel:
        """The same with an arm that ends further than masks of a hand alone do, where that is found: its end is looked for up to there."""
        names, values = self.parameters.names, self.values.copy()
        if FOREARM_END not in names or not self.free[names.index(FOREARM_END)]:
            return self.parameters.model
        values[names.index(FOREARM_END)] = _REACHES
        return self.parameters.rescaled(values)

    def scale(self, covariance: Floats[K, K]) -> HandScale:
        """Return the same as it is saved.

        What is not free is known better by these, where both err together.

        Parameters
        ----------
        covariance
            Of the free ones.
        """
        scale, came, free = (
            self.parameters.scale(self.values),
            self.parameters.model.scale,
            self.free,
        )
        if not free[0]:  # no size was looked for
            return replace(scale, std=came.std, covariance=came.covariance)
        known = self._known_covariance
        gain = known[:, free] @ np.linalg.inv(known[np.ix_(free, free)])
        less = known[np.ix_(free, free)] - covariance
        return with_uncertainty(self.parameters, scale, known - gain @ less @ gain.T)


# ---- constants of linked abduction, A_i = c_i · spread, from poses: 2004 paper, section 3.4

_LEAST_RAD = np.deg2rad(5.0)
"""a hand whose index never spreads further says nothing of how fingers spread together"""
_SURE_RAD = np.deg2rad(10.0)
"""an abduction known no better than this is left out"""


def spread_of_track(track: TrackResult) -> dict[str, Any]:
    """Return the constants of a tracked recording, by its frames that were tracked, with abductions that were seen; one flat, spread hand will do.

    The line through zero with the least squared distance to the abductions: the paper's linkage has no offset.

    Returns
    -------
    dict
        `settings` of the tracker for coupling 18: c by finger, the index' is 1; the `frames` it was measured from; what the linkage leaves of
        the abductions, `residual_rad`, the root of the mean square; and the share of their squares that is `explained`.

    Raises
    ------
    HandtrackError
        Where fingers are missing, unknown or never spread.
    """
    names, fingers = list(track.parameter_names), FINGERS[1:]
    wanted = [f"{finger}_mcp_abd" for finger in fingers]
    if any(name not in names for name in wanted):
        raise HandtrackError(
            f"measuring the spread: expected a hand with {', '.join(wanted)}; this one has no such fingers."
        )
    at = [names.index(name) for name in wanted]
    sure = (track.parameter_std[:, at] < _SURE_RAD).all(axis=1)
    good = sure & np.isin(track.status, (Status.TRACKED, Status.KEYFRAME))
    if not good.any():
        raise HandtrackError(
            f"measuring the spread: in none of the {len(track)} frames all four abductions are known to within "
            f"{np.rad2deg(_SURE_RAD):g}°. Record a flat hand with its fingers spread, seen from the front or the back."
        )
    angles = track.parameters[good][:, at]
    widest = float(np.abs(angles[:, 0]).max())
    if widest < _LEAST_RAD:
        raise HandtrackError(
            f"measuring the spread: in these {len(angles)} frames the index spreads by {np.rad2deg(widest):.1f}° at most, "
            f"expected {np.rad2deg(_LEAST_RAD):g}° or more. Record a flat hand with its fingers spread."
        )
    along = np.linalg.svd(angles, full_matrices=False)[2][0]
    ratio = (along / along[0]).round(4).tolist()
    left = angles - np.outer(angles @ along, along)
    return {
        "settings": {f"model.spread_{finger}": c for finger, c in zip(fingers, ratio, strict=True)},
        "frames": len(angles),
        "residual_rad": float(np.sqrt((left**2).mean())),
        "explained": float(1.0 - (left**2).sum() / (angles**2).sum()),
    }
