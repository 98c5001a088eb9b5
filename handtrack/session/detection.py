"""The session's hand found in the images of its cameras, and its joints written as files that the session reads."""

from __future__ import annotations

import glob
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from handtrack.arrays import D3, D21, Floats, evenly_spread
from handtrack.capture.images.openpose import LAYOUTS, write_points, written_by
from handtrack.capture.masks.seeded import Seeded
from handtrack.capture.masks.segmentation import mask_method_table
from handtrack.detector.hand_detector import DetectedHand, HandDetector
from handtrack.detector.hand_follower import HandFollower
from handtrack.detector.identity import HandObservation, log_odds, our_hands
from handtrack.errors import HandtrackError
from handtrack.model.articulated import keypoint_names
from handtrack.model.model_file import load_model
from handtrack.observation.observation import ImageKeypoints
from handtrack.session.layout import KEYPOINTS_FOLDER, SESSION_FILE, inside
from handtrack.session.session import Session
from handtrack.session.sources.views import View

LAYOUT = "mediapipe21"
_WRITER = "handtrack detect"
_SAMPLED = 12  # frames of each camera that are asked for the side


@dataclass(frozen=True)
class CameraDetection:
    """What was found in one camera's images."""

    camera: str
    images: int
    """how many were looked at"""
    found: int
    """in how many of them the session's hand was found"""
    other_side: int
    """in how many all hands were rather of the other side"""
    unfit: int
    """in how many a hand was seen that does not lie where the other cameras see the session's"""


def observed_side(session: Session, detector: HandDetector) -> tuple[str, float, int, int]:
    """Return the side of the hand in some images of all cameras, spread over the recording, its probability (½ to 1), and in how many
    images a hand was found of how many.

    The mean of the networks' log-odds: what one image says wrongly, the next says again, so that they do not add up.
    """
    frames = evenly_spread(session.frame_count, _SAMPLED)
    said, count = list[float](), 0
    for view in session.views:
        for frame in frames:
            image = view.image(frame)
            if image is None:
                continue
            count += 1
            hands = [detector.hand(image, region) for region in detector.find(image, 1)]
            said += [log_odds(hand.right, "right") for hand in hands if hand is not None]
    mean = float(np.mean(said)) if said else 0.0
    confidence = 1 / (1 + np.exp(-abs(mean)))
    return "right" if mean >= 0 else "left", float(confidence), len(said), count


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
    side, seen = session.file.hand.side, dict[str, list[HandObservation]]()
    views = {view.name: view for view in session.views if view.images is not None}
    for name, view in views.items():
        hands = HandFollower(detector).step(view.image(frame)).values()
        seen[name] = [
            HandObservation(view.camera, hand, log_odds(hand.right, side)) for hand in hands
        ]
    joints = []
    for name, mine in our_hands(seen).items():
        rows = _with_confidence(mine.hand, views[name])
        camera = views[name].camera
        pixels = np.where(rows[:, 2:] > 0, camera.undistort_points(rows[:, :2]), np.nan)
        flat = camera.without_distortion()
        joints.append(ImageKeypoints(flat, keypoint_names(), pixels, sigma_px))
    return tuple(joints)


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
        self.views = _views(session, cameras)
        self._followers = {view.name: HandFollower(detector) for view in self.views}
        self._detections: dict[int, dict[str, dict[int, DetectedHand]]] = {}
        self._own: dict[str, dict[int, int]] = {view.name: {} for view in self.views}
        for view in self.views:
            name = f"{KEYPOINTS_FOLDER}/{view.name}"
            folder = inside(session.folder, name, str(session.folder))
            for path in sorted(folder.glob("*")):
                if written_by(path) != _WRITER:
                    raise HandtrackError(
                        f"{path} was not written by `{_WRITER}`, so {name} is left as it is. Move these files away, and say in "
                        f"{SESSION_FILE} where they are if they are to be used."
                    )

    def step(self, frame: int) -> None:
        """Look for hands in all images of a frame."""
        self._detections[frame] = {}
        for view in self.views:
            own = view.own_frame(frame)
            image = None if own is None else view.image(frame)
            hands = self._followers[view.name].step(image)
            if image is not None and own is not None:
                self._detections[frame][view.name] = hands
                self._own[view.name][frame] = own

    def write(self) -> list[CameraDetection]:
        """Write a file for every image that was looked at, with the session's hand or none; return what was found."""
        side = self.session.file.hand.side
        sides = self._sides(side)
        tallies = {view.name: Counter[str]() for view in self.views}
        for frame, views in self._detections.items():
            seen = {
                view.name: [
                    HandObservation(view.camera, hand, sides[view.name, number])
                    for number, hand in views[view.name].items()
                ]
                for view in self.views
                if view.name in views
            }
            ours = our_hands(seen)
            for view in self.views:
                if view.name in seen:
                    mine = ours.get(view.name)
                    hands = seen[view.name]
                    tallies[view.name]["images"] += 1
                    tallies[view.name]["found"] += mine is not None
                    if mine is None and hands:
                        fits = any(hand.log_odds > 0 for hand in hands)
                        tallies[view.name]["unfit" if fits else "other side"] += 1
                    path = joint_file(self.session.folder, view.name, self._own[view.name][frame])
                    path.parent.mkdir(parents=True, exist_ok=True)
                    points = None if mine is None else _with_confidence(mine.hand, view)
                    write_points(path, points, LAYOUTS[f"hand_{side}"], _WRITER)
        return [
            CameraDetection(name, n["images"], n["found"], n["other side"], n["unfit"])
            for name, n in tallies.items()
        ]

    def _sides(self, side: str) -> dict[tuple[str, int], float]:
        """Return the log-odds of our side of each hand of each camera, by its number: the mean while it was followed."""
        said: dict[tuple[str, int], list[float]] = defaultdict(list)
        for views in self._detections.values():
            for name, hands in views.items():
                for number, hand in hands.items():
                    said[name, number].append(log_odds(hand.right, side))
        return {key: float(np.mean(values)) for key, values in said.items()}


