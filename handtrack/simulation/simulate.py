"""Render a known motion to a session folder, with its truth; and what detectors and depth sensors would write of it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from handtrack.arrays import D2, D3, Array, F, Floats, J, K, S
from handtrack.capture.calibration.rig_file import write_rig
from handtrack.capture.clouds.cloud_files import write_cloud
from handtrack.capture.clouds.point_cloud import PointCloud, depth_cloud
from handtrack.capture.images.openpose import LAYOUTS, Layout
from handtrack.capture.joints.given_joints import NAMED, write_joints
from handtrack.errors import HandtrackError
from handtrack.files.atomic import check_film
from handtrack.geometry.camera import Camera, CameraRig
from handtrack.geometry.rotation import looking_along
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.kinematics import BonePoses
from handtrack.model.model_file import load_model, write_scale
from handtrack.observation.truth import Truth
from handtrack.session import layout
from handtrack.session.first_pose import FirstPose, write_first_pose
from handtrack.session.session_file import (
    BODY_TRACKING,
    CameraSettings,
    CloudSettings,
    HandSettings,
    RecordingSettings,
    SessionFile,
    write_session_file,
)
from handtrack.session.truth import write_truth
from handtrack.simulation.motion import motion
from handtrack.simulation.render import pixel_rays, render, shade

_SKIN = np.array([224, 172, 140.0])

SCALE_FILE = "person.json"


@dataclass(frozen=True)
class Simulation:
    """What to simulate."""

    cameras: int = 3
    frames: int = 100
    size: tuple[int, int] = (640, 480)
    motion: str = "open_fist_open"
    model: str = "hand26"
    """or body34 or body38, with a motion of a body"""
    side: str = "right"
    scale: float = 1.0
    forearm: bool = False
    distance_m: float = 0.5
    fps: float = 25.0
    images: bool = True
    """colour videos beside the masks"""
    distortion: bool = False
    init_noise_m: float = 0.005
    """of the 21 keypoints in init.json; 0 writes the exact pose by parameters, as for a body always"""
    seed: int = 0
    joints_px: float | None = None
    """write 2D joints, too, as a detector's, each off by so much in either direction (standard deviation)"""
    clouds: bool = False
    """write point clouds, too, of all that the cameras see"""

    def check(self) -> None:
        """Raise HandtrackError for numbers that make no recording."""
        if not 1 <= self.cameras <= 32 or not 1 <= self.frames <= 100_000:
            raise HandtrackError(
                f"simulate: expected 1–32 cameras and 1–100000 frames, found {self.cameras} and {self.frames}."
            )
        if min(self.size) < 32 or not 0.15 <= self.distance_m <= 5 or not 0 < self.fps <= 1000:
            raise HandtrackError(
                f"simulate: expected images of at least 32 pixels, cameras 0.15–5 m away and 0–1000 frames a second, "
                f"found {self.size}, {self.distance_m} m, {self.fps}."
            )


def simulated_rig(
    count: int,
    size: tuple[int, int] = (640, 480),
    distance_m: float = 0.5,
    distortion: bool = False,
) -> CameraRig:
    """Return cameras around the world's origin, looking at it.

    Two or three stand 40° apart in an arc before the hand's back; more surround the hand, alternately above and below.
    """
    cameras = []
    focal = 0.95 * size[0]
    matrix = np.array([[focal, 0, (size[0] - 1) / 2], [0, focal, (size[1] - 1) / 2], [0, 0, 1.0]])
    lens = np.array([-0.08, 0.02, 0.0003, -0.0002, 0.0]) if distortion else np.zeros(5)
    for i in range(count):
        if count <= 3:
            around, height = np.deg2rad(40.0) * (i - (count - 1) / 2), 0.25 * (-1) ** i
        else:
            around, height = 2 * np.pi * i / count, 0.35 * (-1) ** i
        out = np.array([np.sin(around), 0.0, np.cos(around)]) * np.cos(height)
        out[1] = np.sin(height)
        rotation = looking_along(-out, np.array([0.0, -1.0, 0.0]))
        cameras.append(
            Camera(f"cam{i}", size, matrix, lens, rotation, -rotation @ (out * distance_m))
        )
    return CameraRig(tuple(cameras))


