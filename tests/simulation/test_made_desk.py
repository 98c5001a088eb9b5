"""The made desk shows what its truth says."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from handtrack.capture.masks.seeded import Seeded
from handtrack.session.formats.truth import read_truth
from handtrack.session.session import Session
from tests.simulation.made_desk import jitter_mm, triangulated_joints, write_recording


def test_images_joints_and_truth_are_of_one_hand(tmp_path: Path) -> None:
    folder = write_recording(tmp_path / "made", seed=1, frames=3)
    session, truth = Session.open(folder), read_truth(folder / "truth.npz")
    assert session.frame_count == 3
    joints = triangulated_joints(session, range(3))
    places = truth.keypoints21
    assert places is not None
    off = np.linalg.norm(joints - places[:3], axis=2)
    assert 0.004 < np.median(off) < 0.015  # offsets of 10 mm, and noise
    for view in session.views:
        assert isinstance(view.settings.masks, Seeded)
        hand = cv2.imread(str(folder / "truth" / view.name / "000001.png"), cv2.IMREAD_GRAYSCALE)
        at = np.rint(view.camera.project(places[1])).astype(int)
        assert (hand[at[:, 1], at[:, 0]] > 0).mean() > 0.9
        image = view.image(1)
        assert image is not None
        # red beats blue on skin, more than on the desk
        warm = image[..., 2].astype(int) - image[..., 0]
        assert np.median(warm[hand > 0]) > np.median(warm[hand == 0]) + 20


def test_jitter_is_what_is_left_of_a_straight_way() -> None:
    way = np.arange(5.0)[:, None, None] * np.ones((1, 2, 3))
    assert jitter_mm(way) < 1e-9
    way[2, :, 0] += 0.001
    assert abs(jitter_mm(way) - 1.0) < 1e-9
