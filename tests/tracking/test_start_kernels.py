"""The compiled scores of laid shapes are those of their plain forms."""

from itertools import pairwise

import numpy as np
import pytest

from handtrack import load_model
from handtrack.geometry.rotation import spread_rotations
from handtrack.model.surfaces.metaballs import MetaballSurface
from handtrack.model.surfaces.surface_mesh import sample_surface
from handtrack.simulation.scenes.simulated_views import mask_views
from handtrack.simulation.simulate import simulated_rig
from handtrack.tracking.search.evidence.cloud_evidence import cloud_evidence
from handtrack.tracking.search.evidence.hand_shapes import hand_shapes, palm_middle
from handtrack.tracking.search.evidence.silhouette_evidence import (
    _STEP_PX,
    silhouette_evidence,
)
from tests.tracking.start_reference import cloud_score, silhouette_score

MODEL = load_model()
PARAMS = MODEL.rest_params() + np.array([0.0, -0.09, 0.0, 0.4, -0.3, 0.2, *[0.1] * 20])
SHAPE = hand_shapes(MODEL, ["curl"])[0]
TURNS = spread_rotations(5)


@pytest.fixture(scope="module")
def places():
    middle = palm_middle(MODEL, PARAMS)
    return middle + np.array([[0.0, 0.0, 0.0], [0.03, -0.02, 0.01], [0.2, 0.1, 0.0]])


def test_scores_of_clouds(rng, places):
    bones = MODEL.bones(PARAMS)
    points, _ = sample_surface(MetaballSurface.of(MODEL), bones, 3000, rng)
    start = cloud_evidence(points, ())
    found = start.scores(SHAPE, TURNS, places)
    every = np.ones(len(SHAPE.points), bool)
    expected = [[cloud_score(start, SHAPE, r, p, every) for p in places] for r in TURNS]
    # a coordinate may round across a node between float orders of summing
    assert found == pytest.approx(np.array(expected), abs=2e-3)
    assert found.min() > 0.05  # nothing here fits well


def test_scores_of_silhouettes(places):
    seen = mask_views(MODEL, PARAMS, simulated_rig(3, (320, 240)).cameras)
    start = silhouette_evidence(seen.silhouettes)
    found = start.scores(SHAPE, TURNS, places)
    outside, sizes = start._pictures
    samples, begin, areas = start._samples
    cameras = [s.camera for s in start._scored]
    far = [o[: size[1], : size[0]] for o, size in zip(outside, sizes, strict=True)]
    each = [samples[a:b] for a, b in pairwise(begin)]
    expected = [
        [silhouette_score(cameras, far, _STEP_PX, each, areas, SHAPE, r, p) for p in places]
        for r in TURNS
    ]
    assert found == pytest.approx(np.array(expected), abs=2e-3)
    low = start.scores(SHAPE, TURNS, places, enough=0.2)
    sure = low <= 0.2
    assert (low[sure] == found[sure]).all()
    assert (found[~sure] > 0.2).all(), "what is given up is worse than enough"
