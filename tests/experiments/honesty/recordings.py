"""Write recordings with truth: python -m tests.experiments.honesty.recordings DATA MAKEHUMAN LEAP OUT

DATA: a folder with `webxr_generic_hand`, `umetrack_generic_hand` and, for motions, `realsense_hand_pose`. MAKEHUMAN, LEAP: the git folders
of copies of makehumancommunity/makehuman and leapmotion/leapjs-playback. OUT: gets a folder for each part of `HALVES`: figures are fitted to
`tune` and `seen`; `fresh`, `apart`, `last` and `kept`, other people, motions and noise, were each for one look, at the latter figures in the
documentation were read.
"""

from __future__ import annotations

import json
import sys
import zlib
from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

from handtrack import Camera, CameraRig
from handtrack.arrays import D3, D21, Array, F, Floats, H, M, N, T, W
from handtrack.capture.calibration.rig_file import write_rig
from handtrack.diagnostics.metrics import bone_frames
from handtrack.geometry.rotation import rotation_matrix
from handtrack.session import layout
from handtrack.session.first_pose import FirstPose, write_first_pose
from handtrack.session.session_file import (
    CameraSettings,
    HandSettings,
    RecordingSettings,
    SessionFile,
    write_session_file,
)
from handtrack.simulation.simulate import simulated_rig
from tests.experiments.honesty import motions
from tests.experiments.honesty.meshes import HandMesh, read_meshes
from tests.experiments.honesty.people import as_person, mirrored, somebody
from tests.experiments.mean_hand.makehuman import Base, people

