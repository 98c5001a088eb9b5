"""Which of many poses go on: the best, each once, and not all of them at one place."""

from __future__ import annotations

import numpy as np

from handtrack.model.model_file import load_model
from handtrack.model.pose_library import named_pose
from handtrack.tracker.laid_shapes import Laid
from handtrack.tracker.start_search import distinct
from handtrack.tracker.start_shapes import shape_of

MODEL = load_model()
SHAPE = shape_of(MODEL, named_pose(MODEL, "open"), "open")


def laid(x, degrees, cost):
    turn = np.deg2rad(degrees)
    rotation = np.array(
        [[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]]
    )
    return Laid(SHAPE, SHAPE.params_at(rotation, np.array([x, 0.0, 0.0])), cost)


def test_each_pose_goes_on_once_the_best_first():
    found = [laid(0.0, 1, 2.0), laid(0.0, 0, 1.0), laid(0.0, 90, 1.5)]
    assert [f.cost for f in distinct(found, 5)] == [1.0, 1.5]


def test_no_place_takes_all():
    """An arm's end fits a fist in many variants, each a little better than the hand, its fingers not yet in place."""
    arm = [laid(0.0, 40 * i, 1.0 + 0.01 * i) for i in range(8)]
    kept = distinct([*arm, laid(0.3, 0, 1.4), laid(0.3, 90, 1.5)], 4)
    assert [f.cost for f in kept] == [1.0, 1.01, 1.4, 1.5]


def test_what_is_hopeless_elsewhere_takes_no_place():
    arm = [laid(0.0, 40 * i, 1.0 + 0.01 * i) for i in range(8)]
    kept = distinct([*arm, laid(0.3, 0, 2.5)], 4)
    assert [f.cost for f in kept] == [1.0, 1.01, 1.02, 1.03]
