"""The merged surface in plain NumPy, point by ellipsoid: what the kernels must agree with."""

import numpy as np

from handtrack.arrays import Floats, Ints
from handtrack.model.ellipsoids import Ellipsoids
from handtrack.model.kinematics import BonePoses
from handtrack.model.metaballs import MetaballSurface
from handtrack.terms.loss import Loss
from handtrack.terms.term import motion_row

STEP = 1e-20
"""so small that a function of x + i·STEP is its value plus i·STEP times its slope, to the last digit"""


def distances(flesh: Ellipsoids, points: Floats, form: str) -> Floats:
    """Return d (N, E) for each ellipsoid on its own (2004 paper, section 3.3)."""
    out = points[:, None] - flesh.centre
    y = np.einsum("eji,nej->nei", flesh.rotation, out) / flesh.radii
    k, rho = (np.sqrt((v**2).sum(axis=-1)) for v in (y, out))
    inner = {"d1": True, "d2": False, "d3": k.real < 1}[form]
    return np.where(inner, flesh.radii.min(axis=1) * (k - 1), rho * (1 - 1 / k))


def merged(
    surface: MetaballSurface, bones: BonePoses, points: Floats
) -> tuple[Floats, Ints, Floats, Floats]:
    """Return d (N,), the closest ellipsoid (N,), weights (N, E) and each ellipsoid's gradient (N, E, 3)."""
    flesh = surface.ellipsoids.posed(bones)
    d = distances(flesh, points, surface.form)
    moved = [distances(flesh, points + 1j * STEP * axis, surface.form) for axis in np.eye(3)]
    n = np.stack(moved, axis=2).imag / STEP
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
) -> tuple:
    """Return E1's cost and rows: the cloud point stays, the bone moves."""
    d, _, share, n = merged(surface, bones, points)
    residual = d / sigma
    twist = -(share / sigma)[..., None] * motion_row(points[:, None], n, bones.reference)
    cost = 0.5 * weight * float(loss.value(residual**2).sum())
    return cost, residual, surface.ellipsoids.bone, twist, weight * loss.weight(residual**2)