FRAMES, FPS, SIZE = 60, 25.0, (320, 240)
LATE_FRAMES, TURNED_DEG = 0.7, 0.5
"""of the second camera; of the last one, in the calibration that is written"""
BEFORE = 2
_INIT_NOISE_M = 0.005
_DEFINED, _DRIFT, _OWN, _LASTS, _WHITE, _GUESSED = 0.06, 0.04, 0.02, 0.8, 0.01, 0.08
_NOT_FOUND = 0.1
_REACHES = 0.35, 0.6, 0.9
_CLOSED, _HALF = 0.01 * np.array(
    [[[-8, -6], [4, 11], [18, 3], [19, -18]], [[-4, -5], [0, 4], [8, 10], [21, 9]]]
)
"""errors of a detector's joints each way, in distances from wrist to middle knuckle: alike in all cameras, where it means another place of the
bone, and tips' that last; in each camera, constant and tips' that last; correlation of these a frame later; white. Where a finger's
knuckle and tip are less than 0.9 of its length apart, it guesses joints from the knuckle on, at 0.35 and 0.6 by so much along the palm and out
of its back, and tips at 0.35 by 0.08 more. MediaPipe's in a real hand's images with marks, and of two meshes that make fists: in fists
tips are 0.24 off in images, in open hands 0.06"""
HALVES = {
    "tune": """
        2 joints webxr fist
        2 joints ragged makehuman6 fist
        3 joints umetrack fist
        2 joints makehuman0 curls
        2 joints ragged umetrack curls
        2 webxr curls
        3 umetrack animbank_a:120
        3 ragged makehuman0 fist
        2 late webxr animbank_a:230
        2 turned umetrack letters
        3 turned late makehuman6 turns
        2 gaps ragged makehuman3 animbank_a:330
        3 sleeve ragged webxr fist
        4 gaps umetrack pinches
        2 joints ragged makehuman1 letters
        3 makehuman1 curls
        2 ragged webxr fist
        2 makehuman3 letters
        3 joints late webxr animbank_a:40
        3 gaps makehuman6 curls
        2 turned late umetrack fist
        4 ragged late webxr letters
        2 sleeve umetrack spread
        3 joints makehuman0 pinches
        2 ragged makehuman1 animbank_a:180
        6 umetrack fist
        4 ragged makehuman3 fist
        6 ragged makehuman0 letters
        6 webxr pinches
        2 joints unmasked webxr fist
        2 joints unmasked makehuman6 curls
        2 joints unmasked umetrack letters
        2 joints unmasked makehuman0 fist
        3 joints unmasked makehuman1 fist
        2 joints unmasked makehuman3 pinches
        2 joints unmasked umetrack fist
        3 joints unmasked webxr pinch:0
        2 joints unmasked makehuman4 fist
        2 joints unmasked makehuman7 curls
    """,
    "seen": """
        2 makehuman4 fist
        3 ragged umetrack pinches
        2 late makehuman5 letters
        3 turned late webxr curls
        2 joints ragged makehuman4 fist
        2 ragged umetrack fist
        2 makehuman5 animbank_a:760
        3 joints late makehuman7 letters
        2 joints umetrack fist
        2 turned makehuman2 pinches
        2 joints webxr curls
        3 joints ragged makehuman2 fist
        2 joints unmasked makehuman5 fist
        2 joints unmasked umetrack grab:0
        3 joints unmasked webxr counts
        2 joints unmasked makehuman7 letters
        2 joints ragged makehuman3 fist
        2 joints webxr grab:0
        3 joints turned umetrack counts
        2 joints gaps ragged makehuman1 hand_data_example:0
        2 ragged makehuman7 counts
        2 late webxr gun:0
        3 sleeve makehuman5 HandSplay-110fps:0
        2 gaps umetrack animbank_a:880
        3 late turned makehuman2 waves
        5 ragged makehuman4 fist
    """,
    "fresh": """
        2 joints unmasked makehuman2 fist
        2 joints unmasked webxr letters
        3 joints unmasked umetrack pinches
        2 joints unmasked makehuman5 test-paddle-rightwards:0
        2 joints ragged makehuman7 fist
        2 joints webxr brian:0
        3 joints makehuman5 curls
        3 joints turned makehuman4 letters
        2 joints gaps ragged umetrack Waiting-110fps:0
        2 ragged makehuman2 letters
        2 late umetrack counts
        3 sleeve makehuman4 counts
        2 gaps webxr animbank_a:540
        3 late turned makehuman1 fist
        5 ragged umetrack letters
        4 makehuman0 fist
    """,
    "apart": """
        2 joints unmasked makehuman4 letters
        2 joints unmasked umetrack curls
        3 joints unmasked webxr wave:0
        2 joints unmasked makehuman1 three-claps:0
        2 joints ragged makehuman5 fist
        2 joints makehuman2 flapping:0
        3 joints late umetrack letters
        3 joints gaps makehuman6 pinches
        2 joints turned webxr counts
        2 ragged makehuman4 curls
        2 gaps makehuman7 rollAndPitchCropped:0
        2 late makehuman2 fist
        3 sleeve umetrack waiting-short:0
        3 turned ragged makehuman7 animbank_a:1000
        4 webxr fist
        5 gaps makehuman5 letters
    """,
    "last": """
        2 joints unmasked makehuman3 letters
        2 joints unmasked webxr fist
        3 joints unmasked makehuman6 counts
        2 joints unmasked umetrack pinches
        2 joints ragged makehuman0 fist
        2 joints makehuman5 pinch:0
        3 joints late webxr letters
        3 joints gaps umetrack curls
        2 joints turned makehuman1 counts
        2 ragged makehuman6 letters
        2 gaps makehuman2 animbank_a:640
        2 late webxr fist
        3 sleeve makehuman3 turns
        3 turned ragged umetrack curls
        4 makehuman7 fist
        5 gaps webxr letters
        2 umetrack fist
        2 makehuman1 letters
        2 ragged webxr animbank_a:440
        2 joints turned makehuman7 fist
        2 joints unmasked makehuman1 fist
        2 joints unmasked umetrack letters
        3 joints unmasked makehuman7 pinches
        2 joints unmasked makehuman0 counts
        2 joints ragged webxr fist
        2 joints makehuman6 confidence2:0
        3 joints late makehuman2 letters
        3 joints gaps makehuman5 counts
        2 joints turned umetrack fist
        2 ragged makehuman0 counts
        2 gaps umetrack animbank_a:140
        2 late makehuman3 fist
        3 sleeve webxr letters
        3 turned ragged makehuman4 fist
        4 umetrack curls
        5 gaps makehuman1 fist
        2 webxr letters
        2 makehuman7 fist
        2 ragged makehuman5 fist
        2 joints makehuman4 curls
    """,
    "kept": """
        2 joints unmasked makehuman5 letters
        2 joints unmasked webxr curls
        3 joints unmasked makehuman2 fist
        2 joints unmasked umetrack counts
        2 joints ragged makehuman6 fist
        2 joints makehuman1 pinch:0
        3 joints late makehuman3 counts
        3 joints gaps webxr pinches
        2 joints turned makehuman0 letters
        2 ragged makehuman1 fist
        2 gaps makehuman5 animbank_a:420
        2 late makehuman6 letters
        3 sleeve makehuman7 fist
        3 turned ragged webxr counts
        4 makehuman3 letters
        5 gaps umetrack fist
        2 makehuman0 fist
        2 umetrack letters
        2 ragged makehuman4 animbank_a:560
        2 joints turned webxr fist
        2 joints unmasked makehuman7 fist
        2 joints unmasked makehuman3 pinches
        3 joints unmasked umetrack letters
        2 joints unmasked makehuman6 waves
        2 joints ragged umetrack fist
        2 joints makehuman4 confidence2:0
        3 joints late makehuman1 fist
        3 joints gaps makehuman0 letters
        2 joints turned makehuman5 curls
        2 ragged webxr letters
        2 gaps makehuman7 animbank_a:240
        2 late umetrack curls
        3 sleeve makehuman2 letters
        3 turned ragged makehuman6 pinches
        4 makehuman5 fist
        2 makehuman2 curls
    """,
}
"""of each recording cameras, faults, hand, and motion: of `motions.SHAPES`, or FILE:ROW of RealSense's or Leap Motion's. Faults: masks with
ragged outlines; the second camera late; the last one turned; gaps, a fifth of the masks missing, and the second camera's before frame 10; a
sleeve around the forearm; not faults: a detector's joints, beside the masks or, unmasked, alone"""


