"""A made recording like a real one: another hand of another shape over a desk, two cameras, shade, a drawn detector's joints.

Write one and compare tracks with its truth: python -m tests.experiments.scenes.made_desk write FOLDER [SEED], and
python -m tests.experiments.scenes.made_desk compare FOLDER POSES.npz …
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from handtrack.arrays import Array, Floats
from handtrack.capture.calibration.rig_file import write_rig
from handtrack.capture.images.openpose import write_hand
from handtrack.capture.masks.seeded import Seeded
from handtrack.geometry.camera import Camera
from handtrack.model.articulated import FINGERS, ArticulatedModel, HandScale, keypoint_names
from handtrack.model.kinematics import BonePoses
from handtrack.model.model_file import load_model, scale_from
from handtrack.session.formats.tables import read_npz
from handtrack.session.formats.truth import read_truth
from handtrack.session.session import Session
from handtrack.session.session_file import (
    CameraSettings,
    HandSettings,
    RecordingSettings,
    SessionFile,
    write_session_file,
)
from handtrack.simulation.motion import motion
from handtrack.simulation.render import pixel_rays, render, render_mask
from handtrack.simulation.simulate import simulated_rig
from handtrack.tracking.frame.result import Status
from handtrack.tracking.search.keypoint_start import triangulated
from tests.experiments.scenes.textured_mesh import Pattern, cluttered_background

FRAMES, FPS, SIZE = 60, 30.0, (640, 480)
MOTIONS = ("gestures", "open_fist_open")
_SKIN = np.array([120.0, 150, 205])  # BGR
_DESK = np.array([190.0, 195, 200])
_LIGHT = np.array([-0.35, -0.6, -0.72])
_MOTTLED = 0.25
"""of a pattern's swing: skin varies by some 10 levels"""
_OFFSET_M, _NOISE_PX, _LASTS = 0.010 / np.sqrt(3), 3.5, 0.8
"""of a detector's joints: where it sees them, by how much that varies, correlation from frame to frame (docs/how-to/masks_and_joints.md)"""
_GIRTH, _LENGTH, _FINGER, _ELLIPSOID = 0.08, 0.06, 0.04, 0.05
"""how people differ from one another, and flesh from ellipsoids"""


def another_hand(rng: np.random.Generator) -> ArticulatedModel:
    """Return a right hand with a bare arm, of somebody's lengths and girths, lumpier than ours."""
    parts = {finger: float(np.exp(_FINGER * rng.normal())) for finger in FINGERS}
    scale = HandScale(float(np.exp(_LENGTH * rng.normal())), parts)
    model = load_model("hand26", scale=scale, forearm=True)
    fine, groups = model.flesh["fine"], np.array(model.groups)
    girth = {group: np.exp(_GIRTH * rng.normal()) for group in sorted(set(groups))}
    factor = np.array([girth[group] for group in groups[fine.bone]])
    radii = fine.radii * np.exp(_ELLIPSOID * rng.normal(size=fine.radii.shape))
    radii[:, [0, 2]] *= factor[:, None]
    return replace(model, flesh={**model.flesh, "fine": replace(fine, radii=radii)})


def write_recording(folder: Path, seed: int, frames: int = FRAMES) -> Path:
    """Write a session with images, joints, true masks and joints in space; masks are `seeded`."""
    rng = np.random.default_rng(seed)
    model = another_hand(rng)
    poses = motion(model, MOTIONS[seed % len(MOTIONS)], frames, rng, wander=2.0)
    poses[:, 3:6] += [0.3, 0.0, 0.0]
    rig = simulated_rig(2, SIZE, 0.5)
    offset = _OFFSET_M * rng.normal(size=(len(model.joint_names), 3))
    paint = Pattern.random(model.skeleton.bone_count, rng, 0.02)
    names = list(model.joint_names)
    at = [names.index(name) for name in keypoint_names()]
    bones = [model.bones(model.transform.solver_params(pose)) for pose in poses]
    folder.mkdir(parents=True)
    for camera in rig.cameras:
        for kind in ("images", "truth", "joints"):
            (folder / kind / camera.name).mkdir(parents=True)
        rays, room = pixel_rays(camera), 0.25 * cluttered_background(SIZE, rng) + 0.75 * _DESK
        wrong = _NOISE_PX * rng.normal(size=(len(at), 2))
        for frame, posed in enumerate(bones):
            front, depth, normal = render(camera, model.flesh["fine"].posed(posed), rays)
            hand = front >= 0
            lit = np.clip(normal @ (_LIGHT / np.linalg.norm(_LIGHT)), 0, 1)
            image = room * (1 - 0.5 * _shadow(hand))[..., None]
            skin = _SKIN + _MOTTLED * _pattern(model, posed, paint, camera, front, depth, rays)
            image[hand] = (skin * (0.2 + 0.8 * lit[..., None]))[hand]
            image = cv2.GaussianBlur(image, (3, 3), 0) + rng.normal(scale=3, size=image.shape)
            name = f"{frame:06d}"
            pixels = np.clip(image, 0, 255).astype(np.uint8)
            cv2.imwrite(str(folder / "images" / camera.name / f"{name}.png"), pixels)
            truth = 255 * hand.astype(np.uint8)
            cv2.imwrite(str(folder / "truth" / camera.name / f"{name}.png"), truth)
            wrong = _LASTS * wrong + np.sqrt(1 - _LASTS**2) * _NOISE_PX * rng.normal(
                size=wrong.shape
            )
            turned = np.einsum("jik,jk->ji", posed.rotation[model.joint_bone], offset)
            seen = camera.project(model.joint_positions(posed) + turned)[at] + wrong
            points = np.column_stack([seen, np.full(len(at), 0.9)])
            path = folder / "joints" / camera.name / f"{name}.json"
            write_hand(path, points, "right", "made_desk")
    write_rig(folder / "calibration.toml", rig)
    np.savez_compressed(
        folder / "truth.npz",
        joint_names=np.array(names),
        joint_positions=np.stack([model.joint_positions(b) for b in bones]),
        keypoints21=np.stack([model.keypoints21(b) for b in bones]),
        time_s=np.arange(frames) / FPS,
    )
    cameras = tuple(
        CameraSettings(
            camera.name,
            f"images/{camera.name}/*.png",
            Seeded(),
            keypoints=f"joints/{camera.name}/*.json",
            keypoint_layout="mediapipe21",
        )
        for camera in rig.cameras
    )
    hand = HandSettings(side="right", scale="fit")
    file = SessionFile(RecordingSettings(f"made desk {seed}", FPS), hand, cameras)
    write_session_file(folder / "session.toml", file)
    return folder


