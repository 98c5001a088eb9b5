"""First views: everything in the free part of the picture, the hand not behind a camera."""

import numpy as np
import pytest

from handtrack_app.engine.document_snapshots import session_snapshot
from handtrack_app.page.scene import viewpoint as vp
from tests.app.fake_run import fake_document


@pytest.fixture
def session(tmp_path):
    return session_snapshot(fake_document(tmp_path))


def in_picture(view, points):
    """Return (N, 2) across and upward, in half heights of the picture."""
    ahead = view.look_at - view.position
    ahead = ahead / np.linalg.norm(ahead)
    right = np.cross(ahead, view.up)
    right /= np.linalg.norm(right)
    seen = points - view.position
    depth = seen @ ahead
    assert (depth > 0).all()
    flat = np.stack([seen @ right, seen @ np.cross(right, ahead)], axis=1)
    return flat / depth[:, None] / np.tan(view.fov / 2)


def test_all_cameras_are_in_an_overview(session):
    hand = np.array([0.0, 0.09, 0.0])
    view = vp.overview(session, hand)
    for card in session.cameras:
        place = in_picture(view, vp.frustum_corners(card, hand)[1:])
        assert (np.abs(place[:, 0]) <= 1.0).all() and (place[:, 1] <= 1.0).all()
        assert (place[:, 1] >= -1.0).all()


def test_a_session_whose_cameras_look_down_has_a_view(session):
    from dataclasses import replace

    down = np.array([[1.0, 0, 0], [0, -1.0, 0], [0, 0, -1.0]])
    cards = tuple(
        replace(card, rotation=down, centre=np.array([0.2 * i, 0.0, 0.6]))
        for i, card in enumerate(session.cameras)
    )
    for one in (cards, cards[:1], ()):
        view = vp.first_view(replace(session, cameras=one), np.zeros(3))
        assert np.isfinite(view.position).all() and np.isfinite(view.look_at).all()