@dataclass(frozen=True, eq=False)
class Moving:
    """A hand over the frames of a recording, and two before them, in the world [m]."""

    vertices: Floats[F, N, D3]
    triangles: Array[T, D3]
    keypoints: Floats[F, D21, D3]
    left: bool = False

    def vertices_at(self, frame: float) -> Floats[N, D3]:
        """Return where they are between two frames."""
        before, share = int(frame), frame % 1.0
        after = min(before + 1, len(self.vertices) - 1)
        return (1.0 - share) * self.vertices[before] + share * self.vertices[after]


def main() -> None:
    """Write all parts."""
    data, makehuman, leap, out = map(Path, sys.argv[1:5])
    hands = read_meshes(data)
    base = cache(lambda: Base.read(makehuman))

    def hand(name: str) -> HandMesh:
        recipe = name.removeprefix("makehuman")
        return hands[name] if recipe == name else base().hand(people()[int(recipe)])

    for half, rows in HALVES.items():
        seed = {"tune": "tune", "last": "third fresh", "kept": "fourth fresh"}.get(half, "fresh")
        for row in rows.strip().splitlines():
            cameras, *faults, name, motion = row.split()
            rng = np.random.default_rng(
                zlib.crc32(f"{seed} {' '.join(faults)} {name} {motion}".encode())
            )
            who = somebody(rng)
            file, _, first = motion.partition(":")
            bank = data / "realsense_hand_pose" / f"{file}.pose"
            if not first:
                angles = motions.moving(motion, FRAMES + BEFORE, rng)
            elif bank.exists():
                angles = motions.read(bank, int(first), FRAMES + BEFORE)
            else:
                angles = motions.read_leap(leap, file, int(first), FRAMES + BEFORE)
            moving = moved(as_person(hand(name), who), angles, motion, rng, who.left, "sleeve" in faults)  # fmt: skip
            what = "_".join([f"{cameras}cam", *sorted(faults), name, motion.replace(":", "")])
            folder = out / half / what
            write(folder, moving, rig_of(int(cameras), rng), rng, faults)
            print(folder)


def moved(
    person: HandMesh, angles: motions.Angles, motion: str, rng: np.random.Generator,
    left: bool = False, sleeve: bool = False,
) -> Moving:  # fmt: skip
    """Return a hand that moves its fingers so, and its wrist as hands do in such a motion."""
    turn, place = motions.wrist(motion, len(angles), rng)
    arm = _sleeve(person) if sleeve else (np.zeros((0, 3)), np.zeros((0, 3), int))
    triangles = np.concatenate([person.triangles, arm[1] + len(person.vertices)])
    side = mirrored if left else np.asarray
    centre = side(person.keypoints[9])
    vertices, points = [], []
    for pose, r, t in zip(person.thumb_outside(angles), turn, place, strict=True):
        v, k = person.posed(pose)
        vertices.append((side(np.concatenate([v, arm[0]])) - centre) @ r.T + t)
        points.append((side(k) - centre) @ r.T + t)
    return Moving(np.array(vertices), triangles, np.array(points), left)


