"""A first pose for what was seen of one frame, without a session: from points, joints in images, silhouettes or a cloud."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from handtrack.arrays import Floats, P, array_dataclass
from handtrack.errors import HandtrackError
from handtrack.model.articulated import ArticulatedModel
from handtrack.observation.observation import Keypoints, Observation, check_kind
from handtrack.parallel import one_blas_thread
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.search.auto_start import auto_start
from handtrack.tracking.search.initialize import FEWEST, fit_keypoints
from handtrack.tracking.search.keypoint_start import hands_from_images, in_space
from handtrack.tracking.search.start_confidence import clustered_modes

SURE = 0.85
"""from which confidence on a first pose is taken and no other frame is tried: of those at 0.70 to 0.80 half are wrong, of those above 0.9 none
(ten recordings, docs/explanation/search.md)"""
_TRIED = 4
"""frames of a sequence in which a surer pose is looked for than the best so far"""


@array_dataclass
class PoseEstimate:
    """A pose that tracking may start from: `TrackerState.beginning_at(found.params)`."""

    frame: int
    params: Floats[P]
    """solver parameters of the model"""
    confidence: float
    """0 to 1, that its joints are within 12 mm (of a body 110 mm) of the true ones on average; 1 where points say where they are"""
    source: str
    """the kind of observation that gives it, in words"""


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
    check_kind(observation, Observation, "observation", "one Observation(frame, time_s, …)")
    points = _points(model, observation, settings)
    if points is not None:
        return [PoseEstimate(observation.frame, fit_keypoints(model, points), 1.0, "points")]
    if model.kind == "hand" and not model.has_keypoints21:
        raise HandtrackError(
            f"the model '{model.name}' is no whole hand: a first pose is found by itself for whole hands and bodies only. Give one as solver "
            "parameters: model.params_from({'name': value, …}), or model.rest_params()."
        )
    if model.kind == "hand" and (observation.silhouettes or observation.cloud is not None):
        found = auto_start([model], settings, observation, should_stop)
        return [
            PoseEstimate(observation.frame, c.params, c.confidence, "silhouettes and cloud")
            for c in found
        ]
    joints = observation.image_keypoints
    if not joints and model.kind == "body" and not observation.is_empty:
        raise HandtrackError(
            f"the model '{model.name}' is found by joints only, in images (ImageKeypoints) or in space (Keypoints), and frame "
            f"{observation.frame} has none. Add them, or give solver parameters: model.params_from({{'name': value, …}})."
        )
    if not joints:
        return []
    modes = clustered_modes(hands_from_images(model, joints))
    return [
        PoseEstimate(observation.frame, c.params, c.confidence, "joints of one image")
        for c in modes
    ]


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
