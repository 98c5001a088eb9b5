"""The score of a pose: full overlap where it was rendered, less beside that; nothing where nothing was seen."""

from __future__ import annotations

from dataclasses import replace

from handtrack.diagnostics.score import Score, score
from handtrack.model.model_file import load_model
from handtrack.observation.observation import Observation
from handtrack.observation.pins import ImagePins, Pin
from handtrack.simulation.scenes.simulated_views import mask_views
from handtrack.simulation.simulate import simulated_rig
from handtrack.tracking.frame.settings import TrackerSettings

HAND = load_model("hand26")
CAMERAS = simulated_rig(2, (160, 120)).cameras


def test_the_true_pose_overlaps_and_another_overlaps_less_at_a_higher_energy():
    true = HAND.rest_params()
    true[1] = -0.09
    seen = mask_views(HAND, true, CAMERAS)
    beside = true.copy()
    beside[0] += 0.02
    found, worse = (score(HAND, TrackerSettings(), seen, pose) for pose in (true, beside))
    assert set(found.overlap) == {camera.name for camera in CAMERAS}
    assert min(found.overlap.values()) > 0.9
    assert all(worse.overlap[name] < share - 0.05 for name, share in found.overlap.items())
    assert worse.energy["coverage"] > 2 * found.energy["coverage"]


def test_pins_are_no_part_of_it():
    """A person's word is kept by the pose it leads to, and says nothing of the one before."""
    pose = HAND.rest_params()
    pose[1] = -0.09
    seen = mask_views(HAND, pose, CAMERAS)
    pins = (ImagePins(CAMERAS[0], (Pin(CAMERAS[0].name, (5.0, 5.0), "index_tip"),)),)
    assert score(HAND, TrackerSettings(), replace(seen, pins=pins), pose) == score(HAND, TrackerSettings(), seen, pose)  # fmt: skip


def test_nothing_seen_is_no_score():
    assert score(HAND, TrackerSettings(), Observation(0, 0.0), HAND.rest_params()) == Score({}, {})
