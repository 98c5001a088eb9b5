"""First poses that the program finds by itself, in one frame of a session or in the surest of several."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from handtrack.arrays import Floats
from handtrack.errors import HandtrackError
from handtrack.geometry.rotation import rotation_matrix
from handtrack.model.articulated import ArticulatedModel
from handtrack.observation.observation import Observation
from handtrack.session.first_pose import FirstPose
from handtrack.session.run import TrackingRun
from handtrack.tracker.auto_start import Progress, StartCandidate, auto_start
from handtrack.tracker.orientation_grid import turned_by
from handtrack.tracker.result import Status

SURE = 0.7
"""confidence from which no other frame is tried"""
_MOST_TRIED = 4  # frames in which a hand is looked for
_MOST_OPENED = 40  # frames that are opened to see whether there is anything in them
_SEEN_PX = 200  # mask pixels, or points, that may be a hand


@dataclass(frozen=True, eq=False)
class FirstPoseCandidate:
    """A pose that tracking may start from."""

    frame: int
    params: Floats
    """(P,) solver parameters of `model`"""
    confidence: float
    """0 to 1; those of one frame add up to 1 at most"""
    note: str
    """in words: how it fits, or how it differs from the surest"""
    model: ArticulatedModel
    """a whole hand of the size in use, with a forearm where one is seen"""
    cost: float
    """comparable among the candidates of one frame"""

    @property
    def first_pose(self) -> FirstPose:
        """The pose as init.json holds it."""
        joint = self.model.joint_params(self.params)
        names = self.model.parameter_names
        return FirstPose(self.frame, dict(zip(names, joint.tolist(), strict=True)))


def find_first_poses(
    run: TrackingRun,
    frame: int | range | None = None,
    should_stop: Callable[[], bool] | None = None,
    on_progress: Progress | None = None,
) -> list[FirstPoseCandidate]:
    """Return first poses of one frame, the surest first; empty where no hand was found.

    frame: that one; or the surest of a few frames of a range, of all frames where None. Looks at silhouettes and
    clouds, as far as the settings use them; what init.json says does not matter. Raises HandtrackError for a model
    that is no hand.
    """
    models = _models(run)
    tell = on_progress or (lambda share, text: None)
    if isinstance(frame, int):
        return _found(run, models, run.seen(frame), should_stop, tell)
    best: list[FirstPoseCandidate] = []
    tried = opened = 0
    for number in spread_order(run.session.frame_range if frame is None else frame):
        if tried == _MOST_TRIED or opened == _MOST_OPENED or (should_stop and should_stop()):
            break
        seen = run.seen(number)
        opened += 1
        if not _may_show_a_hand(seen):
            continue

        def tell_here(share: float, text: str, number: int = number, before: int = tried) -> None:
            tell((before + share) / _MOST_TRIED, f"frame {number}: {text}")

        found = _found(run, models, seen, should_stop, tell_here)
        tried += 1
        if found and (not best or found[0].confidence > best[0].confidence):
            best = found
        if best and best[0].confidence >= SURE:
            break
    tell(1.0, "done")
    return best


def spread_order(frames: range) -> list[int]:
    """Return the frames in an order whose beginning is spread over all: the first, the middle, the quarters …"""
    count = len(frames)
    bits = max(count - 1, 1).bit_length()
    order = [int(f"{i:0{bits}b}"[::-1], 2) * count >> bits for i in range(1 << bits)]
    return [frames[i] for i in dict.fromkeys(order)]


def no_hand_found(run: TrackingRun) -> HandtrackError:
    """Return what to tell the user where no frame shows a hand."""
    return HandtrackError(
        f"{run.session.folder}: no first pose was found: no frame that was looked at shows a hand in silhouettes or "
        "cloud. Look at them with `handtrack doctor`, or pose the hand in the workbench (`handtrack open`)."
    )


def _models(run: TrackingRun) -> list[ArticulatedModel]:
    """Return whole hands that may explain what is seen: without and with a forearm, as the settings leave open."""
    models = run.whole_hands()
    if not all(model.has_keypoints21 for model in models):
        raise HandtrackError(
            f"the model '{run.model.name}' is no hand: a first pose is found by itself for hands only. Pose it in the "
            "workbench, or give one with --init FILE."
        )
    return models


def _found(
    run: TrackingRun,
    models: Sequence[ArticulatedModel],
    seen: Observation,
    should_stop: Callable[[], bool] | None,
    tell: Progress,
) -> list[FirstPoseCandidate]:
    found = auto_start(models, run.settings, seen, should_stop, tell)
    if not found:
        return []
    rows = [
        FirstPoseCandidate(seen.frame, c.params, c.confidence, "", c.model, c.cost) for c in found
    ]
    notes = [_fits(found[0]), *(_differs(found[0], other) for other in found[1:])]
    return [replace(row, note=note) for row, note in zip(rows, notes, strict=True)]


def _fits(best: StartCandidate) -> str:
    arm = "with a forearm" if best.model.has_forearm else "no forearm in view"
    return arm if best.result.status == Status.TRACKED else f"{arm}; {best.result.note}"


def _differs(best: StartCandidate, other: StartCandidate) -> str:
    """Return in words how far a pose is from the best, and how much worse it fits."""
    here, there = (c.result.keypoints21 for c in (best, other))
    assert here is not None and there is not None
    away = 1e3 * float(np.linalg.norm(here - there, axis=1).mean())
    a, b = (rotation_matrix(c.result.parameters[3:6]) for c in (best, other))
    turned = np.rad2deg(float(turned_by(a, b)))
    way = f"turned by {turned:.0f}°" if turned > 30.0 else "fingers bent otherwise"
    worse = other.cost / max(best.cost, 1e-12)
    return f"{way}, joints {away:.0f} mm away on average; fits {worse:.1f} times worse"


def _may_show_a_hand(seen: Observation) -> bool:
    """Return whether a frame has enough to look for a hand in: two silhouettes (one, where there is one camera), or a cloud."""
    if seen.cloud is not None and len(seen.cloud) >= _SEEN_PX:
        return True
    full = sum(float(s.mask.sum()) >= _SEEN_PX for s in seen.silhouettes)
    return full >= min(2, len(seen.silhouettes)) > 0
