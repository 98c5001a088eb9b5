"""The terms of one frame, stage by stage: what each band of the schedule sees."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from handtrack.arrays import Floats, Ints, N, P, S
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.kinematics import BonePoses
from handtrack.model.pose_changes import moved
from handtrack.observation.agreement import suspected
from handtrack.observation.observation import (
    CLOUD_NAME,
    ImageKeypoints,
    ImageView,
    Keypoints,
    Observation,
    Silhouette,
)
from handtrack.terms.collision import contact
from handtrack.terms.keypoints import KeypointTerm
from handtrack.terms.loss import geman_mcclure, huber
from handtrack.terms.own_time import AtOwnTime, BoneMotion
from handtrack.terms.silhouettes import (
    ConicFieldTerm,
    CoverageTerm,
    FieldTerm,
    PreparedSilhouette,
    outline_overlap,
    prepare,
    rows_apart,
)
from handtrack.terms.term import ObservationTerm, ParameterTerm
from handtrack.tracking.frame.constants import FOREARM_VISIBLE_MM, LOST_OVERLAP
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.frame.terms.appearance_terms import (
    Before,
    CarriedPoints,
    appearance_stages,
    appearance_terms,
    at_stage,
    carried_points,
)
from handtrack.tracking.frame.terms.cloud_terms import (
    CLOUD_TERMS,
    CloudObservation,
    cloud_terms,
    see_cloud,
)
from handtrack.tracking.frame.terms.forearm import forearm_cut
from handtrack.tracking.frame.terms.priors import motion_prior, pose_priors

_MM = 1e-3
_LEAST_BAND_PX = 0.75  # a pixel is that coarse
_FIELD_BAND_MM = 4.5  # the 2007 field falls from outline to centre over a finger's radius
_ON_PURPOSE = 3.0  # sigmas that fingers of a hand part by when they point or spell: no Gaussian fits that and a hand at ease
_ROWS_OF_OVERLAP = 4  # of so many one tells whether half of a hand lies where its mask is
_ROBUST = geman_mcclure(3.0)
"""of given keypoints: one that is more than a few sigmas off no longer pulls"""
_WIDE = huber(3.0)
"""of detected joints in all stages but the last: they pull from wherever a start is"""
_DETECTED = {"hand": geman_mcclure(2.0), "body": _WIDE}
"""of detected joints in the last stage, by the model's kind: a camera that takes one finger for another is let go. The width was chosen on two
recordings, a real hand before five cameras and images of a scanned one; 3 costs 0.1 mm there and wins 0.1 mm where no camera errs. A body
before cameras whose calibration is off by more than its joints would lose limbs (`real_person`: 49 mm became 101)"""


@dataclass(frozen=True)
class FrameTerms:
    """What is fixed while one frame is solved."""

    model: ArticulatedModel
    settings: TrackerSettings
    observation: Observation
    prepared: tuple[PreparedSilhouette, ...]
    pixels_per_m: tuple[float, ...]
    """of each silhouette, at the hand's distance"""
    cloud: CloudObservation | None
    carried: tuple[CarriedPoints, ...] | None
    """texture of frames before; None where the frame's images do not count"""
    keypoints: tuple[KeypointTerm, ...]
    priors: tuple[ParameterTerm, ...]
    pins: tuple[KeypointTerm, ...] = ()
    """where a person said that joints and segments lie"""
    outlines_off_px: tuple[float, ...] = ()
    """of each silhouette, as the other cameras tell, beyond the usual"""
    motions: Mapping[str, BoneMotion] = field(default_factory=dict)
    """by camera that saw at another time, or of the cloud, how the bones move until then"""

    def without_motion(self) -> FrameTerms:
        """Return the terms without the pull to the predicted pose."""
        return replace(self, priors=tuple(p for p in self.priors if p.name != "motion"))

    def visible_at(self, bones: BonePoses) -> FrameTerms:
        """Return the same observation, asking of the model what is in view at another pose."""
        cloud = self.cloud and self.cloud.visible_at(bones)
        return replace(self, cloud=cloud)

    def sharpened(self, bones: BonePoses) -> FrameTerms:
        """Return the terms with a cloud taken as exactly as it lies on the surface of a solved pose; self if not nearer than usual."""
        cloud = self.cloud and self.cloud.sharpened(self.then(CLOUD_NAME, bones))
        return self if cloud is self.cloud else replace(self, cloud=cloud)

    def with_outlines(self, off_mm: Mapping[str, float]) -> FrameTerms:
        """Return the terms with outlines that are off by so much, by camera; the usual where that is more."""
        usual, found = self.settings.silhouettes.outline_sigma_mm, list[float]()
        cases = zip(self.prepared, self.pixels_per_m, self.outlines_off_px, strict=True)
        for seen, scale, before in cases:
            off = off_mm.get(seen.camera.name, 0.0)
            found.append(max(before, max(off**2 - usual**2, 0.0) ** 0.5 * _MM * scale))
        return replace(self, outlines_off_px=tuple(found))

    def outline_errors_mm(self, bones: BonePoses) -> dict[str, float]:
        """Return by camera how far the hand's outline is from its mask."""
        found = dict[str, float]()
        for term in self._at_once(bones, self.stages - 1) if self.prepared else ():
            if isinstance(term, CoverageTerm):
                names = [seen.camera.name for seen in term.silhouettes]
                off_px = term.outline_errors_px([self.then(name, bones) for name in names])
                found = dict(zip(names, off_px / (_MM * np.array(self.pixels_per_m)), strict=True))
        return {name: float(mm) for name, mm in found.items() if np.isfinite(mm)}

    def coarser(self, times: float) -> FrameTerms:
        """Return the terms as if the joints that images show were known so many times as badly; itself for 1."""
        if times == 1.0:
            return self
        points = tuple(
            replace(term, observed=replace(term.observed, sigma_px=times * term.observed.sigma_px))
            if isinstance(term.observed, ImageKeypoints)
            else term
            for term in self.keypoints
        )
        return replace(self, keypoints=points)

    def misses(self, term: KeypointTerm, bones: BonePoses) -> tuple[Ints[N], Floats[N]]:
        """Return `KeypointTerm.misses` at the time when the term's camera saw."""
        seen = term.observed
        here = isinstance(seen, Keypoints)
        return term.misses(bones if here else self.then(seen.camera.name, bones))

    def then(self, name: str, bones: BonePoses) -> BonePoses:
        """Return bones at the time when a camera saw, or when the cloud was measured."""
        motion = self.motions.get(name)
        return bones if motion is None else motion.carried(bones)

    @property
    def detected(self) -> list[tuple[KeypointTerm, ImageKeypoints]]:
        """The terms of joints that a detector saw, each with these."""
        pairs = [(term, term.observed) for term in self.keypoints]
        return [(term, seen) for term, seen in pairs if isinstance(seen, ImageKeypoints)]

    @property
    def stages(self) -> int:
        """How many stages the schedule has: of bands, two where nothing but joints was detected, otherwise one."""
        bands = self.settings.silhouettes
        ramps = self.prepared and bands.term == "coverage"
        count = 2 if self.detected else 1
        count = len(bands.bands_mm) if ramps or self.cloud is not None else count
        return count if self.carried is None else max(count, appearance_stages(self.settings))

    def wide(self) -> FrameTerms:
        """Return the terms where detected joints pull from however far: of all stages but the last."""
        points = (replace(t, loss=_WIDE) if t.is_detected else t for t in self.keypoints)
        return replace(self, keypoints=tuple(points))

    @property
    def parts(self) -> tuple[ObservationTerm, ...]:
        """What keeps the model's parts out of each other."""
        return (contact(self.model),) if self.settings.prior.collision else ()

    @property
    def images(self) -> tuple[ImageView, ...]:
        """Those that count."""
        return () if self.carried is None else self.observation.images

    @property
    def views(self) -> int:
        """How many silhouettes, clouds and images were seen."""
        return len(self.prepared) + (self.cloud is not None) + len(self.images)

    @property
    def has_observations(self) -> bool:
        """Whether anything was observed at all."""
        return bool(self.views or self.keypoints or self.pins)

    def stage(self, start: BonePoses, index: int | None = None) -> list[ObservationTerm]:
        """Return the observation terms of a stage, the last unless given. The ramp's widths are frozen at the pose `start`."""
        terms = self._at_once(start, self.stages - 1 if index is None else index)
        if not self.motions:
            return terms
        by_name, found = by_camera(terms)
        for name, own in by_name.items():
            later = self.motions.get(name)
            found += own if later is None else [AtOwnTime(term, later) for term in own]
        return found

    def _at_once(self, start: BonePoses, index: int) -> list[ObservationTerm]:
        """Return the terms of a stage as if all cameras had seen at the frame's time."""
        settings = self.settings.silhouettes
        ellipsoids = self.model.ellipsoids["fine"]
        band_mm = at_stage(settings.bands_mm, index)
        points = (self if index >= self.stages - 1 else self.wide()).keypoints
        terms: list[ObservationTerm] = [*self.observation.terms, *self.parts, *self.pins, *points]
        if self.cloud is not None:
            terms += cloud_terms(self.cloud, band_mm)
        if self.carried is not None:
            terms += appearance_terms(
                self.model, self.images, self.carried, self.settings, index, start
            )
        if not self.prepared:
            return terms
        scale = np.array(self.pixels_per_m) * _MM
        if settings.term == "conic_field":
            weight = (
                [settings.weight] * len(self.prepared)
                if self.settings.traits.plain_sums
                else self._weight(_FIELD_BAND_MM * scale)
            )
            inside = -self.settings.traits.inside
            fields = [silhouette.times(inside) for silhouette in self.prepared]
            terms.append(ConicFieldTerm(fields, ellipsoids, weight=weight))
            return terms
        band = np.maximum(band_mm * scale, _LEAST_BAND_PX)
        terms.append(
            CoverageTerm(
                self.prepared,
                ellipsoids,
                band_px=band.tolist(),
                bones_at_start=start,
                antisymmetric=index >= len(settings.bands_mm) - 1,
                weight=self._weight(band),
                row_steps=rows_apart(band.tolist()),
            )
        )
        return terms

    def _weight(self, band_px: Floats) -> list[float]:
        """Return a weight for each camera that make the cost a negative log-likelihood.

        ½ Σ r² grows by d²/(4·band) for each pixel of outline that is shifted by d. An outline that is off by sigma,
        the same error over a stretch of it, should cost ½ for each stretch. Sigma is the usual, and what other cameras contradict.
        """
        settings = self.settings.silhouettes
        scale = np.array(self.pixels_per_m) * _MM
        sigma, correlation = (
            settings.outline_sigma_mm * scale,
            settings.outline_correlation_mm * scale,
        )
        variance = sigma**2 + np.square(self.outlines_off_px)
        return (settings.weight * 2 * band_px / (correlation * variance)).tolist()


