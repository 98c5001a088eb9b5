"""Small pictures and the contact sheet."""

import numpy as np

from handtrack import Camera
from handtrack_app.engine.pictures.camera_pictures import smaller


def test_a_smaller_camera_sees_the_same():
    matrix = np.array([[600.0, 0, 321.5], [0, 610.0, 238.0], [0, 0, 1]])
    camera = Camera("c", (640, 480), matrix, np.zeros(5), np.eye(3), np.array([0.0, 0, 0.5]))
    point = np.array([0.03, -0.02, 0.1])
    half = smaller(camera, 320, 240).project(point)
    np.testing.assert_allclose(half, (camera.project(point) + 0.5) / 2 - 0.5, atol=1e-9)
