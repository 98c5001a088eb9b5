"""What `handtrack new` is given of each camera: a video or image files, depth files, joints; looked at before anything is written."""

from __future__ import annotations

import glob
import os
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from handtrack.capture.calibration.formats.settle import LensView
from handtrack.capture.images.frames import COLOUR, DEPTH, IMAGE_SUFFIXES, ImageFiles
from handtrack.capture.images.video import VideoFile
from handtrack.errors import HandtrackError
from handtrack.geometry.camera import Camera, CameraRig, scaled_by
from handtrack.session.layout import is_pattern
from handtrack_app.commands.terminal.progress import say

_BLOCK_PX = 16
_IMAGES, _VIDEO, _DEPTH = "--images", "--video", "--depth"


@dataclass(frozen=True)
class Given:
    """One option of one camera: a file, or the files of a pattern."""

    option: str
    camera: str
    text: str
    files: tuple[Path, ...]
    size: tuple[int, int] | None
    """width, height [px] of its images."""
    fps: float = 0.0
    """what a video says; 0 where nothing does."""

    @property
    def where(self) -> str:
        return f"{self.option} {self.camera}={self.text}"


@dataclass(frozen=True)
class Recorded:
    """All that is given of one camera."""

    camera: str
    images: Given | None = None
    depth: Given | None = None
    keypoints: str | None = None
    taken_by: str | None = None
    """the camera whose images it is a view of; None: its own"""
    view_size: tuple[int, int] | None = None
    """width, height [px] of that view"""

    @property
    def given_as(self) -> str:
        """The camera's name in the options."""
        return self.taken_by or self.camera

    @property
    def size(self) -> tuple[int, int] | None:
        """Width, height [px] of what is tracked: of what was taken, or of a pinhole view of it."""
        if self.view_size is not None:
            return self.view_size
        return next((given.size for given in (self.images, self.depth) if given is not None), None)


def recorded_cameras(
    videos: Sequence[str], images: Sequence[str], depth: Sequence[str], keypoints: Sequence[str]
) -> dict[str, Recorded]:
    """Return what is given by camera, in the order of the options. Raises HandtrackError.

    Each is a list of `CAMERA=FILE` or `CAMERA=PATTERN`.
    """
    cameras: dict[str, Recorded] = {}
    for given in [*_each(_VIDEO, videos), *_each(_IMAGES, images)]:
        if given.camera in cameras:
            raise HandtrackError(f"{given.where}: a second video of the camera '{given.camera}'.")
        _check_new(given, [r.images for r in cameras.values()])
        cameras[given.camera] = Recorded(given.camera, _opened(given))
    for given in _each(_DEPTH, depth):
        seen = cameras.get(given.camera, Recorded(given.camera))
        if seen.depth is not None:
            raise HandtrackError(
                f"{given.where}: depth of the camera '{given.camera}' is given twice."
            )
        cameras[given.camera] = replace(seen, depth=_opened(given))
    for pair in keypoints:
        camera, file = camera_and_file("--keypoints", pair, "joints.json")
        seen = cameras.get(camera, Recorded(camera))
        if seen.keypoints is not None:
            raise HandtrackError(
                f"--keypoints {pair}: joints of the camera '{camera}' are given twice."
            )
        cameras[camera] = replace(seen, keypoints=file)
    if not cameras:
        raise HandtrackError(
            "nothing was recorded: give each camera's images with --video CAMERA=FILE or --images CAMERA='folder/*.png', its "
            "--depth or its --keypoints."
        )
    return cameras


def in_views(
    recorded: Mapping[str, Recorded], views: Mapping[str, LensView]
) -> dict[str, Recorded]:
    """Return what is given by camera with each bent lens's images once for each pinhole view of them. Raises HandtrackError
    for depth, which is measured along the axis of the lens and not of the view.
    """
    bent = {seen.camera for seen in views.values()}
    for name, cam in recorded.items():
        if name in bent and cam.depth is not None:
            raise HandtrackError(
                f"{cam.depth.where}: depth of a fisheye lens, or of one with skew, is not read. Give its point clouds "
                "instead."
            )
    lenses = {seen.camera: seen.lens for seen in views.values()}
    found = {}
    for name, cam in recorded.items():
        if name in lenses and cam.images is not None and cam.size not in (None, lenses[name].size):
            (w, h), (width, height) = cam.size or (0, 0), lenses[name].size
            raise HandtrackError(
                f"{cam.images.where}: images of {w} x {h}; its fisheye lens is calibrated for {width} x {height}. Calibrate it at "
                "the size that it records."
            )
        tiles = [tile for tile, seen in views.items() if seen.camera == name]
        for tile in tiles or [name]:
            size = views[tile].view.size if tiles else None
            found[tile] = replace(cam, camera=tile, taken_by=cam.camera, view_size=size)
    return found


def camera_and_file(option: str, pair: str, example: str) -> tuple[str, str]:
    """Return both sides of `CAMERA=FILE`. Raises HandtrackError."""
    camera, equals, file = pair.partition("=")
    if not (equals and camera and file):
        raise HandtrackError(
            f"{option} {pair}: expected CAMERA=FILE, as in {option} cam0={example}, with the camera's name in the calibration."
        )
    return camera, file


