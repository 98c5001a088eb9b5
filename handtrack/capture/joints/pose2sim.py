"""A Pose2Sim project: where its calibration, videos and 2D joints lie, and its rate.

Versions differ in the names of folders: `calibration`, `S00_Calibration` or `calib-2d`, in the trial or above it; `videos` or `raw-2d`;
`pose` or `pose-2d`, `pose-sync`, `pose-associated`; `Config.toml` in each of the levels, the innermost counts.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from handtrack.capture.calibration.formats.imported_rig import ImportedRig
from handtrack.capture.calibration.formats.read_calibration import named, read_calibration
from handtrack.capture.images.frames import IMAGE_SUFFIXES, files_by_frame
from handtrack.errors import HandtrackError
from handtrack.files.toml_table import read_toml

_VIDEOS = (".mp4", ".avi", ".mov", ".mkv", ".m4v", ".webm", ".mpeg", ".mpg")
_CALIBRATIONS = (".toml", ".txt", ".xml", ".yml", ".yaml", ".json", ".npz", ".mat")
_LEVELS = 3
"""in which settings and calibration may lie: trial, participant, session"""
_POSE = ("pose", "pose2d")
_SYNCHRONISED = "posesync"
_ASSOCIATED = ("poseassociated", "pose2dtracked")
_IMAGES = ("videos", "video", "raw2d")
_LAYOUTS = {
    "body25": "body_25",
    "body25b": "body_25b",
    "coco": "coco18",
    "coco17": "coco17",
    "body": "coco17",
    "halpe26": "halpe26",
    "bodywithfeet": "halpe26",
    "coco133": "coco133",
    "wholebody": "coco133",
    "blazepose": "mediapipe33",
}


@dataclass(frozen=True)
class Pose2SimProject:
    """What is in a project's folder, by camera."""

    calibration: Path
    videos: Mapping[str, Path]
    images: Mapping[str, str]
    """patterns"""
    keypoints: Mapping[str, Path]
    fps: float | None
    layout: str | None
    """as Config.toml says what detected"""
    lag_frames: Mapping[str, int] = field(default_factory=dict)
    """by how many frames a camera is late, where Pose2Sim synchronised"""
    notes: tuple[str, ...] = ()


def is_pose2sim(folder: Path) -> bool:
    """Return whether a folder has 2D joints of cameras as Pose2Sim lays them out."""
    return folder.is_dir() and any(_joint_folders(pose) for pose in _folders(folder, *_POSE))


def read_pose2sim(folder: Path, calibration: Path | None) -> Pose2SimProject:
    """Return what a trial's folder holds. calibration: if the user named it. Raises HandtrackError for what lacks or is open."""
    if not folder.is_dir():
        raise HandtrackError(
            f"--project {folder}: no such folder; expected a Pose2Sim project or trial."
        )
    pose = next(_folders(folder, *_POSE), None)
    joints = {} if pose is None else _joint_folders(pose)
    if not joints:
        trials = sorted(
            str(p.relative_to(folder)) for p in folder.glob("**/") if p != folder and is_pose2sim(p)
        )[:8]
        text = f"--project {folder}: no 2D joints; expected a folder `pose` with a folder of JSON files a camera, such as pose/cam01_json."
        if trials:
            text += f" It holds trials: name one of them, such as --project {folder / trials[0]} ({', '.join(trials)})."
        raise HandtrackError(text)
    config = _config(folder)
    notes: list[str] = []
    found = _calibration(folder, notes) if calibration is None else calibration
    given = read_calibration([found])
    own = _by_order(given, list(joints), found, notes)
    lags = _lags(folder, joints, notes)
    videos, images = _recordings(folder, joints, notes)
    rate = config.get("project", {}).get("frame_rate")
    said = re.sub("[^a-z0-9]", "", str(config.get("pose", {}).get("pose_model", "")).lower())
    if (excluded := next(_folders(folder, *_ASSOCIATED), None)) is not None:
        notes.append(
            f"{excluded.name} is not used: people are identified from {pose.name if pose else 'pose'} (--person)."
        )
    return Pose2SimProject(
        found,
        {own[camera]: path for camera, path in videos.items()},
        {own[camera]: pattern for camera, pattern in images.items()},
        {own[camera]: path for camera, path in joints.items()},
        float(rate) if isinstance(rate, int | float) else None,
        _LAYOUTS.get(said),
        {own[camera]: lag for camera, lag in lags.items()},
        tuple(notes),
    )


def _folders(folder: Path, *names: str) -> Iterator[Path]:
    """Yield the folders in a folder that have one of some names, whatever their case and signs."""
    for path in sorted(folder.iterdir()):
        if path.is_dir() and re.sub("[^a-z0-9]", "", path.name.lower()) in names:
            yield path


def _joint_folders(pose: Path) -> dict[str, Path]:
    """Return folders of JSON files by camera: `cam01_json` is cam01's."""
    folders = sorted(path for path in pose.iterdir() if path.is_dir() and any(path.glob("*.json")))
    return {re.sub(r"[_-]json$", "", path.name, flags=re.IGNORECASE): path for path in folders}


