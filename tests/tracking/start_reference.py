"""The plain forms of start_kernels.py: one shape at one place, written down as it is meant."""

import numpy as np

from handtrack.tracking.search.evidence.score_kernels import FAR_M, OUT_OF_SIGHT


def share(distance):
    """Return how little a distance [m] is explained, 0 to 1."""
    return np.minimum(np.asarray(distance) / FAR_M, 1.0) ** 2


def at_nearest_node(values, low, spacing, points):
    """Return values at the nodes nearest to points (N, 3), infinite outside the grid."""
    node = np.floor((points - low) / spacing + 0.5).astype(int)
    inside = ((points >= low) & (node < values.shape)).all(axis=1)
    out = np.full(len(points), np.inf)
    out[inside] = values[tuple(node[inside].T)]
    return out


def cloud_score(start, shape, rotation, place, visible):
    """Return the share of area on which a shape laid at a place and a cloud disagree; visible: (V,) of its points."""
    local = (start.points - place) @ rotation + shape.middle
    near = np.linalg.norm(start.points - place, axis=1) <= shape.reach
    off = at_nearest_node(shape.field, shape.low, shape.spacing, local[near])
    world = (shape.points[visible] - shape.middle) @ rotation.T + place
    grid = start.distances
    empty = at_nearest_node(grid.at_nodes(), grid.low, grid.spacing, world)
    wrong = start.area * share(off).sum() + shape.area * share(empty).sum()
    return wrong / (start.area * near.sum() + shape.area * visible.sum())


def silhouette_score(cameras, outside, step, samples, areas, shape, rotation, place):
    """Return the share of area on which a shape's outlines and masks disagree.

    outside: per camera (H, W) distance to the mask [px] on every step-th pixel; samples: per camera (N, 2) mask pixels.
    """
    wrong = whole = 0.0
    for camera, far, pixels, area in zip(cameras, outside, samples, areas, strict=True):
        focal = np.sqrt(camera.matrix[0, 0] * camera.matrix[1, 1])
        metre = camera.to_camera(place)[2] / focal
        for point, normal in list(zip(shape.points, shape.normals, strict=True))[::2]:
            toward = -camera.rotation[2] @ rotation @ normal
            if toward <= 0:
                continue
            column, row = camera.project(rotation @ (point - shape.middle) + place) / step
            i, j = int(np.floor(column + 0.5)), int(np.floor(row + 0.5))
            off = OUT_OF_SIGHT**2
            if 0 <= i < far.shape[1] and 0 <= j < far.shape[0]:
                off = share(far[j, i] * metre)
            wrong += 2 * shape.area * toward * off
            whole += 2 * shape.area * toward
        middle = camera.project(place)
        near = pixels[np.linalg.norm(pixels - middle, axis=1) * metre < shape.reach]
        balls = (shape.spheres[:, :3] - shape.middle) @ rotation.T + place
        disc = camera.project(balls)
        radius = shape.spheres[:, 3] * focal / camera.to_camera(balls)[:, 2]
        gap = np.linalg.norm(near[:, None] - disc, axis=2) - radius
        uncovered = np.maximum(gap.min(axis=1), 0.0) * metre
        wrong += area * metre**2 * share(uncovered).sum()
        whole += area * metre**2 * len(near)
    return wrong / whole