def compare(folder: Path, poses: Path) -> dict[str, float]:
    """Return mean error of joints [mm], its 90 %, how it jitters, and the joints' triangulation by itself [mm a frame²], overlap
    before the wrist (IoU), share of frames that are not lost or in doubt.
    """
    session, track, truth = Session.open(folder), read_npz(poses), read_truth(folder / "truth.npz")
    names = [str(name) for name in track.joint_names]
    true_names = [str(name) for name in truth.joint_names]
    shared = [name for name in names if name in true_names]
    found = track.joint_positions[:, [names.index(name) for name in shared]]
    true = truth.joint_positions[track.frame][:, [true_names.index(name) for name in shared]]
    errors = 1e3 * np.linalg.norm(found - true, axis=2)
    size = scale_from(json.loads(str(track.scale)), poses)
    model = load_model(
        scale=size, side=str(track.side), forearm="forearm" in list(map(str, track.bone_names))
    )
    overlaps = []
    knuckles = [shared.index(f"{finger}_mcp") for finger in FINGERS[1:]]
    for camera in session.rig.cameras:
        rays = pixel_rays(camera)
        for i in range(0, len(track.frame), 4):
            bones = model.bones(model.transform.solver_params(track.parameters[i]))
            seen = render_mask(camera, model.flesh["fine"].posed(bones), rays) > 0
            file = folder / "truth" / camera.name / f"{int(track.frame[i]):06d}.png"
            hand = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE) > 0
            places = camera.project(true[i])
            wrist, middle = places[shared.index("wrist")], places[knuckles].mean(axis=0)
            row, column = np.indices(hand.shape)
            before = np.stack([column, row], -1) @ (middle - wrist) > wrist @ (middle - wrist)
            both, either = (seen & hand & before).sum(), ((seen | hand) & before).sum()
            overlaps.append(both / either)
    by_joints = triangulated_joints(session, [int(f) for f in track.frame])
    at = [i for i, name in enumerate(shared) if name in keypoint_names()]
    of = [keypoint_names().index(shared[i]) for i in at]
    return {
        "mean_mm": float(errors.mean()),
        "p90_mm": float(np.percentile(errors, 90)),
        "jitter_mm": jitter_mm(found - true),
        "detector_jitter_mm": jitter_mm(by_joints[:, of] - true[:, at]),
        "iou": float(np.mean(overlaps)),
        "tracked": float(np.mean(np.isin(track.status, (Status.TRACKED, Status.KEYFRAME)))),
    }


def triangulated_joints(session: Session, frames: Sequence[int]) -> Floats:
    """Return where a detector's joints, seen by several cameras, are in space (F, 21, 3) [m]; NaN where too few see one."""
    return np.stack(
        [
            triangulated([p for v in session.views for p in v.keypoints(f, 1.0)], keypoint_names())
            for f in frames
        ]
    )


def jitter_mm(places: Floats) -> float:
    """Return the median length of the second difference of places (F, J, 3) [m] over joints and frames [mm]."""
    return 1e3 * float(np.nanmedian(np.linalg.norm(np.diff(places, 2, axis=0), axis=2)))


def _shadow(hand: Array) -> Floats:
    moved = np.roll(hand.astype(np.float64), (18, 26), axis=(0, 1))
    return np.asarray(cv2.GaussianBlur(moved, (31, 31), 0), float)


def _pattern(
    model: ArticulatedModel,
    bones: BonePoses,
    paint: Pattern,
    camera: Camera,
    front: Array,
    depth: Floats,
    rays: Floats,
) -> Floats:
    """Return how a pixel's colour differs from the skin's mean (H, W, 1)."""
    out = np.zeros((*front.shape, 1))
    hand = front >= 0
    bone = model.flesh["fine"].bone[front[hand]]
    point = (rays[hand] * depth[hand][:, None] - camera.translation) @ camera.rotation
    local = np.einsum("nji,nj->ni", bones.rotation[bone], point - bones.position[bone])
    out[hand] = (paint(bone, local) - paint.base[bone])[:, :1]
    return out


def main() -> None:
    what, folder, *rest = sys.argv[1:]
    if what == "write":
        write_recording(Path(folder), int(rest[0]) if rest else 0)
        return
    for poses in rest:
        figures = compare(Path(folder), Path(poses))
        print(Path(poses).stem, "  ".join(f"{key} {value:.3f}" for key, value in figures.items()))


if __name__ == "__main__":
    main()