CustomMotion = tuple[ArticulatedModel, Floats[F, S], float]
"""a motion to be rendered in place of a named one: joint parameters, about the world's origin, +y up, and how far away cameras see
all of it [m]
"""


def simulate(
    folder: Path,
    what: Simulation,
    progress: Callable[[int, int], None] | None = None,
    known: CustomMotion | None = None,
) -> Path:
    """Write a session folder: calibration, masks, videos, exact truth and init.json.

    Returns the folder.

    Parameters
    ----------
    known
        Takes the place of model, motion (whose name alone counts), frames, side and scale; its size is saved in the folder.

    Raises
    ------
    HandtrackError
        When the folder holds something already: nothing is written over.
    """
    what.check()
    if folder.exists() and any(folder.iterdir()):
        raise HandtrackError(
            f"simulate: the folder {folder} is not empty; nothing was written. Name a new folder with --out."
        )
    rng = np.random.default_rng(what.seed)
    if known is None:
        model = load_model(what.model, side=what.side, scale=what.scale, forearm=what.forearm)
        joint, distance_m = motion(model, what.motion, what.frames, rng), what.distance_m
    else:
        model, joint, least_m = known
        distance_m = max(what.distance_m, least_m)
    rig = simulated_rig(what.cameras, what.size, distance_m, what.distortion)
    folder.mkdir(parents=True, exist_ok=True)
    write_rig(folder / layout.CALIBRATION_FILE, rig)
    poses = [model.bones(model.transform.solver_params(params)) for params in joint]
    _render_all(folder, what, model, rig, poses, progress)
    positions = np.stack([model.joint_positions(bones) for bones in poses])
    points = np.stack([model.keypoints21(b) for b in poses]) if model.has_keypoints21 else None
    frame = np.arange(len(poses))
    truth = Truth(frame, frame / what.fps, points, model.joint_names, positions)
    write_truth(folder / layout.TRUTH_FILE, truth)
    _write_init(folder, what, model, joint[0], rng)
    layouts = None
    if what.joints_px is not None:
        noise = partial(rng.normal, 0.0, what.joints_px)
        layouts = write_image_joints(folder, model, rig, model.joint_names, positions, noise)
    entries = tuple(
        CameraSettings(
            name=camera.name,
            images=f"{camera.name}.mp4" if what.images else None,
            masks=f"masks/{camera.name}/*.png",
            keypoints=None if layouts is None else f"joints/{camera.name}/*.json",
            keypoint_layout=layouts,
        )
        for camera in rig.cameras
    )
    recording = RecordingSettings(name=f"simulated {what.motion}", fps=what.fps)
    hand = HandSettings(model=what.model, side=what.side, scale=what.scale)
    if known is not None:
        write_scale(folder / SCALE_FILE, model.scale)
        hand = HandSettings(model.name, model.side, SCALE_FILE)
    tracking = BODY_TRACKING if model.kind == "body" else {}
    clouds = CloudSettings(files="clouds/*.ply") if what.clouds else None
    file = SessionFile(recording, hand, entries, clouds, tracking)
    write_session_file(folder / layout.SESSION_FILE, file)
    return folder


def _render_all(
    folder: Path,
    what: Simulation,
    model: ArticulatedModel,
    rig: CameraRig,
    poses: Sequence[BonePoses],
    progress: Callable[[int, int], None] | None,
) -> None:
    ellipsoids = model.ellipsoids["fine"]
    colors = np.tile(_SKIN, (len(ellipsoids), 1))
    clouds: dict[int, list[PointCloud]] = {}
    for c, camera in enumerate(rig.cameras):
        rays = pixel_rays(camera)
        masks = folder / "masks" / camera.name
        masks.mkdir(parents=True)
        video = _video(folder / f"{camera.name}.mp4", what) if what.images else None
        for frame, bones in enumerate(poses):
            front, depth, normal = render(camera, ellipsoids.posed(bones), rays)
            if what.clouds:
                clouds.setdefault(frame, []).append(depth_cloud(camera, depth))
            mask = np.where(front >= 0, 255, 0).astype(np.uint8)
            _saved(masks / f"{frame:06d}.png", mask)
            if video is not None:
                picture = shade(front, normal, colors, _backdrop(what.size))
                video.write(np.ascontiguousarray(picture[..., ::-1]))
            if progress is not None:
                progress(c * len(poses) + frame + 1, len(poses) * len(rig.cameras))
        if video is not None:
            video.release()
            check_film(folder / f"{camera.name}.mp4", len(poses))
    write_clouds(folder, clouds)