def _sleeve(person: HandMesh) -> tuple[Floats[N, D3], Array]:
    """Return an elliptic tube around the forearm: a cuff that stands off, and what is in it."""
    wrist = person.vertices[np.abs(person.vertices[:, 1]) < 0.012]
    middle = wrist.mean(axis=0)
    radii = np.abs(wrist - middle).max(axis=0)[[0, 2]]
    around = np.linspace(0, 2 * np.pi, 25)[:-1]
    rings = [
        middle + np.stack([g * radii[0] * np.cos(around), np.full(24, y), g * radii[1] * np.sin(around)], 1)
        for y, g in ((0.0, 1.0), (-0.02, 1.0), (-0.021, 1.35), (-0.13, 1.6))
    ]  # fmt: skip
    a = np.arange(24)
    b = np.roll(a, -1)
    band = np.concatenate([np.stack([a, b, a + 24], 1), np.stack([b, b + 24, a + 24], 1)])
    return np.concatenate(rings), np.concatenate([band + 24 * k for k in range(len(rings) - 1)])


def rig_of(count: int, rng: np.random.Generator) -> CameraRig:
    """Return cameras about as simulate places them, each a little elsewhere."""
    cameras = []
    for camera in simulated_rig(count, SIZE, 0.45):
        turn = rotation_matrix(np.deg2rad(rng.normal(0, 6.0, 3)))
        place = camera.translation + np.array([*rng.normal(0, 0.01, 2), rng.normal(0, 0.03)])
        cameras.append(replace(camera, rotation=camera.rotation @ turn, translation=place))
    return CameraRig(tuple(cameras))


def _turned(camera: Camera, rng: np.random.Generator) -> Camera:
    """Return a camera turned about its centre."""
    axis = rng.normal(size=3)
    turn = rotation_matrix(np.deg2rad(TURNED_DEG) * axis / np.linalg.norm(axis))
    rotation = turn @ camera.rotation
    return replace(camera, rotation=rotation, translation=turn @ camera.translation)


def write(
    folder: Path, hand: Moving, rig: CameraRig, rng: np.random.Generator, faults: Collection[str] = ()
) -> None:  # fmt: skip
    """Write a session of all frames but the two before."""
    points = hand.keypoints[BEFORE:]
    first, cameras = about(points[0], rng), list(rig)
    if "turned" in faults:
        cameras[-1] = _turned(cameras[-1], rng)
    defined = _DEFINED * rng.normal(size=points[0].shape)
    for number, camera in enumerate(rig):
        if "unmasked" not in faults:
            _write_masks(folder / "masks" / camera.name, camera, number == 1, hand, rng, faults)
    if "joints" in faults:
        detected = _as_detected(points, defined, hand.left, rng)
        for camera in rig:
            _write_joints(folder / "keypoints" / camera.name, camera, *detected, rng)
    describe(folder, CameraRig(tuple(cameras)), points, first, "left" if hand.left else "right")


def about(points: Floats[D21, D3], rng: np.random.Generator) -> Floats[D21, D3]:
    """Return a first pose's points, off by some millimetres."""
    return np.round(points + rng.normal(scale=_INIT_NOISE_M, size=points.shape), 5)


def describe(
    folder: Path, rig: CameraRig, points: Floats[F, D21, D3], first: Floats[D21, D3], side: str = "right"
) -> None:  # fmt: skip
    """Write all of a session but what was seen, for what lies in the folder; first: points of the first pose."""
    write_first_pose(folder / layout.INIT_FILE, FirstPose(0, xyz=first))
    np.savez_compressed(
        folder / layout.TRUTH_FILE, keypoints21=points, time_s=np.arange(len(points)) / FPS
    )
    write_rig(folder / layout.CALIBRATION_FILE, rig)
    masks = "masks/{}/*.png" if (folder / "masks").is_dir() else ""
    found = [CameraSettings(name=c.name, masks=masks.format(c.name) or None) for c in rig]
    if any(folder.glob("*.mp4")):
        found = [replace(c, images=f"{c.name}.mp4") for c in found]
    if (folder / "keypoints").is_dir():
        found = [
            replace(c, keypoints=f"keypoints/{c.name}/*.json", keypoint_layout="mediapipe21")
            for c in found
        ]
    recording = RecordingSettings(name=folder.name.replace("_", " "), fps=FPS)
    hand = HandSettings(side=side, scale="fit")
    write_session_file(folder / layout.SESSION_FILE, SessionFile(recording, hand, tuple(found)))


def _write_masks(
    to: Path, camera: Camera, second: bool, hand: Moving, rng: np.random.Generator, faults: Collection[str]
) -> None:  # fmt: skip
    to.mkdir(parents=True)
    back = LATE_FRAMES if second and "late" in faults else 0.0
    for frame in range(len(hand.vertices) - BEFORE):
        missing = (second and frame < 10) or (frame > 0 and rng.random() < 0.2)
        if "gaps" in faults and missing:
            continue
        mask = _outline(camera, hand.vertices_at(frame + BEFORE - back), hand.triangles)
        if "ragged" in faults:
            mask = _ragged(mask, rng)
        cv2.imwrite(str(to / f"{frame:06d}.png"), mask)


