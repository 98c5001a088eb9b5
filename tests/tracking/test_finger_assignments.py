"""Poses with fingers bent otherwise, or exchanged."""

from __future__ import annotations

import numpy as np

from handtrack.model.model_file import load_model
from handtrack.model.pose_library import named_pose
from handtrack.tracking.search.global_search import bent_fingers, swapped_fingers


def test_sixteen_ways_to_hold_four_fingers():
    model = load_model()
    params = model.rest_params()
    ways = bent_fingers(model, params)
    assert len({way.tobytes() for way in ways}) == 16
    thumb = [p for p, name in enumerate(model.transform.names) if "thumb" in name or "root" in name]
    index = model.transform.names.index("index_pip_flex")
    for way in ways:
        np.testing.assert_allclose(way[thumb], params[thumb])
        np.testing.assert_allclose(model.clipped(way), way, atol=1e-12)
    assert len({round(way[index], 6) for way in ways}) == 2


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