def frame_terms(
    model: ArticulatedModel,
    settings: TrackerSettings,
    observation: Observation,
    start: BonePoses,
    expected: Floats[S] | None = None,
    frames_ahead: int = 1,
    before: Before | None = None,
) -> FrameTerms:
    """Return the terms of a frame.

    Parameters
    ----------
    start
        Where the model stands; it fixes the hand's distance and where the forearm is cut off.
    expected
        Predicted joint parameters, or None in a first frame.
    before
        Where texture is carried from.
    """
    weighted = observation.silhouettes if settings.silhouettes.weight > 0 else ()
    prepared = [
        prepare(silhouette, forearm_cut(silhouette, model, start, FOREARM_VISIBLE_MM * _MM))
        for silhouette in weighted
    ]
    hand = _of_the_hand(model, start, weighted, prepared)
    weighted, prepared = [weighted[n] for n in hand], [prepared[n] for n in hand]
    scales = [_pixels_per_m(silhouette, start) for silhouette in weighted]
    keypoints = []
    if settings.keypoints.weight > 0:
        keypoints = [
            KeypointTerm(
                model,
                seen,
                settings.keypoints.weight,
                _DETECTED[model.kind] if isinstance(seen, ImageKeypoints) else _ROBUST,
            )
            for seen in observation.keypoints
        ]
    cloud = see_cloud(observation, model, start, settings)
    fingers_seen = model.kind == "hand" and bool(prepared or cloud)
    loss = geman_mcclure(_ON_PURPOSE) if fingers_seen else None
    prior, smoothing = settings.prior, settings.tracker.smoothing
    priors = pose_priors(model, np.deg2rad(prior.rest_sigma_deg), prior.posture, loss)
    if expected is not None and smoothing > 0:
        priors.append(motion_prior(expected, prior, smoothing, frames_ahead))
    return FrameTerms(
        model,
        settings,
        observation,
        tuple(prepared),
        tuple(scales),
        cloud,
        carried_points(observation, model, settings, before),
        tuple(keypoints),
        (*priors, *observation.priors),
        pin_terms(model, observation),
        tuple(silhouette.off_px for silhouette in weighted),
    )


