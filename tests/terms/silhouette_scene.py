"""Random bones with ellipsoids, cameras around them and masks with spans: for the silhouette terms' tests."""

import numpy as np
from scipy.spatial.transform import Rotation

from handtrack import Silhouette
from handtrack.model.ellipsoids import Ellipsoids
from handtrack.model.kinematics import BonePoses
from handtrack.observation.observation import UNKNOWN
from tests.cameras import pinhole
from tests.derivatives import deformed

BONES = 5


def bones_of(rng):
    """Return BONES bones near the origin."""
    position = rng.normal(scale=0.03, size=(BONES, 3))
    rotation = Rotation.random(BONES, rng=rng).as_matrix()
    return BonePoses(position[0].copy(), rotation, position)


def ellipsoids_of(rng, count=14, radii=(0.006, 0.025)):
    """Return overlapping ellipsoids of finger size."""
    return Ellipsoids(
        rng.integers(0, BONES, count),
        rng.normal(scale=0.015, size=(count, 3)),
        Rotation.random(count, rng=rng).as_matrix(),
        rng.uniform(*radii, size=(count, 3)),
    )


def parts_at(radii, places, turns=None):
    """Return ellipsoids, each about a bone of its own, and the bones at these places (N, 3)."""
    count, upright = len(places), np.tile(np.eye(3), (len(places), 1, 1))
    flesh = Ellipsoids(
        np.arange(count), np.zeros((count, 3)), upright if turns is None else turns, np.array(radii, float)
    )  # fmt: skip
    return flesh, BonePoses(np.array(places[0], float), upright, np.array(places, float))


def camera_of(rng, size=(96, 72), distance=0.5, focal=110.0, name="cam"):
    """Return a camera that looks at the origin from anywhere."""
    rotation = Rotation.random(rng=rng).as_matrix()
    middle = (size[0] / 2 - 3.3, size[1] / 2 + 2.1)
    return pinhole(name, size, (focal, 1.1 * focal), rotation, (0, 0, distance), at=middle)


def silhouette_of(rng, camera, full, unknown):
    """Return a mask, smooth blobs of 0 … 1, with random spans (some rows not seen at all) unless `full`.

    unknown: nobody knows of two more blobs, across the others' outlines, and of single pixels.
    """
    width, height = camera.size
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    mask = np.zeros((height, width))

    def away():
        """Return each pixel's distance to the edge of a blob, inside positive."""
        across, down = rng.uniform(0.3, 0.7, 2) * (width, height)
        return rng.uniform(4, 14) - np.hypot(u - across, v - down)

    for _ in range(4):
        mask = np.maximum(mask, np.clip(away(), 0, 1))
    begin = rng.integers(0, width // 4, height)
    end = rng.integers(3 * width // 4, width + 1, height)
    end[rng.random(height) < 0.1] = 0
    valid = np.stack([np.minimum(begin, end), end], axis=1)
    if full:
        valid[:] = 0, width
    if unknown:
        for _ in range(2):
            mask[away() > 0] = UNKNOWN
        mask[rng.random(mask.shape) < 0.05] = UNKNOWN
    return Silhouette(camera, mask.astype(np.float32), valid.astype(np.int32))


def silhouettes_of(rng, count=3, full=False, unknown=False, **camera):
    """Return silhouettes of several cameras."""
    return [
        silhouette_of(rng, camera_of(rng, name=f"cam{i}", **camera), full, unknown)
        for i in range(count)
    ]


def assert_same_system(ours, other):
    """Fail unless cost, gradient and Hessian agree, relative to their largest numbers."""
    assert abs(ours.cost - other.cost) <= 1e-9 * max(abs(other.cost), 1e-12)
    for a, b in ((ours.gradient, other.gradient), (ours.hessian, other.hessian)):
        assert np.isfinite(a).all()
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-9 * max(np.abs(b).max(), 1e-12))


def moved_along(bones, step):
    """Return bones moved by twists (6B,) about the reference."""
    return deformed(bones, step.reshape(-1, 6))