def _as_detected(
    points: Floats[F, D21, D3], defined: Floats[D21, D3], left: bool, rng: np.random.Generator
) -> tuple[Floats[F, D21, D3], float]:
    """Return where a detector has joints in all cameras alike, and the distance from wrist to middle knuckle."""
    turns, size = bone_frames(points), float(np.linalg.norm(points[0, 9] - points[0, 0]))
    fingers = points[:, 1:].reshape(-1, 5, 4, 3)
    long = np.linalg.norm(np.diff(fingers, axis=2), axis=3).sum(axis=2)
    reach = np.linalg.norm(fingers[:, :, 3] - fingers[:, :, 0], axis=2) / long
    reach[:, 0] = reach[:, 1:].mean(axis=1)  # a thumb lies before fingers or under them
    closed, half = (np.interp(reach, _REACHES, w)[..., None, None] for w in ((1, 0, 0), (0, 1, 0)))
    guess = closed * np.arange(4)[:, None] / 3 * rng.normal(scale=_GUESSED, size=(5, 1, 3))
    guess[:, 1:, :, ::2] += closed[:, 1:] * _CLOSED + half[:, 1:] * _HALF
    guess *= [1.0, 1.0, -1.0 if left else 1.0]
    off = np.einsum("fjab,fjb->fja", turns, defined + _DRIFT * _lasting(len(points), rng))
    off[:, 1:] += np.einsum("fab,fkjb->fkja", turns[:, 0], guess).reshape(-1, 20, 3)
    return points + size * off, size


def _lasting(frames: int, rng: np.random.Generator) -> Floats[F, D21, D3]:
    """Return errors that are alike from frame to frame, less of joints near the wrist."""
    off = rng.normal(size=(frames, 21, 3))
    for before, now in pairwise(off):
        now[:] = _LASTS * before + (1.0 - _LASTS**2) ** 0.5 * now
    return np.array([0.4, *[0.4, 0.6, 0.8, 1.0] * 5])[:, None] * off


def _write_joints(
    to: Path, camera: Camera, places: Floats[F, D21, D3], size: float, rng: np.random.Generator
) -> None:
    to.mkdir(parents=True)
    off = _OWN * (rng.normal(size=(21, 3)) + _lasting(len(places), rng))
    off += _WHITE * rng.normal(size=off.shape)
    for frame, points in enumerate(places + size * off):
        found = np.full(21, rng.random() > _NOT_FOUND)
        rows = np.column_stack([camera.project(points), found])
        person = {"hand_right_keypoints_2d": np.round(rows * rows[:, 2:], 2).ravel().tolist()}
        (to / f"{frame:06d}.json").write_text(json.dumps({"people": [person]}))


# ---- Meshes as cameras see them: masks, and what is wrong with real ones

_FINE, _SHIFT = 16, 4  # sub-pixel places of OpenCV's polygons, as a number and in bits


def _outline(camera: Camera, vertices: Floats[N, D3], triangles: Array[M, D3]) -> Array[H, W]:
    """Return the silhouette, uint8 0 or 255."""
    width, height = camera.size
    mask = np.zeros((height, width), np.uint8)
    corners = np.round(camera.project(vertices)[triangles] * _FINE).astype(np.int32)
    for corner in corners:
        cv2.fillConvexPoly(mask, corner, 255, cv2.LINE_8, _SHIFT)
    return mask


def _ragged(mask: Array[H, W], rng: np.random.Generator) -> Array[H, W]:
    """Return the mask as a colour threshold gives it: an edge that wanders by about 0.7 px, small bites and holes."""
    noise = cv2.GaussianBlur(rng.normal(size=mask.shape), (0, 0), 3.0)
    noise *= 0.7 / noise.std()
    inside = cv2.distanceTransform(mask, cv2.DIST_L2, 5)
    outside = cv2.distanceTransform(255 - mask, cv2.DIST_L2, 5)
    found = np.where(inside - outside > noise, 255, 0).astype(np.uint8)
    rows, columns = np.nonzero(found)
    for _ in range(rng.integers(0, 3)):
        i = rng.integers(len(rows))
        cv2.circle(found, (int(columns[i]), int(rows[i])), int(rng.integers(1, 3)), 0, -1)
    return found


if __name__ == "__main__":
    main()
