"""What `handtrack bench honesty` measures, and the people it is measured on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from handtrack.errors import HandtrackError
from tests.experiments.honesty.honesty import compared, figures_of, honesty
from tests.experiments.honesty.meshes import HandMesh
from tests.experiments.honesty.motions import moving
from tests.experiments.honesty.people import Person, as_person
from tests.sample_track import sample_frame, stacked


def test_regions_that_are_right_hold_ninety_percent_and_wrong_frames_are_counted(rng):
    first = sample_frame(rng, 0)
    assert first.keypoints21 is not None
    true, frames = first.keypoints21, []
    for n in range(200):
        off = rng.normal(0, 0.002, (21, 3))
        if n >= 180:
            off[4] += 0.05
        points = true + off
        status = 1 if n >= 190 else 0
        frames.append(
            replace(
                first, frame=n, keypoints21=points, joint_positions=points, status=status,
                p_off_25mm=0.05 if n < 180 else 0.9, p_off_10mm=np.full(6, 0.1),
            )
        )  # fmt: skip
    found = figures_of({"one": compared(stacked(frames), np.tile(true, (200, 1, 1)))})
    assert found["coverage90_tracked"] == pytest.approx(0.9, abs=0.02)
    assert found["recall"] == 0.5
    assert found["precision"] == 1.0
    assert found["P 0.8-1.0: bad"] == 1.0
    assert found["P 0.0-0.1: bad"] == 0.0


def test_a_constant_offset_of_definition_is_nobody_s_error(rng):
    first = sample_frame(rng, 0)
    assert first.keypoints21 is not None
    frames = [
        replace(first, frame=n, keypoints21=p, joint_positions=p)
        for n, p in enumerate(first.keypoints21 + rng.normal(0, 1e-4, (9, 21, 3)))
    ]
    other = first.keypoints21 + 0.03
    found = compared(stacked(frames), np.tile(other, (9, 1, 1)))
    assert not found.bad.any()
    assert found.inside.all()


def _stick() -> HandMesh:
    """Return a hand of 21 points and no flesh: five straight fingers side by side."""
    points = np.zeros((21, 3))
    for f in range(5):
        for k in range(4):
            points[1 + 4 * f + k] = [0.02 * (f - 2), 0.08 + 0.03 * k, 0.0]
    pivots = np.stack([points[[1 + 4 * f, 1 + 4 * f, 2 + 4 * f, 3 + 4 * f]] for f in range(5)])
    axes = np.tile([[0.0, 0, 1], [-1, 0, 0], [-1, 0, 0], [-1, 0, 0]], (5, 1, 1))
    weights = np.zeros((21, 16))
    weights[np.arange(21), [0, *(3 * f + k for f in range(5) for k in (1, 2, 3, 3))]] = 1.0
    return HandMesh("stick", points, np.zeros((0, 3), int), weights, pivots, axes, points, 0)


def test_people_have_their_lengths_and_bend_at_their_own_joints():
    hand = as_person(_stick(), Person(scale=1.1, fingers=(1.0, 1.05, 1.0, 1.0, 1.0)))
    bent = np.zeros((5, 4))
    bent[:, 2] = np.pi / 2
    vertices, points = hand.posed(bent)
    np.testing.assert_allclose(vertices, points, atol=1e-12)
    lengths = np.linalg.norm(np.diff(points[5:9], axis=0), axis=1)
    np.testing.assert_allclose(lengths, 0.03 * 1.1 * 1.05, rtol=1e-9)
    assert points[8, 2] < -0.05, "a finger bends towards the palm's side"


@pytest.mark.parametrize("kind", ["fist", "letters", "waves"])
def test_motions_keep_their_pace(kind, rng):
    angles = moving(kind, 60, rng)
    assert angles.shape == (60, 5, 4)
    assert np.rad2deg(np.abs(np.diff(angles, axis=0)).max()) < 8.01


def test_a_folder_without_recordings_is_said_to_be_so(tmp_path, monkeypatch):
    monkeypatch.setenv("HANDTRACK_HONESTY", str(tmp_path))
    with pytest.raises(HandtrackError, match="no session with truth"):
        honesty()
