"""Edges and texture in plain NumPy: what the compiled loops must agree with."""

import numpy as np
from scipy.ndimage import map_coordinates

from handtrack.terms.images import CLUTTER, CORRELATION_PX
from handtrack.terms.term import JointSystem, motion_row
from tests.terms.plain_rows import system_of


def edges_system(term, bones):
    """Return the system of an OutlineEdgesTerm: rows along the normals, weighed by how likely each edge is."""
    total = JointSystem.zero(6 * len(bones.position))
    for outline, place, strength in term.observed:
        points = bones.to_world(outline.bone, outline.local)
        x = ((outline.camera.project(points) - outline.pixel) * outline.normal).sum(axis=1)
        off = (x[:, None] - place) / term.sigma_px
        likely = strength * np.exp(-0.5 * off**2)
        here = CLUTTER + likely.sum(axis=1)
        none = CLUTTER + (0 if term.from_unexplained else strength.sum(axis=1))
        size = term.weight * outline.length_px / CORRELATION_PX
        across = np.einsum("nij,ni->nj", outline.camera.project_jacobian(points), outline.normal)
        twist = motion_row(points, across, bones.reference)
        most = likely.shape[1]
        total += system_of(
            len(bones.position),
            float(-(size * np.log(here / none)).sum()),
            off.ravel(),
            np.repeat(outline.bone, most)[:, None],
            np.repeat(twist, most, axis=0)[:, None] / term.sigma_px,
            (size[:, None] * likely / here[:, None]).ravel(),
        )
    return total


def bilinear(image, pixels):
    """Return values (N, 3) and slopes (N, 3, 2) of an image (H, W, 3), the border going on beyond it."""
    planes, (x, y), (left, top) = (
        np.moveaxis(image.astype(float), 2, 0),
        pixels.T,
        np.floor(pixels).T,
    )

    def at(x, y):
        return np.stack([map_coordinates(p, [y, x], order=1, mode="nearest") for p in planes], 1)

    slopes = at(left + 1, y) - at(left, y), at(x, top + 1) - at(x, top)
    return at(x, y), np.stack(slopes, axis=2)


def texture_system(term, bones):
    """Return the system of a CarriedTextureTerm: three rows a point, robust together."""
    total = JointSystem.zero(6 * len(bones.position))
    for texture, image in term.observed:
        camera = texture.camera
        points = bones.to_world(texture.bone, texture.local)
        values, slopes = bilinear(image.values, camera.project(points) - image.corner)
        residual = (values - texture.color) / term.sigma
        squared = (residual**2).sum(axis=1)
        worst = term.loss.scale**2 if term.from_unexplained else 0.0
        across = np.einsum("nci,nij->ncj", slopes, camera.project_jacobian(points)) / term.sigma
        twist = motion_row(np.repeat(points, 3, axis=0), across.reshape(-1, 3), bones.reference)
        total += system_of(
            len(bones.position),
            0.5 * term.weight * float((term.loss.value(squared) - worst).sum()),
            residual.ravel(),
            np.repeat(texture.bone, 3)[:, None],
            twist[:, None],
            term.weight * np.repeat(term.loss.weight(squared), 3),
        )
    return total
