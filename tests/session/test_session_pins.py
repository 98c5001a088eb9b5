"""pins.json: written as the image was taken, read without the lens, damaged in every way, and seen by the tracker."""

import json

import numpy as np
import pytest

from handtrack import CameraRig, Session
from handtrack.observation.pins import Pin
from handtrack.session.sources.corrections import SessionPins
from tests.cameras import pinhole
from tests.conftest import refused
from tests.session.small_session import make_session

LENS = np.array([-0.2, 0.05, 0.001, -0.001, 0.0])
RIG = CameraRig((pinhole("left", (320, 240), 500, lens=LENS, at=(160, 120)),))
TIP = Pin("left", (20.25, 30.5), "index_tip")
ON_BONE = Pin("left", (100.0, 40.0), "", "index_distal", (0.001, 0.01, 0.0))


def test_pins_come_back_from_the_file_and_lie_there_in_the_image_as_it_was_taken(tmp_path):
    pins = SessionPins(tmp_path, RIG)
    pins.write({3: [TIP, ON_BONE]})
    row = json.loads((tmp_path / "pins.json").read_text())["pins"][0]
    taken = RIG["left"].distort_points(np.array(TIP.pixel))
    assert np.linalg.norm(taken - TIP.pixel) > 3
    np.testing.assert_allclose(row["pixel"], taken, atol=1e-3)
    again = SessionPins(tmp_path, RIG)
    assert again.frames == [3]
    tip, on_bone = again.of(3)
    np.testing.assert_allclose(tip.pixel, TIP.pixel, atol=2e-3)
    assert (tip.joint, on_bone.bone, on_bone.point) == ("index_tip", "index_distal", ON_BONE.point)
    (seen,) = again.observed(3)
    assert not seen.camera.is_distorted


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ({"frame": -1, "camera": "left", "joint": "wrist", "pixel": [1, 2]}, "frame = -1"),
        ({"frame": 0, "camera": "middle", "joint": "wrist", "pixel": [1, 2]}, "middle"),
        ({"frame": 0, "camera": "left", "joint": "wrist", "pixel": [1]}, "expected 2 numbers"),
        ({"frame": 0, "camera": "left", "pixel": [1, 2]}, 'either "joint"'),
        ({"frame": 0, "camera": "left", "bone": "root", "pixel": [1, 2]}, "point_m"),
        ("nothing", "expected a table"),
    ],
)
def test_a_damaged_pin_is_said_in_words(tmp_path, row, words):
    (tmp_path / "pins.json").write_text(json.dumps({"format": 1, "pins": [row]}))
    refused(words, SessionPins, tmp_path, RIG)


def test_a_session_observes_its_pins(tmp_path):
    folder = make_session(tmp_path)
    pin = {"frame": 2, "camera": "cam1", "joint": "ring_tip", "pixel": [31.5, 20.0]}
    (folder / "pins.json").write_text(json.dumps({"format": 1, "pins": [pin]}))
    session = Session.open(folder)
    assert not session.observation(1).pins
    (seen,) = session.observation(2).pins
    assert seen.camera.name == "cam1"
    assert seen.pins == (Pin("cam1", (31.5, 20.0), "ring_tip"),)
