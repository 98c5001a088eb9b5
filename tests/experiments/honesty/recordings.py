"""Recordings of other people's hands, with truth: python -m tests.experiments.honesty.recordings MESHES HALF OUT

MESHES: a folder with `webxr_generic_hand`, `umetrack_generic_hand` and, for its motions, `realsense_hand_pose`. HALF: `tune` or
`apart`, two lists of different people, motions and noise; figures are fitted on the one and stated of the other.
"""

from __future__ import annotations

import sys
import zlib
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from handtrack.arrays import D3, D21, Array, F, Floats, N, T
from handtrack.capture.calibration.rig_file import write_rig
from handtrack.geometry.camera import Camera, CameraRig
from handtrack.geometry.rotation import rotation_matrix
from handtrack.session import layout
from handtrack.session.clouds_settings import CloudSettings
from handtrack.session.first_pose.first_pose import FirstPose, write_first_pose
from handtrack.session.session_file import (
    CameraSettings,
    HandSettings,
    RecordingSettings,
    SessionFile,
    write_session_file,
)
from handtrack.simulation.simulate import simulated_rig
from tests.experiments.honesty import motions
from tests.experiments.honesty.drawing import damaged, depth, noisy, outline, ragged
from tests.experiments.honesty.meshes import HandMesh, read_meshes
from tests.experiments.honesty.people import as_person, mirrored, somebody

FRAMES, FPS = 60, 25.0
DEPTH_SCALE_M = 0.0001
OFF_DEG, OFF_M, OFF_FOCAL = 0.5, 0.002, 0.005
"""by how much each camera of a poor calibration is turned, moved, and its focal length wrong"""
_LATE = 2
_INIT_NOISE_M = 0.005


@dataclass(frozen=True)
class Kind:
    """How a hand is recorded."""

    cameras: int = 3
    sees: str = "masks"
    """masks, depth, or cloud"""
    ragged: bool = False
    off: bool = False
    """the calibration that is written is wrong"""
    late: float = 0.0
    """frames ago that the second camera shows, at most two"""
    gaps: bool = False
    """a fifth of the masks is missing, and the second camera begins at frame 10"""
    noise: bool = False
    damaged: bool = False
    forearm: bool = False


