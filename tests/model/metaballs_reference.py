"""The merged surface in plain NumPy, point by ellipsoid: what the kernels must agree with."""

import numpy as np

from handtrack.arrays import Floats, Ints
from handtrack.model.flesh import Ellipsoids
from handtrack.model.kinematics import BonePoses
from handtrack.model.surfaces.metaballs import MetaballSurface
from handtrack.terms.loss import Loss
from handtrack.terms.rows import Rows, motion_row


def distances(flesh: Ellipsoids, points: Floats, form: str) -> tuple[Floats, Floats]:
    """Return d (N, E) and its gradient (N, E, 3) for each ellipsoid on its own (2004 paper, section 3.3)."""
    out = points[:, None] - flesh.centre
    y = np.einsum("eji,nej->nei", flesh.rotation, out) / flesh.radii
    g = np.einsum("eij,nej->nei", flesh.rotation, y / flesh.radii)
    k = np.linalg.norm(y, axis=-1)
    rho = np.linalg.norm(out, axis=-1)
    least = flesh.radii.min(axis=1)
    near = least * (k - 1), (least / k)[..., None] * g
    far = rho * (1 - 1 / k), (rho / k**3)[..., None] * g + ((1 - 1 / k) / rho)[..., None] * out
    inner = {"d1": np.ones_like(k, bool), "d2": np.zeros_like(k, bool), "d3": k < 1}[form]
    return np.where(inner, near[0], far[0]), np.where(inner[..., None], near[1], far[1])


def merged(
    surface: MetaballSurface, bones: BonePoses, points: Floats
) -> tuple[Floats, Ints, Floats, Floats]:
    """Return d (N,), the closest ellipsoid (N,), weights (N, E) and each ellipsoid's gradient (N, E, 3)."""
    d, n = distances(surface.ellipsoids.posed(bones), points, surface.form)
    closest = d.argmin(axis=1)
    least = d.min(axis=1)
    share = np.exp(-surface.sharpness * (d - least[:, None])) * surface.linked[closest]
    total = share.sum(axis=1)
    return least - np.log(total) / surface.sharpness, closest, share / total[:, None], n


def cloud_rows(
    surface: MetaballSurface,
    bones: BonePoses,
    points: Floats,
    sigma: float,
    loss: Loss,
    weight: float = 1.0,
) -> Rows:
    """Return E1's rows: the cloud point stays, the bone moves."""
    d, _, share, n = merged(surface, bones, points)
    residual = d / sigma
    row, e = np.nonzero(share)
    twist = motion_row(points[row], n[row, e], bones.reference)
    twist *= -(share[row, e] / sigma)[:, None]
    cost = 0.5 * weight * float(loss.value(residual**2).sum())
    # entries of one bone are summed by Rows
    return Rows(
        residual, row, surface.ellipsoids.bone[e], twist, cost, weight * loss.weight(residual**2)
    )