def _backdrop(size: tuple[int, int]) -> Array:
    fall = np.linspace(96, 58, size[1])[:, None, None]
    return np.broadcast_to(fall * [0.92, 1.0, 1.08], (size[1], size[0], 3))


def _video(path: Path, what: Simulation) -> cv2.VideoWriter:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), what.fps, what.size)
    if not writer.isOpened():
        raise HandtrackError(
            f"simulate: this OpenCV cannot write the video {path.name}; use --no-images for masks alone."
        )
    return writer


def _saved(path: Path, image: Array) -> None:
    if not cv2.imwrite(str(path), image, [cv2.IMWRITE_PNG_COMPRESSION, 9]):
        raise HandtrackError(f"simulate: could not write {path}; is the disk full or read-only?")


def _write_init(
    folder: Path, what: Simulation, model: ArticulatedModel, first: Floats, rng: np.random.Generator
) -> None:
    if what.init_noise_m > 0 and model.kind == "hand" and model.has_keypoints21:
        points = model.keypoints21(model.bones(model.transform.solver_params(first)))
        noisy = points + rng.normal(scale=what.init_noise_m, size=points.shape)
        pose = FirstPose(0, xyz=np.round(noisy, 5))
    else:
        pose = FirstPose(0, model.named(first))
    write_first_pose(folder / layout.INIT_FILE, pose)


# ---- What detectors and depth sensors would write: 2D joints, and point clouds


_MOST = 20_000
"""points of a frame's cloud: what a depth camera has on a person"""


def layout_of_model(model: ArticulatedModel) -> str:
    """Return the session's keypoint_layout for all of a model's joints."""
    return NAMED if model.kind == "body" else f"hand_{model.side}"


def points_of(layout: Layout, names: Iterable[str], pixels: Floats[J, D2]) -> Floats[K, D3]:
    """Return points in a layout's order, confidence 1; those that are unknown or beyond the layout are missing."""
    points = np.zeros((layout.count, 3))
    for name, pixel in zip(names, pixels, strict=True):
        if name in layout.points and np.isfinite(pixel).all():
            points[layout.points[name]] = (*pixel, 1.0)
    return points


def write_image_joints(
    folder: Path,
    model: ArticulatedModel,
    rig: CameraRig,
    names: Sequence[str],
    positions: Floats[F, J, D3],
    noise_px: Callable[[tuple[int, ...]], Array[F, J, D2]] = np.zeros,
) -> str:
    """Write where every camera sees named joints world [m] to `joints/CAMERA`, confidence 1, and return their layout; those that are
    unknown or beyond the layout are missing.
    """
    kind = layout_of_model(model)
    for camera in rig:
        pixels = camera.project(positions)
        seen = pixels + noise_px(pixels.shape)
        points = {frame: points_of(LAYOUTS[kind], names, one) for frame, one in enumerate(seen)}
        write_joints(points, kind, folder / "joints" / camera.name)
    return kind


def write_clouds(folder: Path, clouds: Mapping[int, list[PointCloud]]) -> None:
    """Write the clouds of each frame, of all cameras together, thinned evenly, to `clouds`."""
    for frame, parts in clouds.items():
        points = np.concatenate([part.points for part in parts])
        kept = points[:: max(len(points) // _MOST, 1)]
        path = folder / "clouds" / f"{frame:06d}.ply"
        path.parent.mkdir(exist_ok=True)
        write_cloud(path, PointCloud(kept))
