"""A cloud's lines of sight in plain NumPy: one ray against one ellipsoid at a time. docs/explanation/clouds.md."""

import numpy as np

from handtrack.terms.clouds import BESIDE_M, MISSED, OUTLIERS


def slope_distance(axes, x):
    """Return (k² − k)/|∇k²/2| of x (3,) from the centre of the ellipsoid that axes (3, 3) make the unit ball."""
    k = np.linalg.norm(axes @ x)
    return (k * k - k) / np.linalg.norm(axes.T @ axes @ x)


def ray_costs(term, bones):
    """Return (N,) what each ray costs, unweighted."""
    flesh = term.surface.ellipsoids.posed(bones)
    axes = flesh.rotation.transpose(0, 2, 1) / flesh.radii[:, :, None]
    return np.array([_cost(term, axes, flesh.centre, point) for point in term.points])


def _cost(term, axes, centres, point):
    depth = np.linalg.norm(point - term.centre)
    ray = (point - term.centre) / depth
    entry, middle, beside = [], [], []
    for a, centre in zip(axes, centres, strict=True):
        o, v = a @ (term.centre - centre), a @ ray
        t = -(o @ v) / (v @ v)
        room = 1.0 - np.sum((o + t * v) ** 2)
        middle.append(t)
        entry.append(t - np.sqrt(room / (v @ v)) if room > 0 else np.inf)
        beside.append(slope_distance(a, term.centre + t * ray - centre))
    if np.isinf(entry).all():
        passed = (min(beside) / BESIDE_M) ** 2
        return 0.5 * (MISSED.value(passed) + OUTLIERS.value(np.array(1e12)))
    e = int(np.argmin(entry))
    place = min(depth, middle[e])
    off = slope_distance(axes[e], term.centre + place * ray - centres[e]) - (depth - place)
    return 0.5 * OUTLIERS.value((off / term.along_m) ** 2)
