"""The scene's solids: closed, seen from outside, and as large as they say."""

import numpy as np
import pytest

from handtrack_app.page.scene.model_view import Solid, ball, capsule, rod


def _volume(solid: Solid) -> float:
    a, b, c = np.moveaxis(solid.vertices[solid.faces], 1, 0)
    return float((np.cross(a, b) * c).sum() / 6)


@pytest.mark.parametrize(
    ("solid", "volume", "low", "high"),
    [
        (ball(20, 32), 4 / 3 * np.pi, (-1, -1, -1), (1, 1, 1)),
        (rod(16), np.pi, (-1, 0, -1), (1, 1, 1)),
        (capsule(0.5, 0.25, 8, 32), np.pi / 8 + np.pi / 12, (-0.5, 0, -0.5), (0.5, 1, 0.5)),
    ],
)
def test_a_solid_is_closed_and_of_its_size(solid, volume, low, high):
    edges = np.sort(solid.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()
    assert _volume(solid) == pytest.approx(
        volume, rel=0.04
    )  # faceted; inside out it would be negative
    np.testing.assert_allclose(solid.vertices.min(axis=0), low, atol=1e-12)
    np.testing.assert_allclose(solid.vertices.max(axis=0), high, atol=1e-12)
