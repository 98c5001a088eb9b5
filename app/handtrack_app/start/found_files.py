"""What a folder holds of which a session can be made: videos, and a calibration that names their cameras."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import viser
import viser.transforms as vtf

from handtrack.arrays import D3, Bytes, H, W
from handtrack.capture.calibration.formats.imported_rig import ImportedRig
from handtrack.capture.calibration.formats.read_calibration import read_calibration
from handtrack.capture.calibration.formats.resolve import named
from handtrack.capture.images.video import VideoFile
from handtrack.capture.joints.pose2sim import is_pose2sim, read_pose2sim
from handtrack.errors import HandtrackError
from handtrack.geometry.camera import CameraRig
from handtrack.geometry.triangulation import triangulated
from handtrack_app.page.scene.viewpoint import Viewpoint, frustum_scale, look_from
from handtrack_app.start.import_progress import small_picture

VIDEOS = (".mp4", ".avi", ".mov", ".mkv", ".m4v", ".webm")
CALIBRATIONS = (".toml", ".yaml", ".yml", ".json", ".xml", ".npz", ".mat")
_MOST = 2000
"""files looked at"""


@dataclass(frozen=True)
class FoundFiles:
    """Videos by camera, and the calibration."""

    videos: dict[str, Path]
    calibrations: tuple[Path, ...]
    """one file of all cameras, or one a camera"""
    given: ImportedRig | None
    """its cameras, in its own unit"""
    unused: tuple[Path, ...]
    """videos of no camera"""
    project: Path | None = None
    """the folder, where it is a Pose2Sim project: `new` finds videos and 2D joints in it"""


def find_files(folder: Path, calibrations: Sequence[Path] = ()) -> FoundFiles:
    """Look into a folder, and the folders in it, for a recording. calibrations: if they lie elsewhere.

    Raises HandtrackError for what is no folder, has no video, and for a calibration that is none.
    """
    if is_pose2sim(folder):
        return _project(folder, next(iter(calibrations), None))
    if not folder.is_dir():
        raise HandtrackError(
            f"{folder}: no such folder. Give the folder with your cameras' videos, as a path on the machine that handtrack runs on."
        )
    files = sorted(
        path for path in [*folder.glob("*"), *folder.glob("*/*")][:_MOST] if path.is_file()
    )
    videos = [path for path in files if path.suffix.lower() in VIDEOS]
    if not videos:
        raise HandtrackError(f"{folder}: no video in it ({', '.join(VIDEOS)}).")
    given: ImportedRig | None = None
    if calibrations:
        given = read_calibration(calibrations)
    else:
        calibrations, given = _calibrated([p for p in files if p.suffix.lower() in CALIBRATIONS])
    cameras = () if given is None else given.cameras
    by_camera = _matched(videos, [camera.name for camera in cameras if camera.name is not None])
    unused = tuple(path for path in videos if path not in by_camera.values())
    return FoundFiles(by_camera, tuple(calibrations), given, unused)


def _calibrated(files: Sequence[Path]) -> tuple[tuple[Path, ...], ImportedRig | None]:
    """Return the first file that has several cameras; else all that have one each, together. Raises HandtrackError for several that are no rig."""
    alone: dict[Path, ImportedRig] = {}
    for path in files:
        try:
            rig = read_calibration([path])
        except HandtrackError:
            continue
        if len(rig.cameras) > 1:
            return (path,), rig
        alone[path] = rig
    if len(alone) > 1:
        return tuple(alone), read_calibration(list(alone))
    return tuple(alone), next(iter(alone.values()), None)


def _project(folder: Path, calibration: Path | None) -> FoundFiles:
    project = read_pose2sim(folder, calibration)
    cameras = list(project.keypoints)
    given, _ = named(read_calibration([project.calibration]), cameras, str(project.calibration))
    return FoundFiles(dict(project.videos), (project.calibration,), given, (), folder)


def _matched(videos: list[Path], names: list[str]) -> dict[str, Path]:
    """Return videos by camera: those whose names hold a camera's, else all by their own names, which `new` compares."""
    found: dict[str, Path] = {}
    for name in sorted(names, key=len, reverse=True):  # cam10 before cam1
        like = [p for p in videos if p not in found.values() and name.lower() in p.stem.lower()]
        like = like or [
            p for p in videos if p not in found.values() and name.lower() == p.parent.name.lower()
        ]
        if len(like) == 1:
            found[name] = like[0]
    return {n: found[n] for n in names if n in found} or {path.stem: path for path in videos}


# ---- Cameras of a calibration in the scene, each with its video's first image: a wrong order or pose is seen at once


_NAME = "/rig"
_DEEP = 0.3  # of a frustum, as a share of the cameras' usual distance
_AWAY = 2.8  # from which it is seen, in the cameras' usual distances
_COLOUR = (150, 158, 168)


def first_image(video: Path, where: str) -> Bytes[H, W, D3] | None:
    """Return a video's first image, small, RGB; None where it cannot be read."""
    try:
        source = VideoFile(video, None, where)
        image = source.read(0)
        source.close()
    except HandtrackError:
        return None
    if image is None:
        return None
    return small_picture(image)[..., ::-1]


def show_rig(server: viser.ViserServer, rig: CameraRig, images: dict[str, Bytes[H, W, D3]]) -> None:
    """Draw the cameras, in a size in which they stand about a metre from what they look at, whatever their unit."""
    cameras = list(rig)
    middles = np.stack([camera.matrix[None, :2, 2] for camera in cameras])
    centre = triangulated([camera.without_distortion() for camera in cameras], middles)[0]
    places = np.stack([camera.centre for camera in cameras])
    if not np.isfinite(centre).all():
        centre = places.mean(axis=0) + cameras[0].rotation[2] * max(float(np.ptp(places)), 1.0)
    unit = float(np.median(np.linalg.norm(places - centre, axis=1))) or 1.0
    with server.atomic():
        server.scene.remove_by_name(_NAME)
        server.scene.add_frame(_NAME, show_axes=False)
        for camera, place in zip(cameras, (places - centre) / unit, strict=True):
            (width, height), down = camera.size, camera.size[1] / 2 / camera.matrix[1, 1]
            scale = frustum_scale(camera.size, down, _DEEP)
            wxyz = vtf.SO3.from_matrix(camera.rotation.T).wxyz
            server.scene.add_camera_frustum(
                f"{_NAME}/{camera.name}", fov=float(2 * np.arctan(down)), aspect=width / height, scale=scale, thickness=1.5,
                thickness_units="screen", color=_COLOUR, image=images.get(camera.name), format="jpeg", wxyz=wxyz, position=place,
            )  # fmt: skip
            server.scene.add_label(
                f"{_NAME}/{camera.name}/label",
                camera.name,
                position=(0.0, -1.12 * down * _DEEP, _DEEP),
            )
    up = -np.mean([camera.rotation[1] for camera in cameras], axis=0)
    middle = np.mean((places - centre) / unit, axis=0)
    away = middle + 0.8 * up + 0.6 * np.cross(up, middle)
    seen_from = middle / 2 + _AWAY * away / np.linalg.norm(away)
    view = Viewpoint(seen_from, middle / 2, up / np.linalg.norm(up), 0.75)
    server.scene.set_up_direction(view.up)
    for client in server.get_clients().values():
        look_from(client, view)
