"""The scene's solids: closed, seen from outside, and as large as they say."""

import numpy as np
import pytest
import trimesh

from handtrack_app.page.scene.model_view import ball, capsule, rod


@pytest.mark.parametrize(
    ("solid", "volume", "low", "high"),
    [
        (ball(20, 32), 4 / 3 * np.pi, (-1, -1, -1), (1, 1, 1)),
        (rod(16), np.pi, (-1, 0, -1), (1, 1, 1)),
        (capsule(0.5, 0.25, 8, 32), np.pi / 8 + np.pi / 12, (-0.5, 0, -0.5), (0.5, 1, 0.5)),
    ],
)
def test_a_solid_is_closed_and_of_its_size(solid, volume, low, high):
    vertices, faces = solid
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(volume, rel=0.04)  # faceted; inside out negative
    np.testing.assert_allclose(vertices.min(axis=0), low, atol=1e-12)
    np.testing.assert_allclose(vertices.max(axis=0), high, atol=1e-12)
