"""What a calibration leaves open, settled by the recording that it is for: names, image sizes, the unit."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from handtrack.arrays import C, Floats
from handtrack.capture.calibration.formats.imported_rig import (
    ImportedCamera,
    ImportedRig,
    five_or_more,
    plain_word,
    with_names,
)
from handtrack.capture.calibration.formats.read_calibration import read_calibration
from handtrack.capture.joints.subject import HAND, Subject
from handtrack.errors import HandtrackError
from handtrack.geometry.camera import Camera, CameraRig
from handtrack.geometry.source_lens import FISHEYE_COUNT, SourceLens, pinhole_views
from handtrack.geometry.triangulation import triangulated

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


def sized(rig: ImportedRig, sizes: Mapping[str, tuple[int, int]], where: str) -> ImportedRig:
    """Return the rig with sizes [px] of the recording's images where the calibration says none; of cameras that have
    neither, those of the others. Raises HandtrackError where nobody says one.
    """
    known = [camera.size for camera in rig.cameras if camera.size] + list(sizes.values())
    if not known:
        raise HandtrackError(
            f"{where}: no image size, and no images that have one; add `size` = [w, h] to each camera."
        )
    cameras = tuple(
        replace(c, size=c.size or sizes.get(str(c.name), known[0])) for c in rig.cameras
    )
    return replace(rig, cameras=cameras)


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
        if (
            camera.fisheye
            and len(camera.distortions) > FISHEYE_COUNT
            and camera.distortions[FISHEYE_COUNT:].any()
        ):
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
        bent = camera.distortions
        bent = (
            np.resize(np.append(bent, np.zeros(FISHEYE_COUNT)), FISHEYE_COUNT)
            if camera.fisheye
            else five_or_more(bent)
        )
        lens = SourceLens(camera.size, camera.matrix, bent, bool(camera.fisheye))
        tiles = pinhole_views(name, lens, regions.get(name))
        for i, view in enumerate(tiles):
            tile = name if len(tiles) == 1 else f"{name}_{i + 1}"
            views[tile] = lens, view
            rotation, translation = (
                view.rotation @ camera.rotation,
                view.rotation @ camera.translation,
            )
            cameras.append(
                ImportedCamera(tile, view.size, view.matrix, np.zeros(5), rotation, translation)
            )
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
    axes = tuple(c.without_lens() if c.needs_view else c for c in rig.cameras)
    in_units = replace(rig, cameras=axes).rig(1.0)
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
    if rig.any_unit:
        return Unit(guess, False, f"a {rig.family} has no unit of length; in its unit, {seen}.")
    if len(likely) == 1:
        return Unit(guess, True, f"in its unit, {seen}: for {what} that is {_words(likely[0])}.")
    return Unit(guess, False, f"in its unit, {seen}, which {none}.")


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
    given = sized(given, {} if size is None else dict.fromkeys(names, size), where)
    if unit_m is not None:
        return given.rig(unit_m)
    unit = unit_of(given)
    if unit.unit_m is None or not unit.sure:
        raise HandtrackError(
            f"{where}: {unit.why} Give the unit: unit_m=0.001 for millimetres, 1.0 for metres."
        )
    return given.rig(unit.unit_m)