def _of_the_hand(
    model: ArticulatedModel,
    start: BonePoses,
    silhouettes: Sequence[Silhouette],
    prepared: Sequence[PreparedSilhouette],
) -> list[int]:
    """Return which silhouettes show the hand: all but one in which a hand would be lost by its overlap with the model, where the others fit
    and contradict it.
    """
    every = list(range(len(silhouettes)))
    if len(every) < 3:
        return every
    overlap = outline_overlap(prepared, model.ellipsoids["fine"], start, _ROWS_OF_OVERLAP).iou
    worst = int(np.argmin(overlap))
    is_odd = overlap[worst] < LOST_OVERLAP < np.median(overlap)
    if is_odd and silhouettes[worst] in suspected(tuple(silhouettes)):
        every.remove(worst)
    return every


def pin_terms(model: ArticulatedModel, observation: Observation) -> tuple[KeypointTerm, ...]:
    """Return what holds the pins of an observation: without a robust loss, for a person said so."""
    return tuple(KeypointTerm(model, seen) for seen in observation.pins)


def at_camera_times(
    terms: FrameTerms,
    later: Mapping[str, float],
    params: Floats[P],
    velocity: Floats[P],
) -> FrameTerms:
    """Return the terms in which cameras, and the cloud, are predicted at their own times.

    Parameters
    ----------
    later
        By camera, how many frames later than this one it saw, and of the cloud.
    velocity
        Of solver parameters [a frame], as `pose_changes.moved` takes it.
    """
    model = terms.model

    def until(by: float) -> BoneMotion:
        then = model.clipped(moved(params, by * velocity))
        return BoneMotion.between(model.bones(params), model.bones(then))

    motions = {name: until(by) for name, by in later.items() if by}
    return replace(terms, motions={**terms.motions, **motions})


def by_camera(
    terms: Sequence[ObservationTerm],
) -> tuple[dict[str, list[ObservationTerm]], list[ObservationTerm]]:
    """Return the terms that each camera alone says, by its name, those of a cloud, and all others; together they are the same."""
    found: dict[str, list[ObservationTerm]] = {}
    others = []
    for term in terms:
        if isinstance(term, FieldTerm):
            for own in term.alone():
                found.setdefault(own.silhouettes[0].camera.name, []).append(own)
        elif isinstance(term, KeypointTerm) and not isinstance(term.observed, Keypoints):
            found.setdefault(term.observed.camera.name, []).append(term)
        elif isinstance(term, CLOUD_TERMS):
            found.setdefault(CLOUD_NAME, []).append(term)
        else:
            others.append(term)
    return found, others


def _pixels_per_m(silhouette: Silhouette, start: BonePoses) -> float:
    camera = silhouette.camera
    # the median; np.median takes several times as long for so few, in each camera of each frame
    depth = np.sort(camera.to_camera(start.position)[:, 2])
    middle = 0.5 * (depth[(len(depth) - 1) // 2] + depth[len(depth) // 2])
    return float(camera.pixels_per_m(middle))
