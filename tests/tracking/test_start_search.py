"""Which of many poses go on: the best, each once, and not all of them at one place."""

import numpy as np

from handtrack.model.model_file import load_model
from handtrack.model.pose_library import named_pose
from handtrack.simulation.scenes.simulated_views import mask_views
from handtrack.simulation.simulate import simulated_rig
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.search.engine import Candidate
from handtrack.tracking.search.evidence.hand_shapes import shape_of
from handtrack.tracking.search.global_search import GlobalObjective, narrow

MODEL = load_model()
SHAPE = shape_of(MODEL, named_pose(MODEL, "open"), "open")


def test_short_arms_bring_a_pose_nearer():
    """From 7 mm beside it, and from a finger's breadth beside it."""
    right = named_pose(MODEL, "rest")
    params = MODEL.transform.solver_params(right)
    seen = mask_views(MODEL, params, simulated_rig(3, (320, 240)).cameras)
    objective = GlobalObjective.of(seen, TrackerSettings())
    near, beside = (
        params + [x, 0.004, 0.0, 0.05, *np.zeros(len(params) - 4)] for x in (0.006, 0.022)
    )
    found = [Candidate(MODEL, x, shape=SHAPE) for x in (near, beside)]
    measured = [objective.measured(f).cost for f in found]
    ended = narrow(objective, found, 8, Control())
    assert all(e.cost < 0.5 * m for e, m in zip(ended, measured, strict=True))
    true = MODEL.keypoints21(MODEL.bones(params))
    joints = [MODEL.keypoints21(MODEL.bones(e.params)) for e in ended]
    off = [np.linalg.norm(j - true, axis=1).mean() for j in joints]
    assert off[0] < 0.003 and off[1] < 0.006  # 1.9 and 4.0 mm
    assert ended[0].cost < ended[1].cost