KINDS = {
    "3cam": Kind(),
    "3cam_ragged": Kind(ragged=True),
    "2cam": Kind(2),
    "2cam_gaps": Kind(2, gaps=True),
    "3cam_off": Kind(off=True),
    "2cam_off": Kind(2, off=True),
    "3cam_late": Kind(late=2.0),
    "6cam": Kind(6),
    "depth": Kind(1, "depth"),
    "depth_noisy": Kind(1, "depth", noise=True),
    "depth_damaged": Kind(1, "depth", noise=True, damaged=True, forearm=True),
    "stereo": Kind(1, "cloud"),
}
Row = tuple[str, str, str]
"""kind, mesh, motion: one of `motions.SHAPES`, or FILE:ROW of RealSense's recordings"""
HALVES: dict[str, list[Row]] = {
    "tune": [
        ("3cam", "webxr", "curls"), ("3cam", "umetrack", "letters"), ("3cam", "umetrack", "fist"),
        ("3cam_ragged", "umetrack", "pinches"), ("3cam_ragged", "webxr", "animbank_a:120"),
        ("2cam", "webxr", "turns"), ("2cam", "umetrack", "fist"),
        ("2cam_gaps", "webxr", "animbank_a:440"), ("2cam_gaps", "umetrack", "curls"),
        ("3cam_off", "webxr", "letters"), ("2cam_off", "webxr", "curls"),
        ("3cam_late", "webxr", "waves"), ("6cam", "webxr", "fist"),
        ("depth", "webxr", "curls"), ("depth_noisy", "umetrack", "letters"),
        ("depth_damaged", "webxr", "pinches"), ("depth_damaged", "umetrack", "animbank_a:620"),
        ("stereo", "umetrack", "turns"),
    ],
    "apart": [
        ("3cam", "umetrack", "curls"), ("3cam", "webxr", "letters"), ("3cam", "webxr", "fist"),
        ("3cam_ragged", "webxr", "pinches"), ("3cam_ragged", "umetrack", "animbank_a:800"),
        ("2cam", "umetrack", "spread"), ("2cam", "webxr", "fist"),
        ("2cam_gaps", "umetrack", "hand_data_example:0"), ("2cam_gaps", "webxr", "pinches"),
        ("3cam_off", "umetrack", "turns"), ("2cam_off", "umetrack", "letters"),
        ("3cam_late", "umetrack", "waves"), ("6cam", "umetrack", "fist"),
        ("depth", "umetrack", "spread"), ("depth_noisy", "webxr", "animbank_a:960"),
        ("depth_damaged", "umetrack", "curls"), ("depth_damaged", "webxr", "letters"),
        ("stereo", "webxr", "curls"),
    ],
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Moving:
    """A hand over the frames of a recording, in the world [m]."""

    vertices: Floats[F, N, D3]
    triangles: Array[T, D3]
    keypoints: Floats[F, D21, D3]
    left: bool

    def vertices_at(self, frame: float) -> Floats[N, D3]:
        """Return where they are between two frames."""
        before, share = int(frame), frame % 1.0
        return (1.0 - share) * self.vertices[before] + share * self.vertices[
            min(before + 1, len(self.vertices) - 1)
        ]


def write_half(meshes: Path, half: str, out: Path) -> list[Path]:
    """Write the recordings of a half into a folder; return theirs. Of a wrong calibration its right twin comes too."""
    hands = read_meshes(meshes)
    found = []
    for row in HALVES[half]:
        kind, mesh, motion = row
        name = f"{kind}_{mesh}_{motion.partition(':')[0].replace('_', '')}"
        twins = {name: KINDS[kind]}
        if KINDS[kind].off:
            twins[name.replace("_off", "_clean")] = replace(KINDS[kind], off=False)
        for each, how in twins.items():
            rng = np.random.default_rng(zlib.crc32(" ".join((half, *row)).encode()))
            hand = _moving(hands[mesh], motion, meshes, rng, how)
            found.append(_write(out / each, each, how, hand, rng))
    return found


def _moving(
    mesh: HandMesh, motion: str, folder: Path, rng: np.random.Generator, kind: Kind
) -> Moving:
    who, frames = somebody(rng), FRAMES + _LATE
    person = as_person(mesh, who)
    if ":" in motion:
        file, _, row = motion.partition(":")
        path = folder / "realsense_hand_pose" / f"{file}.pose"
        angles = motions.read(path, int(row), frames)
    else:
        angles = motions.moving(motion, frames, rng)
    turn, place = motions.wrist(motion, frames, rng)
    if kind.sees != "masks" and rng.random() < 0.5:  # its palm to the camera
        turn = turn @ rotation_matrix(np.array([0.0, np.pi, 0.0]))
    middle, triangles = person.keypoints[9], person.triangles
    arm = _forearm(person) if kind.forearm else (np.zeros((0, 3)), np.zeros((0, 3), int))
    triangles = np.concatenate([triangles, arm[1] + len(person.vertices)])
    vertices, points = [], []
    for pose, r, t in zip(angles, turn, place, strict=True):
        v, k = person.posed(pose)
        v = np.concatenate([v, arm[0]])
        if who.left:
            v, k = mirrored(v), mirrored(k)
        centre = mirrored(middle) if who.left else middle
        vertices.append((v - centre) @ r.T + t)
        points.append((k - centre) @ r.T + t)
    return Moving(np.array(vertices), triangles, np.array(points), who.left)


def _forearm(person: HandMesh) -> tuple[Floats[N, D3], Array]:
    """Return a stub of a forearm: an elliptic tube from the wrist down."""
    near = np.abs(person.vertices[:, 1]) < 0.012
    wrist = person.vertices[near]
    middle = wrist.mean(axis=0)
    radii = np.abs(wrist - middle).max(axis=0)[[0, 2]]
    around = np.linspace(0, 2 * np.pi, 25)[:-1]
    rings = [
        middle + np.stack([g * radii[0] * np.cos(around), np.full(24, y), g * radii[1] * np.sin(around)], 1)
        for y, g in ((-0.01, 1.0), (-0.06, 1.1), (-0.13, 1.3))
    ]  # fmt: skip
    a = np.arange(24)
    b = np.roll(a, -1)
    faces = [
        np.concatenate([np.stack([a, b, a + 24], 1), np.stack([b, b + 24, a + 24], 1)]) + 24 * k
        for k in range(2)
    ]
    return np.concatenate(rings), np.concatenate(faces)


def _rig(kind: Kind, rng: np.random.Generator) -> CameraRig:
    """Return cameras about as simulate places them, each a little elsewhere."""
    cameras = []
    distance = 0.45 if kind.sees != "masks" else 0.55
    for camera in simulated_rig(kind.cameras, (640, 480), distance):
        turn = rotation_matrix(np.deg2rad(rng.normal(0, 6.0, 3)))
        place = camera.translation + np.array([*rng.normal(0, 0.01, 2), rng.normal(0, 0.03)])
        cameras.append(replace(camera, rotation=camera.rotation @ turn, translation=place))
    return CameraRig(tuple(cameras))


def _wrong(rig: CameraRig, rng: np.random.Generator) -> CameraRig:
    """Return the calibration of which each camera is off."""

    def direction() -> Floats[D3]:
        v = rng.normal(size=3)
        return v / np.linalg.norm(v)

    found = []
    for camera in rig:
        turn = rotation_matrix(np.deg2rad(OFF_DEG) * direction()) @ camera.rotation
        centre = -camera.rotation.T @ camera.translation + OFF_M * direction()
        matrix = camera.matrix.copy()
        matrix[[0, 1], [0, 1]] *= 1.0 + OFF_FOCAL * rng.choice([-1.0, 1.0])
        found.append(replace(camera, matrix=matrix, rotation=turn, translation=-turn @ centre))
    return CameraRig(tuple(found))


def _write(folder: Path, name: str, kind: Kind, hand: Moving, rng: np.random.Generator) -> Path:
    folder.mkdir(parents=True)
    rig = _rig(kind, rng)
    points = hand.keypoints[_LATE:]
    noise = rng.normal(scale=_INIT_NOISE_M, size=points[0].shape)
    write_first_pose(folder / layout.INIT_FILE, FirstPose(0, xyz=np.round(points[0] + noise, 5)))
    np.savez_compressed(
        folder / layout.TRUTH_FILE, keypoints21=points, time_s=np.arange(FRAMES) / FPS
    )
    written = _wrong(rig, rng) if kind.off else rig
    write_rig(folder / layout.CALIBRATION_FILE, written)
    draw = {"masks": _masks, "depth": _depths, "cloud": _clouds}[kind.sees]
    for number, camera in enumerate(rig):
        draw(folder, camera, number, kind, hand, rng)
    _write_settings(folder, name, kind, rig, hand.left)
    return folder


def _write_settings(folder: Path, name: str, kind: Kind, rig: CameraRig, left: bool) -> None:
    cameras = []
    for camera in rig:
        seen: dict[str, object] = {"masks": f"masks/{camera.name}/*.png"}
        if kind.sees == "depth":
            seen = {"depth": f"depth/{camera.name}/*.png", "depth_scale_m": DEPTH_SCALE_M}
        elif kind.sees == "cloud":
            seen = {}
        cameras.append(CameraSettings(name=camera.name, **seen))  # pyright: ignore[reportArgumentType]
    clouds = {
        "masks": None,
        "depth": CloudSettings(depth=("cam0",)),
        "cloud": CloudSettings(files="clouds/*.npz"),
    }[kind.sees]
    file = SessionFile(
        RecordingSettings(name=name.replace("_", " "), fps=FPS),
        HandSettings(side="left" if left else "right", scale="fit"),
        tuple(cameras), clouds,
    )  # fmt: skip
    write_session_file(folder / layout.SESSION_FILE, file)


def _masks(
    folder: Path, camera: Camera, number: int, kind: Kind, hand: Moving, rng: np.random.Generator
) -> None:
    to = folder / "masks" / camera.name
    to.mkdir(parents=True)
    back = kind.late if number == 1 else 0.0
    begins = 10 if kind.gaps and number == 1 else 0
    for frame in range(FRAMES):
        if kind.gaps and (frame < begins or (frame > 0 and rng.random() < 0.2)):
            continue
        mask = outline(camera, hand.vertices_at(frame + _LATE - back), hand.triangles)
        if kind.ragged:
            mask = ragged(mask, rng)
        cv2.imwrite(str(to / f"{frame:06d}.png"), mask)


def _depths(
    folder: Path, camera: Camera, number: int, kind: Kind, hand: Moving, rng: np.random.Generator
) -> None:
    to = folder / "depth" / camera.name
    to.mkdir(parents=True)
    for frame in range(FRAMES):
        seen = depth(camera, hand.vertices[frame + _LATE], hand.triangles)
        if kind.noise:
            seen = noisy(seen, rng)
        if kind.damaged:
            seen = damaged(seen, rng)
        units = np.round(seen / DEPTH_SCALE_M).clip(0, 65535).astype(np.uint16)
        cv2.imwrite(str(to / f"{frame:06d}.png"), units)


def _clouds(
    folder: Path, camera: Camera, number: int, kind: Kind, hand: Moving, rng: np.random.Generator
) -> None:
    """Write clouds as two cameras' matching gives them: errors alike over some pixels, a few points far off."""
    to = folder / "clouds"
    to.mkdir(parents=True)
    for frame in range(FRAMES):
        seen = noisy(
            depth(camera, hand.vertices[frame + _LATE], hand.triangles), rng, 0.0008, 0.0022
        )
        rows, columns = np.nonzero(seen)
        kept = rng.choice(len(rows), min(5000, len(rows)), replace=False)
        rows, columns = rows[kept], columns[kept]
        z = seen[rows, columns]
        far = rng.random(len(z)) < 0.03
        z = np.where(far, z + rng.uniform(-0.05, 0.05, len(z)), z)
        rays = np.column_stack([columns, rows, np.ones(len(z))]) @ np.linalg.inv(camera.matrix).T
        points = (rays * z[:, None] - camera.translation) @ camera.rotation
        np.savez_compressed(to / f"{frame:06d}.npz", points=points.astype(np.float32))


if __name__ == "__main__":
    for written in write_half(Path(sys.argv[1]), sys.argv[2], Path(sys.argv[3])):
        print(written)
