"""The session's hand found in the images of its cameras, and its joints written as files that the session reads."""

from __future__ import annotations

import glob
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from handtrack.arrays import D3, D21, Bytes, Floats, H, W, evenly_spread
from handtrack.capture.images.openpose import LAYOUTS, write_points, written_by
from handtrack.capture.masks.mask_correction import UNKNOWN_LEVEL
from handtrack.capture.masks.seeded import Seeded, seeds_of_joints
from handtrack.capture.masks.segmentation import mask_method_table
from handtrack.detector.hand_detector import (
    DetectedHand,
    HandDetector,
    HandFollower,
    HandObservation,
    log_odds,
    our_hands,
    region_by_others,
)
from handtrack.errors import HandtrackError
from handtrack.model.articulated import keypoint_names
from handtrack.model.model_file import load_model
from handtrack.observation.observation import ImageKeypoints
from handtrack.session.hand_side import side_of_frames
from handtrack.session.layout import KEYPOINTS_FOLDER, SESSION_FILE, inside
from handtrack.session.session import Session
from handtrack.session.session_file import CameraSettings
from handtrack.session.sources.views import View
from handtrack.tracking.search.keypoint_start import triangulated

LAYOUT = "mediapipe21"
_WRITER = "handtrack detect"
_SAMPLED = 12  # frames of each camera that are asked for the side
# times smaller or larger than anywhere that two cameras see a hand. By one simulated recording; it changes nothing in two real ones
_OTHER_SIZE = 1.5
# Masks that stay, of the medians over images. Skin on plain ground: 0.96 to 1.00 and 0.00 to 0.08; where it fails: below 0.2
_LEAST_COVERED, _MOST_BESIDE = 0.95, 0.1
_SURELY_BESIDE = -3.0  # log-odds by place
_PALM = [0, 5, 9, 13, 17]  # rows of wrist and knuckles: as far apart in a fist as in an open hand


COUNTED = ("images", "found", "other_side", "unfit")
"""what is counted of a camera: images that were looked at; in how many of them the session's hand was found, all hands were rather of
the other side, or a hand was seen that does not lie where the other cameras see the session's, or is far smaller or larger
"""
_Hands = dict[str, dict[int, DetectedHand]]
"""of a frame, by camera and by the number that a hand has while it is followed"""


def observed_side(session: Session, detector: HandDetector) -> tuple[str, float, int, int, str]:
    """Return the side of the hand in some images of all cameras, spread over the recording, its probability (½ to 1), in how many
    images a hand was found of how many, and the side that its joints in space tell, empty where they do not.

    The mean of the networks' log-odds: what one image says wrongly, the next says again, so that they do not add up. In space a
    hand and its mirror image differ, whatever the network takes it for.
    """
    said, in_space, count = list[float](), list[Floats](), 0
    for frame in evenly_spread(session.frame_count, _SAMPLED):
        seen = dict[str, list[HandObservation]]()
        for view in session.views:
            image = view.image(frame)
            if image is None:
                continue
            count += 1
            hands = (detector.hand(image, region) for region in detector.find(image, 1, True))
            found = list(islice(filter(None, hands), 1))
            said += [log_odds(hand.right, "right") for hand in found]
            seen[view.name] = [HandObservation(view.camera, hand, 1.0) for hand in found]
        joints = _image_keypoints(our_hands(seen), session, 1.0)
        in_space.append(triangulated(joints, keypoint_names()))
    mean = float(np.mean(said)) if said else 0.0
    confidence = float(1 / (1 + np.exp(-abs(mean))))
    side = "right" if mean >= 0 else "left"
    return side, confidence, len(said), count, side_of_frames(in_space)


def usable_detector(session: Session) -> HandDetector | None:
    """Return the hand detector, where its weights are there and two cameras of the session have images of it."""
    if sum(view.images is not None for view in session.views) < 2:
        return None
    try:
        return HandDetector.open()
    except HandtrackError:
        return None


def joints_of_frame(
    session: Session, frame: int, detector: HandDetector, sigma_px: float
) -> tuple[ImageKeypoints, ...]:
    """Return the session's hand as seen in one frame's images, undistorted; nothing is written,
    other frames do not count.

    Parameters
    ----------
    sigma_px
        Of the joints.
    """
    views = {view.name: view for view in session.views if view.images is not None}
    side, followers = session.file.hand.side, {name: HandFollower(detector) for name in views}
    hands = _hands_in(frame, views, followers, side)
    ((_, _, ours),) = _told_apart(views, side, {frame: hands})
    return tuple(_image_keypoints(ours, session, sigma_px))


def _image_keypoints(
    ours: Mapping[str, HandObservation], session: Session, sigma_px: float
) -> list[ImageKeypoints]:
    """Return one hand's joints in the undistorted images of cameras, by which it is given."""
    joints = []
    for name, mine in ours.items():
        rows = _with_confidence(mine.hand, session.view(name))
        pixels = np.where(rows[:, 2:] > 0, mine.camera.undistort_points(rows[:, :2]), np.nan)
        flat = mine.camera.without_distortion()
        joints.append(ImageKeypoints(flat, keypoint_names(), pixels, sigma_px))
    return joints


