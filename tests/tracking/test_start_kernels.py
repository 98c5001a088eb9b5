"""What a search for the first pose goes by: compiled scores of laid shapes, and what all silhouettes agree on."""

from itertools import pairwise

import numpy as np
import pytest

from handtrack import Silhouette, load_model
from handtrack.geometry.rotation import spread_rotations
from handtrack.model.pose_library import named_pose
from handtrack.simulation.scenes.simulated_views import mask_views
from handtrack.simulation.simulate import simulated_rig
from handtrack.tracking.search.evidence.cloud_evidence import cloud_evidence
from handtrack.tracking.search.evidence.hand_shapes import palm_middle, shape_of
from handtrack.tracking.search.evidence.silhouette_evidence import (
    _STEP_PX,
    silhouette_evidence,
    visual_hull,
)
from tests.tracking.scenes import on_surface
from tests.tracking.start_reference import cloud_score, silhouette_score

MODEL = load_model()
PARAMS = MODEL.rest_params() + np.array([0.0, -0.09, 0.0, 0.4, -0.3, 0.2, *[0.1] * 20])
SHAPE = shape_of(MODEL, named_pose(MODEL, "curl"), "curl")
TURNS = spread_rotations(5)
SEEN = mask_views(MODEL, PARAMS, simulated_rig(3, (320, 240)).cameras).silhouettes
JOINTS = MODEL.joint_positions(MODEL.bones(PARAMS))


@pytest.fixture(scope="module")
def places():
    middle = palm_middle(MODEL, PARAMS)
    return middle + np.array([[0.0, 0.0, 0.0], [0.03, -0.02, 0.01], [0.2, 0.1, 0.0]])


def test_scores_of_clouds(rng, places):
    points, _ = on_surface(MODEL, PARAMS, 3000, rng)
    start = cloud_evidence(points, ())
    found = start.scores(SHAPE, TURNS, places)
    every = np.ones(len(SHAPE.points), bool)
    expected = [[cloud_score(start, SHAPE, r, p, every) for p in places] for r in TURNS]
    # a coordinate may round across a node between float orders of summing
    assert found == pytest.approx(np.array(expected), abs=2e-3)
    assert found.min() > 0.05  # nothing here fits well


def test_scores_of_silhouettes(places):
    start = silhouette_evidence(SEEN)
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


def nearest(points, to):
    return np.linalg.norm(points - to[:, None], axis=2).min(axis=1)


def test_the_hull_holds_the_hand_and_lies_in_every_mask():
    centres, inside = visual_hull(SEEN)
    assert nearest(centres, JOINTS).max() < 0.01, "every joint is in it"
    for silhouette in SEEN:
        row, column = np.nonzero(silhouette.mask)
        mask = np.stack([column, row], axis=1).astype(float)
        pixel = silhouette.camera.project(centres)
        depth = silhouette.camera.to_camera(centres)[:, 2]
        off = np.linalg.norm(pixel[:, None] - mask, axis=2).min(axis=1)
        half_cell = 0.5 * 0.01 * silhouette.camera.matrix[0, 0] / depth
        assert (off <= half_cell + 1.0).all(), silhouette.camera.name  # a pixel of rounding
    palm = np.linalg.norm(centres - JOINTS.mean(axis=0), axis=1).argmin()
    assert inside[palm] > 0.008, "the palm is deep inside"


def test_empty_and_contradicting_masks_have_no_hull():
    assert len(visual_hull([])[0]) == 0
    nothing = [Silhouette(s.camera, np.zeros_like(s.mask), s.valid) for s in SEEN]
    assert len(visual_hull(nothing)[0]) == 0
    row = np.zeros_like(SEEN[0].mask)
    row[:8, :8] = 1.0  # a corner that sees past everything the others see
    corner = Silhouette(SEEN[0].camera, row, SEEN[0].valid)
    assert len(visual_hull([corner, *SEEN[1:]])[0]) == 0
