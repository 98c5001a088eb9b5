"""The whole hand dragged in a camera's picture: parallel to the image under the pointer, or turned about the line of sight."""

import numpy as np
import pytest

from handtrack.geometry.rotation import rotation_matrix
from handtrack_app.page.pins.grips import ROOT, WholeDrag
from handtrack_app.page.scene.zoom import ray_pixel
from handtrack_app.protocol.snapshots import CameraCard

TURN = rotation_matrix(np.array([0.3, -0.8, 0.4]))
CARD = CameraCard(
    "cam", (640, 480), np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]]), TURN, np.array([0.1, 0.2, -0.3])
)  # fmt: skip


def _seen(across: float, down: float, deep: float) -> np.ndarray:
    return CARD.centre + TURN @ (across, down, deep)


def _drag(turns: bool) -> WholeDrag:
    root = np.array([*_seen(0.0, 0.08, 0.5), 0.2, 0.9, -0.4])
    return WholeDrag(CARD, root, _seen(0.01, 0.0, 0.52), _seen(0.05, 0.01, 0.48), turns)


def _moved(drag: WholeDrag, end: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return how the drag moves any point of the hand: rotation and shift."""
    edit = drag.to(end)
    root = np.array([edit[name] for name in ROOT])
    rotation = rotation_matrix(root[3:]) @ rotation_matrix(drag.root[3:]).T
    return rotation, root[:3] - rotation @ drag.root[:3]


def test_what_is_held_comes_under_the_pointer_as_deep_as_it_was():
    drag, end = _drag(turns=False), _seen(0.03, -0.04, 0.47)
    rotation, shift = _moved(drag, end)
    np.testing.assert_allclose(rotation, np.eye(3), atol=1e-12)
    place = drag.start + shift
    seen, wanted = (ray_pixel(CARD, p - CARD.centre) for p in (place, end))
    assert seen is not None and wanted is not None
    np.testing.assert_allclose(seen, wanted, atol=1e-9)
    assert (shift @ TURN[:, 2]) == pytest.approx(0.0, abs=1e-12), "parallel to the image"


def test_a_turn_leaves_the_middle_and_follows_the_pointer_round():
    drag = _drag(turns=True)
    axis = (drag.middle - CARD.centre) / np.linalg.norm(drag.middle - CARD.centre)
    quarter = rotation_matrix(axis * np.pi / 2)
    end = drag.middle + quarter @ (drag.start - drag.middle)
    rotation, shift = _moved(drag, end)
    np.testing.assert_allclose(rotation @ drag.middle + shift, drag.middle, atol=1e-12)
    np.testing.assert_allclose(rotation @ axis, axis, atol=1e-9)
    assert np.trace(rotation) == pytest.approx(1.0, abs=0.02), "by a quarter"


def test_what_tells_nothing_changes_nothing():
    assert _drag(turns=True).to(_drag(turns=True).middle) is None, "on the axis itself"
    for turns in (False, True):
        assert _drag(turns).to(CARD.centre - TURN[:, 2]) is None, "behind the camera"