def _hands_in(
    frame: int, views: Mapping[str, View], followers: Mapping[str, HandFollower], side: str
) -> _Hands:
    """Return the hands in those images of a frame that there are; a camera that overlooks the session's is told where others see it."""
    images = {
        name: image for name, view in views.items() if (image := view.image(frame)) is not None
    }
    hands = {name: followers[name].step(image) for name, image in images.items()}
    ((_, _, ours),) = _told_apart(views, side, {frame: hands})
    for name, image in images.items():
        region = region_by_others(views[name].camera, list(ours.values()))
        if name not in ours and region is not None:
            hands[name] = followers[name].look_in(image, region)
    return hands


def _told_apart(
    views: Mapping[str, View], side: str, detections: Mapping[int, _Hands]
) -> Iterator[tuple[int, dict[str, list[HandObservation]], dict[str, HandObservation]]]:
    """Yield frames, the hands that cameras saw, and which of them is the session's. How probably a hand is of that side is the mean
    of what images said while it was followed.
    """
    said: dict[tuple[str, int], list[float]] = defaultdict(list)
    for seen in detections.values():
        for name, hands in seen.items():
            for number, hand in hands.items():
                said[name, number].append(log_odds(hand.right, side))
    odds = {key: float(np.mean(values)) for key, values in said.items()}
    for frame, seen in detections.items():
        observed = {
            name: [HandObservation(views[name].camera, h, odds[name, n]) for n, h in hands.items()]
            for name, hands in seen.items()
        }
        yield frame, observed, our_hands(observed)


def _confirmed_sizes(
    detections: Iterable[Mapping[str, HandObservation]],
) -> dict[str, list[float]]:
    """Return by camera how large the palm is in images whose hand another camera sees as well [px]."""
    sizes = defaultdict[str, list[float]](list)
    for ours in detections:
        for name, mine in ours.items() if len(ours) > 1 else ():
            sizes[name].append(_palm_px(mine))
    return sizes


def _has_other_size(mine: HandObservation, confirmed: Sequence[float]) -> bool:
    """Return whether a palm is far smaller or larger than all that were confirmed: a part of a fist that is taken for a whole
    hand would place it metres away.
    """
    size = _palm_px(mine)
    least, most = min(confirmed, default=size), max(confirmed, default=size)
    return not least / _OTHER_SIZE <= size <= most * _OTHER_SIZE


def _palm_px(mine: HandObservation) -> float:
    points = mine.hand.points[_PALM]
    return float(np.linalg.norm(points[:, None] - points, axis=2).max())


class JointDetection:
    """Goes through frames in order, then says which hand is the session's, and writes its joints."""

    def __init__(
        self, session: Session, detector: HandDetector, cameras: Sequence[str] = ()
    ) -> None:
        """cameras: all that have images, unless named. Raises HandtrackError where there is nothing to look at, and before
        joints of others would be written over.
        """
        model = load_model(session.hand_model)
        if model.kind != "hand":
            raise HandtrackError(
                f"{session.folder / SESSION_FILE}: the model is {model.name}, but the detector finds hands."
            )
        self.session = session
        self.views = {view.name: view for view in views_with_images(session, cameras)}
        self._followers = {name: HandFollower(detector) for name in self.views}
        self._detections: dict[int, _Hands] = {}
        for camera in self.views:
            name = f"{KEYPOINTS_FOLDER}/{camera}"
            folder = inside(session.folder, name, str(session.folder))
            for path in sorted(folder.glob("*")):
                if written_by(path) != _WRITER:
                    raise HandtrackError(
                        f"{path} was not written by `{_WRITER}`, so {name} is left as it is. Move these files away, and say in "
                        f"{SESSION_FILE} where they are if they are to be used."
                    )

    def step(self, frame: int) -> None:
        """Look for hands in all images of a frame."""
        side = self.session.file.hand.side
        self._detections[frame] = _hands_in(frame, self.views, self._followers, side)

    def write(self) -> dict[str, Counter[str]]:
        """Write a file for every image that was looked at, with the session's hand or none; return what was found, by camera and
        as COUNTED.
        """
        side = self.session.file.hand.side
        counts = {name: Counter[str](dict.fromkeys(COUNTED, 0)) for name in self.views}
        told = list(_told_apart(self.views, side, self._detections))
        sizes = _confirmed_sizes(ours for _, _, ours in told)
        for frame, seen, ours in told:
            for name, hands in seen.items():
                view, mine = self.views[name], ours.get(name)
                if mine is not None and len(ours) == 1 and _has_other_size(mine, sizes[name]):
                    mine = None
                found = ["images"]
                if mine is not None:
                    found.append("found")
                elif hands:
                    fits = any(hand.log_odds > 0 for hand in hands)
                    found.append("unfit" if fits else "other_side")
                counts[name].update(found)
                own = view.own_frame(frame)
                assert own is not None, "it has an image"
                path = joint_file(self.session.folder, name, own)
                path.parent.mkdir(parents=True, exist_ok=True)
                points = None if mine is None else _with_confidence(mine.hand, view)
                write_points(path, points, LAYOUTS[f"hand_{side}"], _WRITER)
        return counts

    def with_fitting_masks(self, cameras: Sequence[str]) -> list[str]:
        """Return which cameras' own masks show the hand where its joints are, and little else: better ones could not be made by
        joints, which are not found in every image.
        """
        if not cameras:
            return []
        told = list(_told_apart(self.views, self.session.file.hand.side, self._detections))
        found = []
        for camera in cameras:
            shown = [(frame, ours[camera].hand) for frame, _, ours in told if camera in ours]
            sampled = (shown[row] for row in evenly_spread(len(shown), _SAMPLED))
            masks = ((self.views[camera].mask(frame), hand) for frame, hand in sampled)
            known = (_shares_of_hand(mask, hand) for mask, hand in masks if mask is not None)
            shares = [one for one in known if one is not None]
            covered, beside = np.median(shares, axis=0) if shares else (0.0, 1.0)
            if covered >= _LEAST_COVERED and beside <= _MOST_BESIDE:
                found.append(camera)
        return found


