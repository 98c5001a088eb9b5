"""Poses with fingers bent otherwise, or exchanged."""

import numpy as np

from handtrack.model.model_file import load_model
from handtrack.model.pose_library import named_pose
from handtrack.tracking.search.global_search import swapped_fingers


def test_neighbours_are_exchanged_and_nothing_else():
    model = load_model()
    # the index alone is stretched
    start = model.transform.solver_params(named_pose(model, "point"))
    index, middle, ring = (
        model.skeleton.parameter(f"{f}_pip_flex") for f in ("index", "middle", "ring")
    )
    swapped = swapped_fingers(model, start)
    assert len(swapped) == 3
    assert swapped[0][index] == start[middle]
    assert swapped[0][middle] == start[index]
    assert swapped[0][ring] == start[ring]
    np.testing.assert_array_equal(swapped[0][:6], start[:6])
