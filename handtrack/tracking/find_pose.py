"""A first pose for what was seen of one frame, without a session: from points, joints in images, silhouettes or a cloud."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import field, replace

import numpy as np

from handtrack.arrays import D3, D21, Floats, J, P, array_dataclass, indices
from handtrack.errors import HandtrackError
from handtrack.geometry.rotation import rotation_matrix, turned_by
from handtrack.model.articulated import ArticulatedModel
from handtrack.observation.observation import ImageKeypoints, Keypoints, Observation, check_kind
from handtrack.parallel import one_blas_thread
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.search.engine import Candidate
from handtrack.tracking.search.global_search import auto_start
from handtrack.tracking.search.keypoint_start import (
    FEWEST,
    fit_keypoints,
    hands_from_images,
    in_space,
)
from handtrack.tracking.search.start_confidence import clustered_modes

SURE = 0.85
"""from which confidence on a first pose is taken and no other frame is tried: of those at 0.70 to 0.80 half are wrong, of those above 0.9 none
(ten recordings, docs/explanation/search.md)"""
_TURNED_DEG = 30.0  # less than that is not worth a word
_OTHER_UNIT = 5.0
"""times as large or as small as a relaxed hand or body: fists, children and poor points are within half of it, inches and centimetres are not"""
_TRIED = 4
"""frames of a sequence in which a surer pose is looked for than the best so far"""


@array_dataclass
class PoseEstimate(Candidate):
    """A pose that tracking may start from, `TrackerState.beginning_at(found.params)`: of a whole hand, with a forearm where one is seen, or of
    a body. Its confidence: 0 to 1, that its joints are within 12 mm (of a body 110 mm) of the true ones on average; 1 where points say
    where they are.
    """

    frame: int = field(kw_only=True)
    note: str = ""
    """in words: what gives it, how it fits, or how it differs from the surest"""
    points: Floats[D21, D3] | None = None
    """in space, to which it was fitted, where there are any: they tell the hand's size as well"""

    @classmethod
    def of(cls, found: Candidate, frame: int, note: str = "") -> PoseEstimate:
        """Return a pose that was found in a frame, without what else a search knows of it."""
        return cls(
            found.model,
            found.params,
            found.cost,
            confidence=found.confidence,
            p_in_basin=found.p_in_basin,
            frame=frame,
            note=note,
        )

    @property
    def settled(self) -> float:
        """How surely it is the right one of the poses that were found, however well it is known."""
        return self.confidence / self.p_in_basin


@one_blas_thread
def find_pose(
    model: ArticulatedModel,
    observation: Observation,
    settings: TrackerSettings = TrackerSettings(),
    should_stop: Callable[[], bool] | None = None,
) -> list[PoseEstimate]:
    """Return the poses that a frame may show, the surest first; empty where no hand can be seen in it.

    Points in space come first, then joints on which two images agree, then silhouettes and cloud, which are searched for an
    open or half-open hand (some seconds); last the joints of one image, which leave several poses open. A body is found by points
    and joints only. Raises HandtrackError for a simpler hand, where there are no points in space, and for a body without joints.
    """
    check_kind(model, ArticulatedModel, "model", "load_model('hand26')")
    check_kind(observation, Observation, "observation", "one Observation(frame, time_s, …)")
    points = _points(model, observation, settings)
    if points is not None:
        _check_size(model, points)
        placed = Candidate(model, fit_keypoints(model, points), 0.0, confidence=1.0)
        return [PoseEstimate.of(placed, observation.frame, "points")]
    if model.kind == "hand" and not model.has_keypoints21:
        raise HandtrackError(
            f"the model '{model.name}' is no whole hand: a first pose is found by itself for whole hands and bodies only. Give one as solver "
            "parameters: model.params_from({'name': value, …}), or model.rest_params()."
        )
    if model.kind == "hand" and (observation.silhouettes or observation.cloud is not None):
        found = auto_start([model], settings, observation, should_stop)
        return [PoseEstimate.of(c, observation.frame, "silhouettes and cloud") for c in found]
    joints = observation.image_keypoints
    if not joints and model.kind == "body" and not observation.is_empty:
        raise HandtrackError(
            f"the model '{model.name}' is found by joints only, in images (ImageKeypoints) or in space (Keypoints), and frame "
            f"{observation.frame} has none. Add them, or give solver parameters: model.params_from({{'name': value, …}})."
        )
    return poses_by_joints(model, observation.frame, joints) if joints else []


def _check_size(model: ArticulatedModel, seen: Keypoints) -> None:
    """Raise HandtrackError for points that no pose of the model comes near, of another unit than metres."""
    known = np.isfinite(seen.positions).all(axis=1)
    at_rest = model.joint_positions(model.bones(model.rest_params()))
    own = at_rest[indices(model.joint_names, seen.names)]
    found, usual = (
        float(np.linalg.norm(np.ptp(at[known], axis=0))) for at in (seen.positions, own)
    )
    if not usual / _OTHER_UNIT < found < usual * _OTHER_UNIT:
        raise HandtrackError(
            f"the joints in space extend over {found:.3g} m, those of the model '{model.name}' over {usual:.3g} m. Are points, or places of "
            "cameras, in another unit than metres?"
        )


