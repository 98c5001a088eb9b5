"""When a cloud's depths are doubted: below 0.80 of agreement, and from then on until it is above 0.88."""

from dataclasses import replace

import numpy as np

from handtrack import Tracker, TrackerSettings, load_model
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.terms.cloud_terms import agreement, see_cloud
from handtrack.tracking.search.engine import SearchReport
from handtrack.tracking.sequence import track_frames
from tests.experiments.scenes.simulated_clouds import Sensor, depth_views

MODEL = load_model()
TRUTH = MODEL.rest_params()
TRUTH[1] = -0.09
FINE, FAIR, POOR = 0.0, 0.2, 0.4
"""how much of the hand is missing, in zones"""


def cloud(missing, frame=0):
    sensor = Sensor((160, 120), noise_m=5e-4, missing=missing, blob_m=0.04)
    joint = MODEL.joint_params(TRUTH)[None]
    seen = next(depth_views(MODEL, joint, sensor, np.random.default_rng(4)))
    return replace(seen, frame=frame, time_s=frame / 25.0)


def agreed(missing):
    bones = MODEL.bones(TRUTH)
    seen = see_cloud(cloud(missing), MODEL, bones, TrackerSettings())
    assert seen is not None
    found = agreement(seen, MODEL, bones)
    return found.share


def test_a_doubt_begins_below_one_bound_and_ends_above_a_higher_one():
    assert agreed(FINE) > 0.95
    assert 0.82 < agreed(FAIR) < 0.86
    assert agreed(POOR) < 0.78
    clouds = [FINE, FAIR, POOR, FAIR, FINE, FAIR]
    seen = [cloud(missing, frame) for frame, missing in enumerate(clouds)]
    quick = {"tracker.escape": False, "tracker.recovery": False, "solver.iterations": 6}
    tracker = Tracker(MODEL, TrackerSettings().with_values(quick))
    told: list[SearchReport] = []
    control = Control(on_search=told.append)
    path = track_frames(tracker, lambda f, *_: seen[f], 0, TRUTH, range(len(seen)), control)
    results = list(path)
    assert [r.poor_cloud for r in results] == [False, False, True, True, False, False]
    assert [(r.frame, r.winner is not None) for r in told] == [(2, True), (3, True), (4, False)]