def _each(option: str, pairs: Sequence[str]) -> list[Given]:
    example = "left.mp4" if option == _VIDEO else "'left/*.png'"
    found = []
    for pair in pairs:
        camera, text = camera_and_file(option, pair, example)
        found.append(Given(option, camera, text, (), None))
    return found


def _check_new(given: Given, others: Sequence[Given | None]) -> None:
    for other in others:
        if other is not None and Path(other.text).resolve() == Path(given.text).resolve():
            raise HandtrackError(
                f"{given.where}: that is the video of the camera '{other.camera}' already; expected another one."
            )


def _opened(given: Given) -> Given:
    """Return an option with its files and the size of its images; the files are closed again."""
    if given.option == _VIDEO:
        video = VideoFile(Path(given.text), None, given.where)
        video.close()
        return replace(given, files=(Path(given.text),), size=video.size, fps=video.nominal_fps)
    files = image_files(given.text, given.where)
    kind = DEPTH if given.option == _DEPTH else COLOUR
    return replace(given, files=files, size=ImageFiles(list(files), kind, None, given.where).size)


def image_files(text: str, where: str) -> tuple[Path, ...]:
    """Return the image files of a pattern, or of a folder. Raises HandtrackError where there are none."""
    pattern = os.path.join(glob.escape(text), "*") if os.path.isdir(text) else text
    paths = [Path(name) for name in sorted(glob.glob(pattern))]
    files = tuple(p for p in paths if p.is_file() and p.suffix.lower() in IMAGE_SUFFIXES)
    if not files:
        there = f"{len(paths)} other files match" if paths else "nothing matches"
        raise HandtrackError(
            f"{where}: {there}; expected numbered images ({', '.join(IMAGE_SUFFIXES)}), such as 'left/*.png'. Quote the pattern."
        )
    if len({path.parent for path in files}) > 1 or len({path.suffix for path in files}) > 1:
        raise HandtrackError(
            f"{where}: files of several folders or kinds; expected those of one, such as 'left/*.png'."
        )
    return files


def check_sizes(recorded: Recorded, camera: Camera, scaled: bool) -> None:
    """Raise HandtrackError where images are not of the calibration's size. scaled: whether they may be it, scaled."""
    for given in (recorded.images, recorded.depth):
        if given is None or given.size in (None, camera.size) or recorded.view_size is not None:
            continue
        if scaled and scaled_by(camera.size, given.size) is not None:
            continue
        if given.option == _VIDEO:
            VideoFile(given.files[0], camera.size, given.where)  # says what is wrong with it
        kind = DEPTH if given.option == _DEPTH else COLOUR
        source = ImageFiles(list(given.files), kind, camera.size, given.where)
        source.size  # noqa: B018  says what is wrong with it


def without_padding(
    rig: CameraRig, recorded: Mapping[str, Recorded]
) -> tuple[CameraRig, list[str]]:
    """Return the rig with the sizes of images that differ from the calibration's by a codec's padding alone; and what was
    assumed, in sentences.

    Video is coded in blocks of 16 pixels (ITU-T H.264, 7.3.2.1.1), filled up at the right and below: what one program shows as
    1080 columns another one gives as 1088. The matrix is the same for both.
    """
    cameras, notes = [], list[str]()
    for camera in rig:
        size = recorded[camera.name].size if camera.name in recorded else None
        if size is not None and size != camera.size and _differs_by_padding(size, camera.size):
            notes.append(
                f"camera '{camera.name}': images of {size[0]} × {size[1]}, calibrated for {camera.size[0]} × {camera.size[1]}: the "
                "difference is taken to be a codec's padding at the right and below."
            )
            camera = replace(camera, size=size)
        cameras.append(camera)
    return CameraRig(tuple(cameras)), notes


def _differs_by_padding(size: tuple[int, int], calibrated: tuple[int, int]) -> bool:
    pairs = [sorted(pair) for pair in zip(size, calibrated, strict=True)]
    return all(more in (less, -(-less // _BLOCK_PX) * _BLOCK_PX) for less, more in pairs)


def settings_of(given: Given, folder: str) -> tuple[str, Mapping[str, Path]]:
    """Return what session.toml says of files that are copied, and the files by their new names.

    folder: below the session's, for several.
    """
    if given.option == _VIDEO:
        (path,) = given.files
        name = f"{folder}{path.suffix.lower()}"
        return name, {name: path}
    suffix = given.files[0].suffix
    names = {f"{folder}/{path.name}": path for path in given.files}
    return f"{folder}/*{suffix}", names


def linked_setting(given: Given) -> tuple[str, Path]:
    """Return what session.toml says of files that stay where they are, an absolute path or pattern, and their folder.

    Raises HandtrackError for a path that reads as a pattern, which only copies may have.
    """
    first = given.files[0].resolve()
    if is_pattern(str(first)):
        raise HandtrackError(
            f"{given.where}: a path with *, ? or [ cannot be linked. Rename it, or leave --link away."
        )
    name = first.name if given.option == _VIDEO else f"*{given.files[0].suffix}"
    return (first.parent / name).as_posix(), first.parent


def copied(files: Mapping[str, Path], folder: Path) -> None:
    """Copy files into a session, saying so."""
    said = set[Path]()
    for name, path in files.items():
        target = folder / name
        if target.parent not in said or target.parent == folder:
            say(f"copying {path if target.parent == folder else path.parent} …")
            said.add(target.parent)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, target)
