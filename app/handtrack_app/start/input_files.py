"""What a folder holds of which a session can be made: videos, and a calibration that names their cameras."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from handtrack.capture.calibration.formats.imported_rig import ImportedRig
from handtrack.capture.calibration.formats.read_calibration import read_calibration
from handtrack.capture.calibration.formats.resolve import named
from handtrack.capture.joints.pose2sim import is_pose2sim, read_pose2sim
from handtrack.errors import HandtrackError

VIDEOS = (".mp4", ".avi", ".mov", ".mkv", ".m4v", ".webm")
CALIBRATIONS = (".toml", ".yaml", ".yml", ".json", ".xml", ".npz", ".mat")
_MOST = 2000
"""files looked at"""


@dataclass(frozen=True)
class InputFiles:
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


def check_folder(folder: Path) -> None:
    """Raise HandtrackError for what is no folder."""
    if not folder.is_dir():
        raise HandtrackError(
            f"{folder}: no such folder. Give the folder with your cameras' videos, as a path on the machine that handtrack runs on."
        )


def find_files(folder: Path, calibrations: Sequence[Path] = ()) -> InputFiles:
    """Look into a folder, and the folders in it, for a recording. calibrations: if they lie elsewhere.

    Raises HandtrackError for what is no folder, has no video, and for a calibration that is none.
    """
    if is_pose2sim(folder):
        return _project(folder, next(iter(calibrations), None))
    check_folder(folder)
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
    return InputFiles(by_camera, tuple(calibrations), given, unused)


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


def _project(folder: Path, calibration: Path | None) -> InputFiles:
    project = read_pose2sim(folder, calibration)
    cameras = list(project.keypoints)
    given, _ = named(read_calibration([project.calibration]), cameras, str(project.calibration))
    return InputFiles(dict(project.videos), (project.calibration,), given, (), folder)


def _matched(videos: list[Path], names: list[str]) -> dict[str, Path]:
    """Return videos by camera: those whose names hold a camera's, else all by their own names, which `new` compares."""
    files: dict[str, Path] = {}
    for name in sorted(names, key=len, reverse=True):  # cam10 before cam1
        like = [p for p in videos if p not in files.values() and name.lower() in p.stem.lower()]
        like = like or [
            p for p in videos if p not in files.values() and name.lower() == p.parent.name.lower()
        ]
        if len(like) == 1:
            files[name] = like[0]
    return {n: files[n] for n in names if n in files} or {path.stem: path for path in videos}
