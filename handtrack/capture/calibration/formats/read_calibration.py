"""Anybody's calibration: the table of the forms that are read, tried by content; and what it leaves open, settled by the recording that it is
for: names, image sizes, the unit.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any, Literal, NamedTuple
from xml.etree import ElementTree

import numpy as np

from handtrack.arrays import D3, C, Floats, K, evenly_spread
from handtrack.capture.calibration.formats.imported_rig import (
    MEANS,
    ImportedCamera,
    ImportedRig,
    five_or_more,
    plain_word,
    read_tables,
    with_names,
)
from handtrack.capture.calibration.formats.programs import (
    colmap_folder,
    read_bouguet,
    read_colmap,
    read_kalibr,
    read_matlab,
    read_nerf,
    read_qualisys,
    read_splatting,
)
from handtrack.capture.images.openpose import Layout
from handtrack.errors import HandtrackError
from handtrack.files.mat_files import read_mat
from handtrack.files.npz_files import read_arrays
from handtrack.files.text_files import (
    MOST_BYTES,
    check_file,
    first_bytes,
    read_json,
    read_text,
    read_xml,
)
from handtrack.files.toml_table import read_toml
from handtrack.files.yaml_text import parse_yaml
from handtrack.geometry.camera import Camera, CameraRig
from handtrack.geometry.source_lens import FISHEYE_COUNT, SourceLens, pinhole_views
from handtrack.geometry.triangulation import triangulated

_WHAT = "a calibration"
_TOML = re.compile(r"\[+\s*[\w.\"'-]+\s*\]+\s*(#.*)?$|[\w.\"'-]+\s*=")
_YAML = re.compile(r"""(- |[\w."'/ -]+:(\s|$)|\{)""")
_ROWS = re.compile(r"(?:#.*\r?\n)*[A-Za-z]+:[ \t]*\r?\n[ \t]*[-+.\d]+[eE\d.+-]*[ \t]+[-+.\d]")
_STORAGE = "opencv_storage"

ACCEPTED = (
    "TOML of Anipose, Pose2Sim, FreeMoCap and Caliscope; OpenCV's YAML, XML and JSON (a stereo pair, or a file a camera); "
    "Kalibr's camchain YAML; a COLMAP model (folder, text or binary); MATLAB's stereoParameters (.mat or JSON) "
    "and Bouguet's Calib_Results_stereo.mat; Qualisys XML; handpose3d's c0.dat with rot_trans_c0.dat; cameras.json of Gaussian "
    "splatting; NeRF's transforms.json; a pair of ROS camera_info; EasyMocap's intri.yml with extri.yml; JSON, YAML or NPZ with K, dist, R and t of each camera"
)
CONVERT = (
    'To convert another one, write JSON: {"cam0": {"K": 3x3, "dist": [k1, k2, p1, p2, k3], "R": 3x3, "t": [x, y, z], "size": '
    "[w, h]}, …}, with p_camera = R p_world + t."
)


_Read = Callable[[Any, str], ImportedRig | None]
FORMS: tuple[tuple[tuple[str, ...], _Read], ...] = (
    (("yaml",), read_kalibr),
    (("mat", "json"), read_matlab),
    (("mat",), read_bouguet),
    (("json",), read_splatting),
    (("json",), read_nerf),
    (("xml",), read_qualisys),
)
"""what a file may be written in, and which program's it may be; the first that knows it reads it, else it is read as tables"""


def read_calibration(paths: Sequence[Path]) -> ImportedRig:
    """Return the cameras of one file or folder, or of several files: one a camera, or parts of one.

    Raises HandtrackError; for what is of no known form, with all that are, and how to convert.
    """
    if len(paths) == 1:
        return _one(paths[0])
    contents = {path: _by_camera(path) for path in paths}
    single = [_single(path, content) for path, content in contents.items()]
    cameras = tuple(camera for camera in single if camera is not None)
    if len(cameras) == len(paths):
        return ImportedRig("one file per camera", _posed(cameras, paths))
    where = " and ".join(map(str, paths))
    rig = read_tables([*contents.values()], where, paths[0].stem)
    if rig is None or len(rig.cameras) < 2:
        raise _refusal([*contents.values()], where)
    return rig


def _by_camera(path: Path) -> Mapping[str, Any]:
    """Return the tables of a file; of rows with the camera in their keys: handpose3d's c0.dat and rot_trans_c0.dat are of `c0`."""
    form, content = _content(path)
    if not isinstance(content, Mapping):
        raise _refusal([], path)
    camera = re.search(r"[A-Za-z]+\d+$", path.stem)
    if form != "rows" or camera is None:
        return content
    return {f"{key}_{camera[0]}": rows for key, rows in content.items()}


def _one(path: Path) -> ImportedRig:
    folder = colmap_folder(path)
    if folder is not None:
        return read_colmap(folder)
    if path.is_dir():
        rows = sorted(path.glob("*.dat"))
        if rows:
            return read_calibration(rows)
        raise HandtrackError(
            f"{path} is a folder without a COLMAP model; expected a calibration. Accepted: {ACCEPTED}."
        )
    form, content = _content(path)
    readers = [read for forms, read in FORMS if form in forms]
    rig = next((rig for read in readers if (rig := read(content, str(path)))), None)
    if rig is None and isinstance(content, Mapping | list):
        rig = read_tables([content], str(path), path.stem)
    if rig is None:
        raise _refusal([content], path)
    names = [camera.name for camera in rig.cameras if camera.name is not None]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise HandtrackError(f"{path}: two cameras have the name '{twice}'; expected one each.")
    return rig


def _single(path: Path, content: Mapping[str, Any]) -> ImportedCamera | None:
    """Return the camera of a file that has one alone, named by the file where it does not say a name."""
    try:
        rig = read_tables([content], str(path), path.stem)
    except HandtrackError:
        return None
    return rig.cameras[0] if rig is not None and len(rig.cameras) == 1 else None


def _posed(
    cameras: tuple[ImportedCamera, ...], paths: Sequence[Path]
) -> tuple[ImportedCamera, ...]:
    at_origin = [c for c in cameras if not c.translation.any() and (c.rotation == np.eye(3)).all()]
    if len(at_origin) > 1:
        raise HandtrackError(
            f"{paths[0]}: {len(at_origin)} of {len(cameras)} cameras have no pose (R and t, world to camera), so where they stand "
            "is not known. Add it to each file, or give the stereo calibration (R, T) as well."
        )
    names = [camera.name for camera in cameras]
    if len(set(names)) < len(names):  # all say the same, such as "camera"
        cameras = tuple(replace(c, name=path.stem) for c, path in zip(cameras, paths, strict=True))
    return cameras


def _refusal(contents: list[Any], where: str | Path) -> HandtrackError:
    """Return what to say of files that no camera was found in: lenses or poses alone, other tables, or anything else."""
    files = [content for content in contents if isinstance(content, Mapping)]
    tables = [table for file in files for table in (file, *file.values())]
    keys = [str(key) for table in tables if isinstance(table, Mapping) for key in table]
    said = {MEANS.get(re.sub(r"[\W_\d]|left|right", "", key.lower())) for key in keys}
    lenses = said & {"matrix", "distortions"}
    poses = said & {"rotation", "translation", "pose"}
    if bool(lenses) != bool(poses):
        here, missing = (
            ("the poses", "the lenses (K, dist)") if poses else ("the lenses", "the poses (R, t)")
        )
        return HandtrackError(
            f"{where}: only {here} of a calibration ({', '.join(keys[:6])}); {missing} are missing. Give both files: "
            "--calibration INTRINSICS EXTRINSICS."
        )
    if keys:
        return HandtrackError(
            f"{where}: neither a camera matrix nor a pose under a name that is known; its keys: {', '.join(keys[:8])}. {CONVERT}"
        )
    return HandtrackError(
        f"{where}: no calibration that is known here. Accepted: {ACCEPTED}. {CONVERT}"
    )


# ---- What a file holds, as nested tables, whatever it was written in: chosen by its first bytes, never by its name


def _content(path: Path) -> tuple[str, Any]:
    """Return a file's form (toml, yaml, json, xml, npz, mat or rows) and what it holds: nested dict and list, of other XML than
    OpenCV's the root element; nothing where it is of no known form. Raises HandtrackError for what cannot be read.
    """
    check_file(path, _WHAT)
    start = first_bytes(path)
    if start[:4] == b"PK\3\4":
        arrays = read_arrays(path).items()  # without pickles
        return "npz", {
            k: a if a.ndim and a.dtype.kind not in "US" else a.tolist() for k, a in arrays
        }
    if start[:6] == b"MATLAB":
        return "mat", read_mat(path)
    if start[:1] == b"\x80" and start[1:2] in b"\2\3\4\5":
        raise HandtrackError(
            f"{path} is a Python pickle, which may run any program when it is read, so it is not. Where you trust it, write it "
            "as JSON: for each camera K, dist, R, t and size, as lists (OpenCap's: intrinsicMat, distortion, rotation, "
            "translation in mm, imageSize as height, width)."
        )
    if b"\0" in start:
        return "", None
    text = start.decode("utf-8-sig", errors="replace").lstrip()
    if text.startswith("<"):
        root = read_xml(path, _WHAT)
        return "xml", _storage(root, 0, path) if root.tag == _STORAGE else root
    if text.startswith("{") or re.match(r"\[\s*\{", text):
        return "json", read_json(path, _WHAT)
    if text.startswith(("%YAML", "---")):
        return _yaml(path)
    first = next(
        (line for line in text.splitlines() if line.strip() and line.strip()[0] != "#"), ""
    )
    if _TOML.match(first.strip()):
        return "toml", read_toml(path, _WHAT)
    if _ROWS.match(text):
        return "rows", _rows(path)
    return _yaml(path) if _YAML.match(first.strip()) else ("", None)


def _rows(path: Path) -> dict[str, list[list[float]]]:
    """Return what stands below each `word:`, rows of numbers, as handpose3d writes a camera's lens and its pose."""
    found: dict[str, list[list[float]]] = {}
    key = ""
    for line in read_text(path, _WHAT).splitlines():
        if line.strip().endswith(":"):
            key = line.strip()[:-1]
            found[key] = []
        elif key and line.strip() and line.strip()[0] != "#":
            try:
                found[key].append([float(word) for word in line.split(None, MOST_BYTES)])
            except ValueError:
                raise HandtrackError(f"{path}: '{line[:60]}'; expected a row of numbers.") from None
    return found


def _yaml(path: Path) -> tuple[str, Any]:
    try:
        return "yaml", parse_yaml(read_text(path, _WHAT))
    except ValueError as error:
        raise HandtrackError(f"{path}: not readable YAML: {error}.") from None


def _storage(element: ElementTree.Element, depth: int, path: Path) -> Any:
    """Return what OpenCV wrote: elements named `_` are a list, a text of numbers is one or several."""
    if depth > 40:
        raise HandtrackError(f"{path}: nested more than 40 times; no calibration is.")
    children = list(element)
    if children and all(child.tag == "_" for child in children):
        return [_storage(child, depth + 1, path) for child in children]
    if children:
        return {child.tag: _storage(child, depth + 1, path) for child in children}
    text = (element.text or "").strip()
    if text[:1] == '"':
        return text.strip('"')
    words = text.split(None, MOST_BYTES)
    try:
        values = [int(w) if re.fullmatch(r"[-+]?\d{1,15}", w) else float(w) for w in words]
    except ValueError:
        return text
    return values[0] if len(values) == 1 and element.tag != "data" else values


# ---- How large what is tracked is, a hand or a body: what a calibration's unit can be told by


_MOST = 60  # frames that are asked
_LEAST_ANGLE = 0.045  # [rad] between rays


@dataclass(frozen=True)
class Subject:
    """What is tracked, in sizes of people."""

    word: str
    size_m: float
    """of an adult, as it fills the image"""
    chains: tuple[tuple[str, ...], ...]
    """joints along which its length is measured"""
    usual_m: float
    """of that length, an adult's"""
    range_m: tuple[float, float]
    """of that length, a small child's to a large man's; less than a factor of ten, so that one unit fits at most"""

    @property
    def range_words(self) -> str:
        """The same in words."""
        low, high = (100 * length for length in self.range_m)
        return f"{low:.0f} to {high:.0f} cm" + (
            ", ankle to shoulder" if self.word == "body" else ""
        )

    def fits(self, length_m: float) -> bool:
        """Return whether somebody may be so long."""
        return self.range_m[0] <= length_m <= self.range_m[1]


HAND = Subject(
    "hand",
    0.18,
    (("wrist", "middle_mcp", "middle_pip", "middle_dip", "middle_tip"),),
    0.18,
    (0.06, 0.25),
)
# from ankle to shoulder along the bones is 0.78 of stature in body34 (de Leva 1996); statures of 0.75 to 2.2 m
BODY = Subject(
    "body",
    1.75,
    tuple((f"{s}_ankle", f"{s}_knee", f"{s}_hip", f"{s}_shoulder") for s in ("left", "right")),
    1.36,
    (0.58, 1.72),
)


def subject_length(
    rig: CameraRig,
    joints: Mapping[str, Mapping[int, Floats[K, D3]]],
    layouts: Mapping[str, Layout],
    subject: Subject,
) -> float | None:
    """Return its length along the bones, in the rig's unit, the median of some frames and of its
    chains.

    None where no frame has all of a chain in two cameras.

    Parameters
    ----------
    joints
        By camera and frame, [px] in the image as it was taken.
    layouts
        Of each camera's.
    """
    every = sorted({frame for frames in joints.values() for frame in frames})
    lengths = []
    for frame in (every[i] for i in evenly_spread(len(every), _MOST)):
        seen = {name: frames[frame] for name, frames in joints.items() if frame in frames}
        for chain in subject.chains:
            rows = {name: [layouts[name].points[joint] for joint in chain] for name in seen}
            pixels = np.array([points[rows[name], :2] for name, points in seen.items()])
            placed = triangulated([rig[name] for name in seen], pixels, _LEAST_ANGLE)
            if np.isfinite(placed).all():
                lengths.append(float(np.linalg.norm(np.diff(placed, axis=0), axis=1).sum()))
    return float(np.median(lengths)) if lengths else None


# ---- What it leaves open


_WITH_JOINTS = (1.0, 0.01, 0.001)  # of which at most one fits somebody's size
UNITS_M = {1.0: "metres", 0.001: "millimetres"}
"""those that calibrations are written in and that cannot be taken for one another; others must be said"""
_SHARE_OF_IMAGE = (
    0.05,
    1.5,
)  # of the image's smaller side: less is too small to track, more does not fit in
_SIDE_BY_SIDE = (
    1 / 18,
    10 / 3,
)  # between cameras that look one way, in sizes of what both see: 1 to 60 cm for hands
_MIDDLE = 0.05  # of the image: exchanged sides of 10:9 move its middle by as much
_APART = 0.01  # of the distance: cameras nearer to one another are at one place
_PARALLEL = 0.005  # least eigenvalue of Σ(1 − a aᵀ)/C: below, axes within some 6° meet nowhere


class Unit(NamedTuple):
    """Metres in one unit of a calibration, and how that is known."""

    unit_m: float | None
    """the best guess; None where there is none"""
    sure: bool
    why: str
    """a sentence for the user"""


def named(rig: ImportedRig, wished: Sequence[str], where: str) -> tuple[ImportedRig, str]:
    """Return the rig with its cameras named as the recording calls them, and what was assumed, in a sentence or none.

    A name that differs in spelling alone (`cam_0`, `Camera 0`, `0` for `cam0`) is taken. Cameras without names get those of
    the recording in order: by the numbers in them, where all have some. Raises HandtrackError where there are fewer cameras.
    """
    for name in wished:
        if any(_bare(name) == _bare(left) for left in rig.unposed):
            raise HandtrackError(
                f"{where}: it does not say where camera '{name}' stands (no pose), so its images cannot be used. Cameras with a "
                f"pose: {', '.join(str(c.name) for c in rig.cameras)}. Leave it out, or calibrate it with the others."
            )
    left = f"no pose, so left out: {', '.join(rig.unposed)}." if rig.unposed else ""
    if all(camera.name is not None for camera in rig.cameras):
        found, said = _respelled(rig, wished)
        return found, " ".join(text for text in (said, left) if text)
    if len(wished) > len(rig.cameras):
        raise HandtrackError(
            f"{where} has {len(rig.cameras)} cameras without names, but {len(wished)} are recorded: {', '.join(wished)}."
        )
    ordered = sorted(wished, key=_number) if all(_number(n) >= 0 for n in wished) else list(wished)
    default = [f"cam{i}" for i in range(len(rig.cameras))]
    if set(wished) <= set(default):
        return with_names(rig, default), ""
    if len(wished) < len(rig.cameras):
        raise HandtrackError(
            f"{where} has {len(rig.cameras)} cameras without names; recorded are {', '.join(wished)}. Name them "
            f"{', '.join(default)}, in the calibration's order."
        )
    return (
        with_names(rig, ordered),
        f"the calibration names no cameras: {', '.join(ordered)} are taken to be its cameras in this order.",
    )


def _respelled(rig: ImportedRig, wished: Sequence[str]) -> tuple[ImportedRig, str]:
    names = [str(camera.name) for camera in rig.cameras]
    found, said = dict[str, str](), list[str]()
    for name in wished:
        like = [n for n in names if _bare(n) == _bare(name)]
        if name not in names and len(like) == 1 and like[0] not in (*wished, *found):
            found[like[0]] = name
            said.append(f"'{name}' is the calibration's '{like[0]}'")
    changed = with_names(rig, [found.get(name, name) for name in names])
    return changed, f"{', '.join(said)}." if said else ""


def _bare(name: str) -> str:
    """Return a name without what people write before and between: `Camera_00` and `cam0` are both `0`."""
    plain = plain_word(name)
    digits = re.fullmatch(r"(?:camera|cam|port|view|c)?0*(\d+)", plain)
    return digits[1] if digits else plain


def _number(name: str) -> int:
    digits = re.search(r"(\d{1,9})\D*$", name)
    return int(digits[1]) if digits else -1


def sized(
    rig: ImportedRig, sizes: Mapping[str, tuple[int, int]], where: str
) -> tuple[ImportedRig, str]:
    """Return the rig with sizes [px] of the recording's images where the calibration says none, of cameras that have
    neither, those of the others; and what was assumed, in sentences or none.

    Some programs write height, width: then the lens's axis goes through the middle of an image of exchanged sides. Raises
    HandtrackError where nobody says a size.
    """
    known = [camera.size for camera in rig.cameras if camera.size] + list(sizes.values())
    if not known:
        raise HandtrackError(
            f"{where}: no image size, and no images that have one; add `size` = [w, h] to each camera."
        )
    cameras, notes = list[ImportedCamera](), list[str]()
    for camera in rig.cameras:
        size = camera.size or sizes.get(str(camera.name), known[0])
        off, turned = (
            np.abs(camera.matrix[:2, 2] / sides - 0.5).max() for sides in (size, size[::-1])
        )
        if turned <= off / 2 and off >= _MIDDLE:
            width, height = size
            axis = f"its lens's axis goes through ({camera.matrix[0, 2]:.0f}, {camera.matrix[1, 2]:.0f})"
            if sizes.get(str(camera.name)) == size:
                notes.append(
                    f"note: camera '{camera.name}': the images are {width} x {height}, but {axis}, the middle of {height} x "
                    f"{width}. Was the video turned after the calibration?"
                )
            else:
                size = height, width
                notes.append(
                    f"camera '{camera.name}': its size, {width} x {height}, is taken to be height x width: {axis}."
                )
        cameras.append(replace(camera, size=size))
    return replace(rig, cameras=tuple(cameras)), " ".join(notes)


def with_lens(rig: ImportedRig, lens: str | None, where: str) -> ImportedRig:
    """Return the rig with the lens model that the user says, `plain` or `fisheye`, where the file leaves it open.

    Raises HandtrackError where it is open and nobody says it, and for a fisheye's coefficients that are not four.
    """
    names = [f"camera '{c.name or i}'" for i, c in enumerate(rig.cameras) if c.fisheye is None]
    if names and lens is None:
        raise HandtrackError(
            f"{where}: four distortion coefficients of {', '.join(names)}, and the file does not say of which lens model. Of the "
            "standard model they are k1 k2 p1 p2; `cv2.fisheye` writes k1 k2 k3 k4 in the same place."
        )
    for camera in rig.cameras:
        if camera.fisheye and camera.distortions[FISHEYE_COUNT:].any():
            raise HandtrackError(
                f"{where}: camera '{camera.name}' is a fisheye of {len(camera.distortions)} coefficients; expected k1 k2 k3 k4 of "
                "cv2.fisheye."
            )
    said = lens == "fisheye"
    cameras = (replace(c, fisheye=said) if c.fisheye is None else c for c in rig.cameras)
    return replace(rig, cameras=tuple(cameras))


LensView = tuple[SourceLens, Camera]
"""a lens that is not a pinhole's, and a pinhole view of it in its frame, called as its camera"""


def pinholes(
    rig: ImportedRig, regions: Mapping[str, tuple[float, float, float, float]]
) -> tuple[ImportedRig, dict[str, LensView]]:
    """Return the rig with each fisheye, and each lens with skew, as the pinholes through which it
    is tracked, and these by name.

    A lens whose view is wider than 100° becomes several cameras, `NAME_1`, `NAME_2` …, of the same
    images. All must have names and sizes.

    Parameters
    ----------
    regions
        x, y, width, height [px] around what is tracked, where that is known; else all of an image
        is shown.
    """
    cameras: list[ImportedCamera] = []
    views: dict[str, LensView] = {}
    for camera in rig.cameras:
        name = str(camera.name)
        if not camera.needs_view:
            cameras.append(camera)
            continue
        assert camera.size is not None
        bent = five_or_more(camera.distortions)
        bent = bent[:FISHEYE_COUNT] if camera.fisheye else bent
        lens = SourceLens(camera.size, camera.matrix, bent, bool(camera.fisheye))
        tiles = pinhole_views(name, lens, regions.get(name))
        for i, view in enumerate(tiles):
            tile = name if len(tiles) == 1 else f"{name}_{i + 1}"
            views[tile] = lens, view
            turned, moved = (view.rotation @ part for part in (camera.rotation, camera.translation))
            cameras.append(ImportedCamera(tile, view.size, view.matrix, np.zeros(5), turned, moved))
    return replace(rig, cameras=tuple(cameras)), views


def unit_of(rig: ImportedRig, length: float | None = None, subject: Subject = HAND) -> Unit:
    """Return the unit of a calibration whose cameras have names and sizes.

    Parameters
    ----------
    length
        Of what is tracked, in that unit, where joints in images tell it.
    """
    if rig.unit_m is not None:
        return Unit(rig.unit_m, True, f"{rig.family}: its unit is {_words(rig.unit_m)}.")
    if len(rig.cameras) == 1:  # its own frame may be the world; no length shows
        return Unit(1.0, True, "")
    in_units = _pinhole_axes(rig)
    apart, depths = _spacing(in_units)
    likely = _likely_units(in_units, apart, depths, subject.size_m)
    guess = likely[0] if len(likely) == 1 else None
    what = "hands" if subject is HAND else "bodies"
    seen, none = (
        f"the cameras are {_range(apart, 'apart')}",
        f"for {what} is neither metres nor millimetres",
    )
    if depths is not None:
        seen += f", and look at a place {_range(depths.tolist(), 'away')}"
    if length is not None and (guess is None or rig.any_unit):
        likely = [unit for unit in _WITH_JOINTS if subject.fits(length * unit)]
        guess = likely[0] if likely else float(f"{subject.usual_m / length:.2g}")
        seen, none = (
            f"the joints make a {subject.word} {length:.3g} long",
            "is none in metres, centimetres or millimetres",
        )
    if doubt := doubted_poses(rig):
        return Unit(guess, False, f"{doubt} If they are right nevertheless, say the unit.")
    if rig.any_unit:
        return Unit(guess, False, f"a {rig.family} has no unit of length; in its unit, {seen}.")
    if len(likely) == 1:
        return Unit(guess, True, f"in its unit, {seen}: for {what} that is {_words(likely[0])}.")
    return Unit(guess, False, f"in its unit, {seen}, which {none}.")


_FLIP = np.diag([1.0, -1.0, -1.0])
_OTHER_POSES: Mapping[
    str, Callable[[Floats[D3, D3], Floats[D3]], tuple[Floats[D3, D3], Floats[D3]]]
] = {
    "were given from camera to world": lambda R, t: (R.T, -R.T @ t),
    "were of cameras that look along -z, with y up (OpenGL, Blender)": lambda R, t: (
        _FLIP @ R,
        _FLIP @ t,
    ),
    "were of such cameras, from camera to world": lambda R, t: (_FLIP @ R.T, -_FLIP @ R.T @ t),
}


def doubted_poses(rig: ImportedRig) -> str:
    """Return what speaks against the poses of cameras that have names and sizes, in sentences; nothing for poses that may be right.

    Cameras that see one thing look at one place. Where they do not, but would if the poses were of another convention, they
    probably are.
    """
    if len(rig.cameras) == 1 or _meet(_pinhole_axes(rig)):
        return ""
    for words, changed in _OTHER_POSES.items():
        poses = (changed(c.rotation, c.translation) for c in rig.cameras)
        cameras = (
            replace(camera, rotation=rotation, translation=translation)
            for camera, (rotation, translation) in zip(rig.cameras, poses, strict=True)
        )
        if _meet(_pinhole_axes(replace(rig, cameras=tuple(cameras)))):
            return (
                f"the cameras look at no place in front of all of them; they would if the poses {words}. Expected are R and t, "
                "world to camera, x right, y down, z forward: p_camera = R p_world + t."
            )
    return ""


def _pinhole_axes(rig: ImportedRig) -> CameraRig:
    """Return the cameras with translations in file units; of lenses that are not a pinhole's, the axis alone."""
    axes = tuple(c.without_lens() if c.needs_view else c for c in rig.cameras)
    return replace(rig, cameras=axes).rig(1.0)


def _meet(rig: CameraRig) -> bool:
    apart, depths = _spacing(rig)
    return depths is not None and max(apart) > _APART * float(np.median(depths))


def _words(unit_m: float) -> str:
    return UNITS_M.get(unit_m, f"{unit_m:g} m")


def _likely_units(
    rig: CameraRig, apart: list[float], depths: Floats[C] | None, size_m: float
) -> list[float]:
    """Return which units, metres each, a rig with translations in file units may have; all where nothing depends on it.

    size_m: of what is tracked.
    """
    if not apart or max(apart) == 0:
        return [1.0]
    if depths is None:
        low, high = (share * size_m for share in _SIDE_BY_SIDE)
        return [unit for unit in UNITS_M if low <= max(apart) * unit <= high]
    spans = np.array([camera.focal_px / min(camera.size) for camera in rig]) * size_m
    share = float(np.median(spans / depths))
    return [unit for unit in UNITS_M if _SHARE_OF_IMAGE[0] <= share / unit <= _SHARE_OF_IMAGE[1]]


def _range(values: Sequence[float], word: str) -> str:
    low, high = min(values), max(values)
    return f"{low:.3g} {word}" if high < 1.01 * low else f"{low:.3g} to {high:.3g} {word}"


def _spacing(rig: CameraRig) -> tuple[list[float], Floats[C] | None]:
    """Return how far cameras stand apart, and how far before each camera all axes come nearest; None where they meet nowhere in front."""
    apart = [float(np.linalg.norm(a.centre - b.centre)) for a, b in combinations(rig, 2)]
    middles = np.array([[camera.matrix[:2, 2]] for camera in rig])
    (point,) = triangulated(tuple(rig), middles, float(np.arccos(1 - _PARALLEL * len(middles))))
    depths = np.array([camera.to_camera(point)[2] for camera in rig])
    return apart, depths if (depths > 0).all() else None


def read_cameras(
    *files: str | Path,
    unit_m: float | None = None,
    size: tuple[int, int] | None = None,
    lens: Literal["plain"] | None = None,
) -> CameraRig:
    """Return the cameras of a calibration in any form that `handtrack new` reads, in metres.

    Parameters
    ----------
    files
        One file or folder, or a file a camera. Cameras without names are called cam0, cam1 …
    unit_m
        Metres in one unit of the file; where not given, its form or the cameras' distances must
        tell it.
    size
        Width, height [px] of cameras whose file does not say.
    lens
        "plain" where four coefficients are k1 k2 p1 p2, and no fisheye's.

    Raises
    ------
    HandtrackError
    """
    where = " and ".join(map(str, files))
    given = read_calibration([Path(file) for file in files])
    names = [camera.name or f"cam{i}" for i, camera in enumerate(given.cameras)]
    given = with_names(given, names)
    try:
        given = with_lens(given, lens, where)
    except HandtrackError as error:
        raise HandtrackError(f'{error} Are they k1 k2 p1 p2? Then lens="plain".') from None
    given, _ = sized(given, {} if size is None else dict.fromkeys(names, size), where)
    if unit_m is not None:
        return given.rig(unit_m)
    unit = unit_of(given)
    if unit.unit_m is None or not unit.sure:
        raise HandtrackError(
            f"{where}: {unit.why} Give the unit: unit_m=0.001 for millimetres, 1.0 for metres."
        )
    return given.rig(unit.unit_m)
