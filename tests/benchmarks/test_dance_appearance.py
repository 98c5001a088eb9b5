"""The 2003 paper's Fig. 7, its first frames, small: one camera, no masks."""

from __future__ import annotations

import numpy as np
import pytest

from docs.pictures.dance_picture import fig7
from handtrack.bench.registry import BENCHMARKS
from handtrack.tracking.frame.settings import TrackerSettings
from tests.experiments.jumps.dance_appearance import WAYS, dance, first_guess, overlap_with, track

FRAMES = 4


@pytest.fixture(scope="module")
def what(data_dir):
    return dance(FRAMES, (320, 240))


def test_the_truth_covers_itself_and_a_guess_does_not(what):
    for frame in range(FRAMES):
        assert overlap_with(what, frame, what.bones(frame)) > 0.95  # but for pixels half covered
    guess = what.model.bones(first_guess(what))
    assert 0.3 < overlap_with(what, 0, guess) < 0.95
    assert len(what.observation(0).keypoints) == 1
    assert what.observation(1).keypoints == ()
    assert what.observation(1).silhouettes == ()


def test_edges_and_intensity_follow_the_dancer(what):
    found = track(what, WAYS["memory_1"])
    guess = what.model.bones(first_guess(what))
    assert found.overlap[0] > overlap_with(what, 0, guess)
    assert found.overlap.min() > 0.8
    picture = fig7(what, found, (0, FRAMES - 1))
    assert picture.shape == (2 * 286 + 2 * 160, 2 * 160, 3)
    assert np.ptp(picture) > 200


def test_every_way_is_a_setting_of_the_tracker():
    for name, settings in WAYS.items():
        chosen = TrackerSettings().with_values(settings)
        assert chosen.tracker.hypotheses == int(name[-1])
        assert chosen.silhouettes.weight == 0
    assert BENCHMARKS["dance_appearance"].quick is False
