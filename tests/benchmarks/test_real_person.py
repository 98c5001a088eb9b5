"""The real person in one camera's video, two frames: it begins at the pose that is given, is compared by frame, and needs its data."""

import numpy as np
import pytest

from handtrack.errors import HandtrackError
from tests.experiments.jumps import real_person
from tests.experiments.silhouettes import balancing
from tests.experiments.silhouettes.person_session import DATA


def test_without_the_data_it_is_said_which_are_missing(tmp_path, monkeypatch):
    monkeypatch.setenv("HANDTRACK_DATA", str(tmp_path))
    (tmp_path / "work").mkdir()
    with pytest.raises(HandtrackError, match="no pose2sim_body_4cam"):
        real_person.figures(tmp_path / "work", 2)


def test_a_real_person_is_followed_by_images_alone(data_dir, tmp_path, monkeypatch):
    if not (data_dir / DATA / "videos").is_dir():
        pytest.skip(f"no {DATA} in the shared test data")
    monkeypatch.setenv("HANDTRACK_DATA", str(data_dir))
    monkeypatch.setattr(balancing, "FRAMES", 2)
    one = {"edges.weight": 1.0, "intensity.weight": 1.0, "keypoints.weight": 0.0}
    monkeypatch.setattr(real_person, "SHOWN", {"edges": {**one, "tracker.estimate": "forward"}})
    found = real_person.figures(tmp_path, 2)
    number = {name: float(value) for name, value in found.items()}
    assert number["frames"] == 2
    assert number["edges_best_of_8_mm"] <= number["edges_own_mm"] < 60.0
    assert number["edges_pixels_last"] < 40.0
    assert number["edges_tracked"] == 0, "one camera's images leave limbs' flips open"
    assert np.isfinite(number["edges_own_last_mm"])