def _config(folder: Path) -> dict[str, dict[str, object]]:
    """Return the tables of Config.toml, the outer levels' where the inner say nothing."""
    tables: dict[str, dict[str, object]] = {}
    for level in reversed([folder.resolve(), *folder.resolve().parents][:_LEVELS]):
        path = level / "Config.toml"
        read = read_toml(path, "a project's settings") if path.is_file() else {}
        for name, table in read.items():
            if isinstance(table, dict):
                tables.setdefault(name, {}).update(table)
    return tables


def _calibration(folder: Path, notes: list[str]) -> Path:
    """Return the calibration's file: the nearest, TOML before others as Pose2Sim does it."""
    for level in [folder, *folder.resolve().parents][:_LEVELS]:
        places = [p for p in sorted(level.iterdir()) if p.is_dir() and "calib" in p.name.lower()]
        for place in (*places, level):
            files = [p for p in sorted(place.iterdir()) if p.is_file()]
            known = [p for p in files if p.name != "Config.toml" and _is_calibration(p)]
            known.sort(key=lambda p: p.suffix.lower() != ".toml")
            if len(known) > 1 and known[1].suffix.lower() == ".toml":
                raise HandtrackError(
                    f"--project {folder}: several calibrations in {place}: {', '.join(p.name for p in known)}. Say which with "
                    "--calibration."
                )
            if known:
                others = ", ".join(p.name for p in known[1:])
                beside = f"; {others} beside it is not" if others else ""
                notes.append(f"the calibration is {known[0]}{beside}.")
                return known[0]
    raise HandtrackError(
        f"--project {folder}: no calibration in it, in a folder `calibration` there, or in the two levels above. Give its file with "
        "--calibration."
    )


def _is_calibration(path: Path) -> bool:
    try:
        return path.suffix.lower() in _CALIBRATIONS and bool(read_calibration([path]).cameras)
    except HandtrackError:
        return False


def _by_order(
    given: ImportedRig, cameras: list[str], where: Path, notes: list[str]
) -> dict[str, str]:
    """Return the calibration's names of cameras whose names are others, in order, as Pose2Sim takes them."""
    names = [camera.name for camera in named(given, cameras, str(where))[0].cameras]
    if set(cameras) <= set(names):
        return dict(zip(cameras, cameras))
    if len(names) != len(cameras) or None in names:
        raise HandtrackError(
            f"{where}: cameras {', '.join(map(str, names))}, but joints of {', '.join(cameras)}; expected the same names, or as many."
        )
    pairs = {camera: str(name) for camera, name in zip(cameras, names, strict=True)}
    told = ", ".join(f"{camera} is '{name}'" for camera, name in pairs.items())
    notes.append(
        f"cameras have other names in the calibration, and are taken in order, as Pose2Sim does: {told}."
    )
    return pairs


def _recordings(
    folder: Path, joints: Mapping[str, Path], notes: list[str]
) -> tuple[dict[str, Path], dict[str, str]]:
    """Return videos, and patterns of image files, of the cameras that have joints."""
    videos, images = dict[str, Path](), dict[str, str]()
    place = next(_folders(folder, *_IMAGES), None)
    for path in () if place is None else sorted(place.iterdir()):
        camera = next(
            (c for c in sorted(joints, key=len, reverse=True) if c.lower() in path.stem.lower()),
            None,
        )
        if camera is None:
            continue
        if path.is_file() and path.suffix.lower() in _VIDEOS:
            videos.setdefault(camera, path)
        elif path.is_dir() and (
            kinds := {p.suffix for p in path.iterdir() if p.suffix.lower() in IMAGE_SUFFIXES}
        ):
            images.setdefault(camera, str(path / f"*{sorted(kinds)[0]}"))
    without = [camera for camera in joints if camera not in videos and camera not in images]
    if without:
        notes.append(f"no video of {', '.join(without)}: joints alone.")
    return videos, images


def _lags(folder: Path, joints: Mapping[str, Path], notes: list[str]) -> dict[str, int]:
    """Return by how many frames a camera is late: its file of a frame in `pose-sync` is a later one's in `pose`."""
    place = next(_folders(folder, _SYNCHRONISED), None)
    lags = dict[str, int]()
    for camera, synchronised in ({} if place is None else _joint_folders(place)).items():
        if camera in joints:
            lag = _shift(joints[camera], synchronised)
            if lag is None:
                raise HandtrackError(
                    f"--project {folder}: {synchronised} holds other joints than {joints[camera]}, so the camera's time offset cannot be determined. Remove one of the two folders, or give --calibration, --video and --keypoints yourself."
                )
            if lag:
                lags[camera] = lag
    if lags:
        told = ", ".join(f"{camera} by {lag}" for camera, lag in lags.items())
        notes.append(
            f"synchronised as in {place.name if place else ''}: time offsets in frames (positive: late): {told}."
        )
    return lags


def _shift(before: Path, after: Path) -> int | None:
    """Return how much later, in frames, files stand in `before` than in `after`; None where they are not the same."""
    first, second = (files_by_frame(folder.glob("*.json")) for folder in (before, after))
    by_content: dict[bytes, list[int]] = {}
    for frame, path in first.items():
        by_content.setdefault(path.read_bytes(), []).append(frame)
    for frame, path in second.items():
        same = by_content.get(path.read_bytes(), [])
        if len(same) == 1:  # others are of frames in which nobody is
            return same[0] - frame
    return None
