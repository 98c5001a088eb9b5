"""The predicted hand crops clouds: its distance function, and that tracking hands it over."""

import numpy as np

from handtrack import Observation, PointCloud, Status, Tracker, load_model
from handtrack.model.pose_library import named_pose
from handtrack.model.surfaces.metaballs import MetaballSurface
from handtrack.model.surfaces.surface_mesh import sample_surface
from handtrack.tracking.sequence import track_frames


def posed(model, shift=0.0):
    joint = named_pose(model, "open")
    joint[:3] = [shift, 0.1, 0.4]
    return model.transform.solver_params(joint)


def test_tracking_tells_where_the_hand_is_expected_unless_it_was_lost(rng):
    """A hand that moves on by 12 mm a frame; one frame sees nothing, the next one is seen again."""
    model = load_model()
    tracker, handed = Tracker(model), []

    def observe(frame, bones):
        handed.append(bones)
        if frame == 3:
            return Observation(frame, frame / 30)
        there = model.bones(posed(model, 0.012 * frame))
        points, _ = sample_surface(MetaballSurface.of(model), there, 800, rng)
        return Observation(frame, frame / 30, cloud=PointCloud(points))

    results = list(track_frames(tracker, observe, 0, posed(model), range(5)))
    assert [r.status for r in results] == [Status.TRACKED] * 3 + [Status.LOST, Status.TRACKED]
    assert results[3].reason.kind == "unseen"
    expected = [None if bones is None else bones.position[0, 0] for bones in handed]
    np.testing.assert_allclose(expected[:4], [0.0, 0.0, 0.024, 0.036], atol=0.005)
    assert expected[4] is None
