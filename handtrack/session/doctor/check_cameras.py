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
_FAR_APART_M = 20.0
_USUAL_FIELD = (0.2, 5.0)  # image width / focal length: 11° to 136°


def check_cameras(session: Session) -> Iterator[Finding]:
    """Yield findings about the cameras' mutual distances and each one's lens."""
    yield from _check_distances(session)
    for camera in session.rig:
        yield from _check_lens(camera)


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
    elif apart.min() < _SAME_PLACE_M:
        a, b = pairs[int(np.argmin(apart))]
        yield warning(
            f"cameras '{a.name}' and '{b.name}' are only {apart.min() * 1000:.2g} mm apart, with "
            f"world_unit_m = {unit:g}. Was one camera's pose copied, or is the unit wrong?"
        )
    else:
        yield ok(f"{span}.")


def _check_lens(camera: Camera) -> Iterator[Finding]:
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
    corners = np.array(
        [[0, 0], [width - 1, 0], [0, height - 1], [width - 1, height - 1]], dtype=float
    )
    if np.isnan(camera.undistort_points(corners)).any():
        yield note(
            f"camera '{camera.name}': the distortion folds back before the image's corners; what "
            "lies there is not used. Too many coefficients for the calibration's images? "
            "Calibrate with fewer."
        )
