"""A camera by its numbers."""

from dataclasses import replace

import numpy as np

from handtrack import Camera
from handtrack.geometry.rotation import rotation_matrix

FACING = np.diag([1.0, -1.0, -1.0])
"""the rotation of a camera on the z axis that looks back at the origin, upright"""


def pinhole(name, size, focal, rotation=np.eye(3), translation=(0, 0, 0), lens=(0,) * 5, at=None):
    """Return a camera of one focal length [px], or one along each axis; at: its principal point, else the middle pixel."""
    matrix = np.diag([*np.broadcast_to(focal, 2), 1.0])
    matrix[:2, 2] = 0.5 * (np.array(size) - 1) if at is None else at
    place = np.asarray(translation, float)
    return Camera(name, size, matrix, np.array(lens, float), rotation, place)


def turned(camera: Camera, *degrees: float) -> Camera:
    """Return the camera turned at its place by a rotation vector in its own axes."""
    turn = rotation_matrix(np.deg2rad(degrees))
    return replace(camera, rotation=turn @ camera.rotation, translation=turn @ camera.translation)
