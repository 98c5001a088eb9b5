"""The doctor's look at the rig: distances, units, lenses."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from handtrack.geometry.camera import Camera
from handtrack.session.doctor.finding import Finding, note, ok, warning

if TYPE_CHECKING:
    from handtrack.session.session import Session

_SAME_PLACE_M = 0.005
_ROUNDING = 1e-6  # a pose written with six digits and more
_FAR_APART_M = 20.0
_UNBALANCED = 0.03  # of a corner's distance from the middle
_USUAL_FIELD = (0.2, 5.0)  # image width / focal length: 11° to 136°


def check_cameras(session: Session) -> Iterator[Finding]:
    """Yield findings about the cameras' mutual distances and each one's lens."""
    yield from _check_distances(session)
    for camera in session.rig:
        yield from check_lens(camera)


def _check_distances(session: Session) -> Iterator[Finding]:
    unit = session.file.session.world_unit_m
    pairs = list(combinations(session.rig, 2))
    if not pairs:
        return
    apart = np.array([np.linalg.norm(a.centre - b.centre) for a, b in pairs])
    span = (
        f"cameras are {apart.min():.3g} to {apart.max():.3g} m apart"
        if len(pairs) > 1
        else f"the cameras are {apart[0]:.3g} m apart"
    )
    if apart.max() > _FAR_APART_M:
        yield warning(
            f"{span}, with world_unit_m = {unit:g}. Is calibration.toml in millimetres? Then "
            "world_unit_m = 0.001."
        )
    elif copied := [(a.name, b.name) for a, b in pairs if _have_one_pose(a, b)]:
        yield warning(
            f"cameras {' and '.join(map(repr, copied[0]))} have one pose. Was it copied? (The colour and the infrared "
            "camera of one housing differ by a little.)"
        )
    elif apart.max() < _SAME_PLACE_M:
        yield warning(f"{span}, with world_unit_m = {unit:g}. Is the unit wrong?")
    else:
        yield ok(f"{span}.")


def _have_one_pose(a: Camera, b: Camera) -> bool:
    """Return whether two poses are the same but for rounding; two cameras of one housing differ by 0.01 mm or more."""
    return bool(
        np.abs(a.centre - b.centre).max() < _ROUNDING
        and np.abs(a.rotation - b.rotation).max() < _ROUNDING
    )


def check_lens(camera: Camera) -> Iterator[Finding]:
    """Yield findings about one camera's matrix and lens."""
    width, height = camera.size
    field = width / camera.matrix[0, 0]
    if not _USUAL_FIELD[0] < field < _USUAL_FIELD[1]:
        yield warning(
            f"camera '{camera.name}': a focal length of {camera.matrix[0, 0]:.4g} px is unusual "
            f"for an image {width} px wide. Does the matrix belong to another image size?"
        )
    cx, cy = camera.matrix[:2, 2]
    if not (0.2 * width < cx < 0.8 * width and 0.2 * height < cy < 0.8 * height):
        yield warning(
            f"camera '{camera.name}': the principal point ({cx:.0f}, {cy:.0f}) is far from the "
            f"middle of {width} x {height}. Is the image cropped or scaled, or are cx and cy "
            "exchanged?"
        )
    yield from _check_series(camera)
    corners = np.array(
        [[0, 0], [width - 1, 0], [0, height - 1], [width - 1, height - 1]], dtype=float
    )
    if np.isnan(camera.undistort_points(corners)).any():
        yield note(
            f"camera '{camera.name}': the distortion folds back before the image's corners; what "
            "lies there is not used. Too many coefficients for the calibration's images? "
            "Calibrate with fewer."
        )


def _check_series(camera: Camera) -> Iterator[Finding]:
    """Yield that a lens's series 1 + k1 r² + k2 r⁴ (+ k3 r⁶) looks cut off: its last term bends most, with nothing against it.

    Where k3 was fitted, k2 and k3 are large and of opposite signs; a file without room for k3 keeps k2 as it was.
    """
    k = np.zeros(5)
    given = np.asarray(camera.distortions, dtype=float)[:5]
    k[: len(given)] = given
    corner = np.array(camera.size) / 2 / np.diag(camera.matrix)[:2]
    r2 = float(corner @ corner)
    if k[4] == 0 and abs(k[1]) * r2 * r2 > max(abs(k[0]) * r2, _UNBALANCED):
        yield warning(
            f"camera '{camera.name}': the coefficient k2 = {k[1]:.3g} moves the corners by "
            f"{abs(k[1]) * r2 * r2:.0%}, and no k3 balances it. Was k3 lost in a conversion (some formats hold only four coefficients)? "
            "Compare with the calibration's own file."
        )
