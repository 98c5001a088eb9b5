"""Somebody's calibration as cameras in metres, in one call."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from handtrack.capture.calibration.formats.given_rig import with_names
from handtrack.capture.calibration.formats.read_calibration import read_calibration
from handtrack.capture.calibration.formats.settle import sized, unit_of, with_lens
from handtrack.errors import HandtrackError
from handtrack.geometry.camera import CameraRig


def read_cameras(
    *files: str | Path,
    unit_m: float | None = None,
    size: tuple[int, int] | None = None,
    lens: Literal["plain"] | None = None,
) -> CameraRig:
    """Return the cameras of a calibration in any form that `handtrack new` reads, in metres.

    files: one file or folder, or a file a camera. Cameras without names are called cam0, cam1 … unit_m: metres in one unit of
    the file; where not given, its form or the cameras' distances must tell it. size: width, height [px] of cameras whose file
    does not say. lens: "plain" where four coefficients are k1 k2 p1 p2, and no fisheye's. Raises HandtrackError.
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
