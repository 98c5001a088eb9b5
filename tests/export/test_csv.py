"""Tables of numbers: the contract's CSV, tidy ones, what explains them, and joints alone."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from handtrack import HandtrackError
from handtrack.export.registry import export_format
from handtrack.export.table import ResultsTable
from handtrack.model.articulated import keypoint_names
from handtrack.tracking.frame.result import joint_confidence
from tests.export.sequences import sample_sequence
from tests.sample_track import sample_track


def written(name, track, folder):
    file = export_format(name)
    return file.write(folder / f"poses{file.ending}", ResultsTable(track))


@pytest.mark.parametrize("kind", ["csv", "csv-long", "anipose"])
def test_c54_a_name_that_begins_a_formula_is_text_and_numbers_stay(kind, rng, tmp_path):
    track = sample_track(rng)
    name = '=HYPERLINK("http://x")'
    track = replace(track, joint_names=(name, "@sum", *track.joint_names[2:]))
    path = written(kind, track, tmp_path)[0]
    with path.open(newline="", encoding="utf-8") as file:
        cells = [cell for row in csv.reader(file) for cell in row]
    assert any(cell.startswith("'" + name) for cell in cells)
    assert any(cell.startswith("'@sum") for cell in cells)
    risky = [cell for cell in cells if cell.startswith(("=", "+", "-", "@"))]
    assert risky  # negative coordinates
    assert all(np.isfinite(float(cell)) for cell in risky)


def test_frames_that_were_not_tracked_are_lost_ones_where_a_format_has_a_rate(tmp_path):
    _, track = sample_sequence("right")
    part = track.labels.track(track[row] for row in (0, 1, 4))
    whole = ResultsTable(part).without_gaps
    assert whole.track.frame.tolist() == [3, 4, 5, 6, 7]
    assert whole.is_lost.tolist() == [False, False, True, True, False]
    assert_allclose(whole.track.time_s, np.arange(3, 8) / 50)
    assert_array_equal(whole.track.parameters[3], track.parameters[1])
    assert np.isinf(whole.track.parameter_std[2]).all()
    assert (joint_confidence(whole.track)[2:4] == 0).all()
    (path,) = written("bvh", part, tmp_path)
    assert "Frames: 5" in path.read_text()


def test_exports_say_whose_points_they_hold_and_hold_those_asked_for(tmp_path):
    """A skeleton has none of them."""
    track = sample_sequence("right")[1]
    for landmarks in ("joints", "surface21"):
        for name in ("keypoints", "csv"):
            export_format(name).write(tmp_path / f"p.{name}", ResultsTable(track), "", landmarks)
        with np.load(tmp_path / "p.keypoints") as file:
            assert str(file["keypoint_definition"]) == landmarks
            held = file["keypoints21"]
        assert_allclose(held, track.in_landmarks(landmarks).keypoints21, atol=1e-9)
        assert json.loads((tmp_path / "p.json").read_text())["keypoint_definition"] == landmarks
        with (tmp_path / "p.csv").open(newline="") as file:
            cells = next(csv.DictReader(file))
        place = [float(cells[f"thumb_mcp_{axis}_m"]) for axis in "xyz"]
        assert_allclose(place, held[0, keypoint_names().index("thumb_mcp")], atol=1e-8)
    for name, landmarks in (("csv", "openpose21"), ("bvh", "surface21")):
        with pytest.raises(HandtrackError, match=f"openpose21|{name}"):
            export_format(name).write(tmp_path / "no", ResultsTable(track), "", landmarks)
    assert not (tmp_path / "no").exists()
