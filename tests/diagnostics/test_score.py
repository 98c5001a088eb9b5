"""The score of a pose: full overlap where it was rendered, less beside that; nothing where nothing was seen."""

from handtrack.diagnostics.score import score
from handtrack.model.model_file import load_model
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
