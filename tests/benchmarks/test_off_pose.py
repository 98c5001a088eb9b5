"""Poses that are off before masks of three cameras: the benchmark's runs, small."""

from tests.experiments.starts.off_pose import RIGHT_MM, off_pose, off_runs


def test_a_pose_that_is_off_is_right_again():
    first_mm, frame_mm = off_runs(1, (320, 240))
    assert max(first_mm, frame_mm) < RIGHT_MM


def test_its_figures_are_shares(monkeypatch):
    monkeypatch.setattr(
        "tests.experiments.starts.off_pose.off_runs", lambda seed: (1.0, 4.0 + 2.0 * seed)
    )
    figures = off_pose(2)
    assert figures["first_pose_right"] == 1.0
    assert figures["frame_right"] == 0.5
    assert figures["frame_worst_mm"] == 6.0