def differs(best: PoseEstimate, other: PoseEstimate) -> str:
    """Return in words how far a pose is from the best, and how much worse it fits."""
    here, there = (_joints(c.model, c.params) for c in (best, other))
    away = 1e3 * float(np.linalg.norm(here - there, axis=1).mean())
    a, b = (rotation_matrix(c.model.joint_params(c.params)[3:6]) for c in (best, other))
    turned = np.rad2deg(float(turned_by(a, b)))
    parts = "limbs" if best.model.kind == "body" else "fingers"
    way = f"turned by {turned:.0f}°" if turned > _TURNED_DEG else f"{parts} bent otherwise"
    worse = other.cost / max(best.cost, 1e-12)
    return f"{way}, joints {away:.0f} mm away on average; fits {worse:.1f} times worse"


def _joints(model: ArticulatedModel, params: Floats[P]) -> Floats[J, D3]:
    """Return the joints by which poses are compared, world [m]: a hand with a forearm has more."""
    bones = model.bones(params)
    return model.keypoints21(bones) if model.has_keypoints21 else model.joint_positions(bones)


def poses_by_joints(
    model: ArticulatedModel, frame: int, images: Sequence[ImageKeypoints]
) -> list[PoseEstimate]:
    """Return the poses that joints in a frame's undistorted images may mean, by nothing else, the surest first.

    Raises HandtrackError for too few joints.
    """
    found = clustered_modes(hands_from_images(model, images))
    return noted([PoseEstimate.of(candidate, frame) for candidate in found], images)


def noted(rows: Sequence[PoseEstimate], images: Sequence[ImageKeypoints]) -> list[PoseEstimate]:
    """Return poses by joints, the surest first, with a note on each."""
    cameras = len({joints.camera for joints in images})
    many = "one camera" if cameras == 1 else f"{cameras} cameras"
    notes = [f"joints seen by {many}", *(differs(rows[0], row) for row in rows[1:])]
    return [replace(row, note=note) for row, note in zip(rows, notes, strict=True)]


def pose_in_space(
    settings: TrackerSettings,
    model: ArticulatedModel,
    frame: int,
    images: Sequence[ImageKeypoints],
) -> PoseEstimate | None:
    """Return the pose that joints in a frame's undistorted images say, where two cameras or more
    agree on most; else None.

    Parameters
    ----------
    model
        A hand with all joints, or a body.
    """
    known = in_space(model, images, settings.keypoints.sigma_mm * 1e-3)
    if known is None:
        return None
    points = known.positions
    cameras, count = len({joints.camera for joints in images}), known.count
    note = f"{cameras} cameras agree on {count} of {len(points)} joints"
    pose = Candidate(model, fit_keypoints(model, known), 0.0, confidence=1.0)
    return replace(
        PoseEstimate.of(pose, frame, note), points=points if model.has_keypoints21 else None
    )


def find_first_pose(
    model: ArticulatedModel,
    observations: Sequence[Observation],
    settings: TrackerSettings = TrackerSettings(),
    should_stop: Callable[[], bool] = lambda: False,
) -> PoseEstimate:
    """Return a pose of a frame of a sequence to start from: they are looked at spread over all,
    until one shows a hand surely; or the surest once four were looked at.

    While none shows any, the search goes on through all of them (some seconds a frame).

    Parameters
    ----------
    should_stop
        Asked between frames and in them.

    Raises
    ------
    HandtrackError
        Where no hand is found.
    """
    seen = [one for one in observations if not one.is_empty]
    best: PoseEstimate | None = None
    looked = 0
    for row in spread_order(range(len(seen))):
        if should_stop() or (best is not None and (best.confidence >= SURE or looked >= _TRIED)):
            break
        looked += 1
        found = find_pose(model, seen[row], settings, should_stop)
        if found and (best is None or found[0].confidence > best.confidence):
            best = found[0]
    if best is None:
        raise HandtrackError(
            f"no {model.kind} was found: {looked} of {len(seen)} frames that show anything were looked at. Is it what the masks or joints show, and "
            "do the cameras fit? Else give a start: solver parameters (P,)."
        )
    return best


def spread_order(frames: range) -> list[int]:
    """Return the frames in an order whose beginning is spread over all: the first, the middle, the quarters …"""
    count = len(frames)
    bits = max(count - 1, 1).bit_length()
    order = (
        [int(f"{i:0{bits}b}"[::-1], 2) * count >> bits for i in range(1 << bits)] if count else []
    )
    return [frames[i] for i in dict.fromkeys(order)]


def _points(
    model: ArticulatedModel, seen: Observation, settings: TrackerSettings
) -> Keypoints | None:
    """Return what says in space where the model's joints are; None where too little does."""
    for given in seen.keypoints:
        if isinstance(given, Keypoints) and given.count >= FEWEST:
            rows = [i for i, name in enumerate(given.names) if name in model.joint_names]
            return replace(
                given, names=tuple(given.names[i] for i in rows), positions=given.positions[rows]
            )
    images = seen.image_keypoints
    return in_space(model, images, settings.keypoints.sigma_mm * 1e-3) if images else None
