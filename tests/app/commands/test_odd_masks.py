"""Masks that show more than the hand: a face, another arm, everything."""

import cv2
import numpy as np

from handtrack import Session, Status, read_npz


def paint(session, cameras, frame, painted):
    for camera in cameras:
        path = str(session / f"masks/{camera}/{frame:06d}.png")
        mask = cv2.imread(path, cv2.IMREAD_UNCHANGED)
        assert mask is not None
        painted(mask)
        cv2.imwrite(path, mask)


def test_c16_c17_other_things_in_masks_are_told_and_cost_one_frame_at_most(handtrack, session):
    cameras = list(Session.open(session).camera_names)
    paint(session, cameras, 2, lambda mask: mask.fill(255))
    for frame in (3, 4):
        paint(
            session,
            ["cam1"],
            frame,
            lambda m: cv2.ellipse(m, (80, 100), (60, 80), 0, 0, 360, 255, -1),
        )
    quick = [f"--set=tracker.{search}=false" for search in ("recovery", "escape")]
    handtrack.does("track", session, *quick)
    found, truth = read_npz(session / "tracks/poses.npz"), Session.open(session).truth
    assert found.status.tolist() == [
        Status.TRACKED, Status.TRACKED, Status.LOST, Status.DOUBTFUL, Status.DOUBTFUL,
    ]  # fmt: skip
    assert "overlap by" in found.reason[3]
    assert "in cam1" in found.reason[3]
    assert truth.keypoints21 is not None
    assert found.keypoints21 is not None
    off = np.linalg.norm(found.keypoints21 - truth.keypoints21, axis=2).mean(axis=1)
    assert off[[0, 1, 3, 4]].max() < 1e-3
    told = handtrack("doctor", session).out
    assert "camera 'cam1': 2 of 5 masks have a second piece" in told
    assert "frames 3-4. Is it a face, or another arm? A roi" in told
    assert "in 1 of 5 masks more than half of the image is hand, frames 2." in told
