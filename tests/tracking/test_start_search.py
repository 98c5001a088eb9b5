"""Which of many poses go on: the best, each once, and not all of them at one place."""

from __future__ import annotations

import numpy as np

from handtrack.model.model_file import load_model
from handtrack.model.pose_library import named_pose
from handtrack.simulation.scenes.simulated_views import mask_views
from handtrack.simulation.simulate import simulated_rig
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.search.evidence.hand_shapes import palm_middle, shape_of
from handtrack.tracking.search.laid_shapes import Laid, laid_everywhere
from handtrack.tracking.search.start_search import (
    distinct,
    narrowed,
    narrowly_measured,
    start_sources,
)

MODEL = load_model()
SHAPE = shape_of(MODEL, named_pose(MODEL, "open"), "open")


def laid(x, degrees, cost):
    turn = np.deg2rad(degrees)
    rotation = np.array(
        [[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]]
    )
    return Laid(SHAPE, SHAPE.params_at(rotation, np.array([x, 0.0, 0.0])), cost)


def test_short_arms_bring_a_pose_nearer():
    """From 7 mm beside it, and from a finger's breadth beside it."""
    right = named_pose(MODEL, "rest")
    params = MODEL.transform.solver_params(right)
    seen = mask_views(MODEL, params, simulated_rig(3, (320, 240)).cameras)
    sources = start_sources(seen, TrackerSettings())
    near, beside = (
        params + [x, 0.004, 0.0, 0.05, *np.zeros(len(params) - 4)] for x in (0.006, 0.022)
    )
    found = [Laid(SHAPE, x, np.inf) for x in (near, beside)]
    measured = [narrowly_measured(sources, f).cost for f in found]
    ended = [narrowed(sources, f, 8) for f in found]
    assert all(e.cost < 0.5 * m for e, m in zip(ended, measured, strict=True))
    off = [np.linalg.norm(e.joints - Laid(SHAPE, params, 0.0).joints, axis=1).mean() for e in ended]
    assert off[0] < 0.003 and off[1] < 0.006  # 1.9 and 4.0 mm
    assert ended[0].cost < ended[1].cost


def test_each_pose_goes_on_once_the_best_first():
    found = [laid(0.0, 1, 2.0), laid(0.0, 0, 1.0), laid(0.0, 90, 1.5)]
    assert [f.cost for f in distinct(found, 5)] == [1.0, 1.5]


def test_no_place_takes_all():
    """An arm's end fits a fist in many variants, each a little better than the hand, its fingers not yet in place."""
    arm = [laid(0.0, 40 * i, 1.0 + 0.01 * i) for i in range(8)]
    kept = distinct([*arm, laid(0.3, 0, 1.4), laid(0.3, 90, 1.5)], 4)
    assert [f.cost for f in kept] == [1.0, 1.01, 1.4, 1.5]


class Arm:
    """A source in which any hand fits better at one place than at another, as fists do at an arm's end."""

    places = np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0]])

    def scores(self, shape, rotations, places, enough=1.0):
        return (
            0.2 + np.where(places[:, 0] > 0.1, 0.1, 0.0) + 1e-4 * np.arange(len(rotations))[:, None]
        )


def test_half_of_those_laid_are_elsewhere():
    found = laid_everywhere([Arm()], [SHAPE], 8, lambda: False)
    there = [palm_middle(f.shape.model, f.params)[0] > 0.1 for f in found]
    assert sorted(there) == [False] * 4 + [True] * 4
    assert [f.cost for f in found] == sorted(f.cost for f in found)


def test_what_is_hopeless_elsewhere_takes_no_place():
    arm = [laid(0.0, 40 * i, 1.0 + 0.01 * i) for i in range(8)]
    kept = distinct([*arm, laid(0.3, 0, 3.5)], 4)
    assert [f.cost for f in kept] == [1.0, 1.01, 1.02, 1.03]