def _shares_of_hand(mask: Bytes[H, W], hand: DetectedHand) -> tuple[float, float] | None:
    """Return the share of a hand's core that a mask covers, and the share of the mask that is far from the hand; None for a hand that
    is too small or incomplete to tell.
    """
    joints = dict(zip(keypoint_names(), hand.points, strict=True))
    height, width = mask.shape
    seeds = seeds_of_joints(joints, (width, height))
    if seeds is None:
        return None
    shown, near = mask >= UNKNOWN_LEVEL, seeds.behind(mask.shape)
    near[seeds.part] |= seeds.log_odds > _SURELY_BESIDE
    covered = shown[seeds.part][seeds.core]
    beside = np.count_nonzero(shown & ~near) / max(np.count_nonzero(shown), 1)
    return float(covered.mean()) if covered.size else 0.0, beside


def joint_pattern(camera: str) -> str:
    """Return the pattern, for session.toml, of the files that detection writes of a camera."""
    return f"{KEYPOINTS_FOLDER}/{glob.escape(camera)}/*.json"


def joint_file(folder: Path, camera: str, own_frame: int) -> Path:
    """Return the file of one of a camera's own frames."""
    return folder / KEYPOINTS_FOLDER / camera / f"{own_frame:06d}.json"


def camera_changes(
    session: Session, cameras: Iterable[str], wanted: Callable[[CameraSettings], Mapping[str, Any]]
) -> dict[str, Any]:
    """Return what session.toml is to say of these cameras, by dotted names. wanted: of one camera."""
    return {
        f"camera.{number}.{key}": value
        for number, camera in enumerate(session.file.cameras)
        if camera.name in cameras
        for key, value in wanted(camera).items()
    }


def keypoint_settings(camera: CameraSettings) -> dict[str, str]:
    """Return what a camera's settings lack for the joints that were written to be used; nothing of one that has joints of others."""
    pattern = joint_pattern(camera.name)
    if camera.keypoints not in (None, pattern):
        return {}
    given = {"keypoints": pattern, "keypoint_layout": LAYOUT}
    return {key: value for key, value in given.items() if getattr(camera, key) != value}


def mask_settings(camera: CameraSettings) -> dict[str, Any]:
    """Return what a camera's settings lack for masks to be made by its joints; nothing of one that has files of masks."""
    masks, table = camera.masks, {"method": Seeded.name}
    if isinstance(masks, str | Seeded):
        return {}
    left = {} if masks is None else mask_method_table(masks).keys() - table.keys()
    return {f"masks.{key}": None for key in sorted(left)} | {"masks": table}


def other_joints(session: Session, camera: str) -> str | None:
    """Return the joints of a camera that session.toml names and that detection did not write, None where there are none."""
    (pattern,) = (c.keypoints for c in session.file.cameras if c.name == camera)
    return None if pattern == joint_pattern(camera) else pattern


def views_with_images(session: Session, cameras: Sequence[str]) -> list[View]:
    """Return these cameras of a session, all that have images unless named. Raises HandtrackError for one that is none or has none."""
    for name in cameras:
        session.view(name)  # raises for one that there is none of
    chosen = [view for view in session.views if not cameras or view.name in cameras]
    without = [view.name for view in chosen if view.images is None]
    if without and (cameras or len(without) == len(chosen)):
        raise HandtrackError(
            f"{session.folder / SESSION_FILE}: camera '{without[0]}' has no `images`, in which the hand is looked for. Name other "
            "cameras with --camera, or give it a video or numbered files."
        )
    return [view for view in chosen if view.images is not None]


def _with_confidence(hand: DetectedHand, view: View) -> Floats[D21, D3]:
    """Return points with the hand's presence as confidence; what is guessed beyond the image's border, or outside of the
    region of interest, has none.
    """
    x, y, width, height = view.settings.roi or (0, 0, *view.camera.size)
    least = np.array([x, y]) - 0.5
    seen = ((hand.points >= least) & (hand.points <= least + [width, height])).all(axis=1)
    return np.column_stack([hand.points, np.where(seen, hand.presence, 0.0)])
