"""`handtrack new`: a session folder from videos and a calibration."""

from __future__ import annotations

import argparse
import shutil
from collections.abc import Mapping
from pathlib import Path

from handtrack.capture.calibration.rig_file import read_rig
from handtrack.capture.images.video import VideoFile
from handtrack.capture.masks.segmentation import METHODS, MaskMethod
from handtrack.errors import HandtrackError
from handtrack.files.toml_table import read_table
from handtrack.geometry.camera import CameraRig, scaled_by
from handtrack.session.layout import CALIBRATION_FILE, SESSION_FILE
from handtrack.session.session import Session
from handtrack.session.session_file import (
    CameraSettings,
    HandSettings,
    RecordingSettings,
    SessionFile,
    write_session_file,
)
from handtrack_app.commands.terminal.output import check_new, new_folder
from handtrack_app.commands.terminal.progress import say

_RATE_TOLERANCE = 0.01


def run(args: argparse.Namespace) -> int:
    """Make the folder; whatever is wrong is found before anything is written."""
    if not args.world_unit_m > 0:
        raise HandtrackError(f"--world-unit-m {args.world_unit_m:g}: expected metres above 0.")
    videos = parse_videos(args.video)
    check_new(args.out)
    rig = read_rig(args.calibration, args.world_unit_m)
    opened = _opened(videos, rig, args.calibration, args.scaled)
    fps, own = _frame_rates(args.fps, {name: video.nominal_fps for name, video in opened.items()})
    scaled = {name: video.size for name, video in opened.items() if video.size != rig[name].size}
    files = {camera: _file_name(i, camera, path) for i, (camera, path) in enumerate(videos.items())}
    masks = mask_method(args.masks)
    cameras = tuple(
        CameraSettings(name, file, masks, scaled.get(name), fps=own.get(name))
        for name, file in files.items()
    )
    recording = RecordingSettings(
        args.name or args.out.resolve().name, fps, None, args.world_unit_m
    )
    hand = HandSettings(side=args.side, scale="fit")
    with new_folder(args.out) as folder:
        shutil.copyfile(args.calibration, folder / CALIBRATION_FILE)
        for camera, path in videos.items():
            say(f"copying {path} …")
            shutil.copyfile(path, folder / files[camera])
        write_session_file(folder / SESSION_FILE, SessionFile(recording, hand, cameras))
        count = Session.open(folder).frame_count
    print(
        f"session of {len(videos)} cameras and {count} frames in {args.out}. Look at it with: handtrack doctor "
        f"{args.out}; then pose the hand in its first frame with: handtrack open {args.out}"
    )
    return 0


def parse_videos(pairs: list[str]) -> dict[str, Path]:
    """Return videos by camera from `CAMERA=FILE` texts."""
    videos: dict[str, Path] = {}
    for pair in pairs:
        camera, equals, file = pair.partition("=")
        if not (equals and camera and file):
            raise HandtrackError(
                f"--video {pair}: expected CAMERA=FILE, as in --video cam0=left.mp4, with the camera's name "
                "in the calibration."
            )
        if camera in videos:
            raise HandtrackError(f"--video {pair}: a second video of the camera '{camera}'.")
        other = next(
            (name for name, path in videos.items() if path.resolve() == Path(file).resolve()), None
        )
        if other is not None:
            raise HandtrackError(
                f"--video {pair}: that is the video of the camera '{other}' already; expected another one."
            )
        videos[camera] = Path(file)
    return videos


def mask_method(name: str) -> MaskMethod | None:
    """Return a mask method with its usual settings; None for `none`."""
    return None if name == "none" else read_table(METHODS[name], {}, f"--masks {name}")


def _opened(
    videos: Mapping[str, Path], rig: CameraRig, calibration: Path, scaled: bool
) -> dict[str, VideoFile]:
    """Return the videos, closed again. Raises HandtrackError for one that is no camera's, or not of its size.

    scaled: whether it may be of that size scaled.
    """
    opened = {}
    for camera, path in videos.items():
        if camera not in rig:
            raise HandtrackError(
                f"--video {camera}={path}: {calibration} has no camera '{camera}'; cameras there: "
                f"{', '.join(rig.names)}."
            )
        size, where = rig[camera].size, f"--video {camera}={path}"
        video = VideoFile(path, None if scaled else size, where)
        if video.size != size and (video.size is None or scaled_by(size, video.size) is None):
            VideoFile(path, size, where)  # says what is wrong with it
        video.close()
        opened[camera] = video
    return opened


def _frame_rates(asked: float | None, rates: Mapping[str, float]) -> tuple[float, dict[str, float]]:
    """Return the session's frames a second, and those of cameras that differ."""
    if asked is not None:
        if not 0 < asked < float("inf"):
            raise HandtrackError(f"--fps {asked:g}: expected frames a second, above 0.")
        return asked, {}
    known = [rate for rate in rates.values() if rate > 0]
    if not known:
        raise HandtrackError("no video says how many frames a second it has; give it with --fps.")
    fps = known[0]
    own = {
        name: rate
        for name, rate in rates.items()
        if rate > 0 and abs(rate / fps - 1) > _RATE_TOLERANCE
    }
    for name, rate in own.items():
        say(
            f"note: the video of camera '{name}' says {rate:g} frames a second, the first {fps:g}: its frames will be taken "
            "by time. If all have one rate, begin anew with --fps."
        )
    return fps, own


def _file_name(index: int, camera: str, path: Path) -> str:
    plain = camera.isascii() and camera.replace("_", "").replace("-", "").isalnum()
    return f"{camera if plain else f'video{index}'}{path.suffix.lower()}"