def joint_pattern(camera: str) -> str:
    """Return the pattern, for session.toml, of the files that detection writes of a camera."""
    return f"{KEYPOINTS_FOLDER}/{glob.escape(camera)}/*.json"


def joint_file(folder: Path, camera: str, own_frame: int) -> Path:
    """Return the file of one of a camera's own frames."""
    return folder / KEYPOINTS_FOLDER / camera / f"{own_frame:06d}.json"


def session_changes(session: Session, cameras: Sequence[str]) -> dict[str, str]:
    """Return what session.toml lacks for these cameras' joints to be used, by dotted names; nothing of those that have joints
    of others already.
    """
    changes: dict[str, str] = {}
    for number, camera in enumerate(session.file.cameras):
        pattern = joint_pattern(camera.name)
        if camera.name not in cameras or camera.keypoints not in (None, pattern):
            continue
        if camera.keypoints is None:
            changes[f"camera.{number}.keypoints"] = pattern
        if camera.keypoint_layout != LAYOUT:
            changes[f"camera.{number}.keypoint_layout"] = LAYOUT
    return changes


def mask_changes(session: Session, cameras: Sequence[str]) -> dict[str, Any]:
    """Return what session.toml lacks for masks of these cameras to be made by their joints, by dotted names; nothing of those
    that have files of masks.
    """
    changes: dict[str, Any] = {}
    for number, camera in enumerate(session.file.cameras):
        masks = camera.masks
        if camera.name not in cameras or isinstance(masks, str | Seeded):
            continue
        at, table = f"camera.{number}.masks", {"method": Seeded.name}
        left = {} if masks is None else mask_method_table(masks).keys() - table.keys()
        changes |= {f"{at}.{key}": None for key in sorted(left)} | {at: table}
    return changes


def other_joints(session: Session, camera: str) -> str | None:
    """Return the joints of a camera that session.toml names and that detection did not write, None where there are none."""
    (pattern,) = (c.keypoints for c in session.file.cameras if c.name == camera)
    return None if pattern == joint_pattern(camera) else pattern


def _views(session: Session, cameras: Sequence[str]) -> list[View]:
    for name in cameras:
        session.view(name)  # raises for one that there is none of
    chosen = [view for view in session.views if not cameras or view.name in cameras]
    without = [view.name for view in chosen if view.images is None]
    if without and (cameras or len(without) == len(chosen)):
        raise HandtrackError(
            f"{session.folder / SESSION_FILE}: camera '{without[0]}' has no `images`; a hand is found in images. Name other "
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
