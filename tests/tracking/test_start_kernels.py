"""What a search for the first pose goes by: compiled scores of laid shapes, and what all silhouettes agree on."""

import numpy as np
import pytest

from handtrack import Silhouette, load_model
from handtrack.geometry.rotation import rotation_matrix, spread_rotations
from handtrack.model.pose_library import named_pose
from handtrack.simulation.scenes.simulated_views import mask_views
from handtrack.simulation.simulate import simulated_rig
from handtrack.tracking.search.evidence.cloud_evidence import cloud_evidence
from handtrack.tracking.search.evidence.hand_shapes import palm_middle, shape_of
from handtrack.tracking.search.evidence.silhouette_evidence import (
    silhouette_evidence,
    visual_hull,
)

MODEL = load_model()
PARAMS = MODEL.clipped(
    named_pose(MODEL, "curl") + np.r_[0.0, -0.09, 0.0, 0.4, -0.3, 0.2, np.zeros(20)]
)
SHAPE = shape_of(MODEL, named_pose(MODEL, "curl"), "curl")
SEEN = mask_views(MODEL, PARAMS, simulated_rig(3, (320, 240)).cameras).silhouettes
JOINTS = MODEL.joint_positions(MODEL.bones(PARAMS))


TRUE_TURN = rotation_matrix(PARAMS[3:6])
TURNS = np.concatenate([TRUE_TURN[None], spread_rotations(5)])
PLACES = palm_middle(MODEL, PARAMS) + np.array(
    [[0.0, 0.0, 0.0], [0.02, -0.02, 0.01], [0.6, 0.1, 0.0]]
)


def test_the_right_turn_and_place_score_best_in_a_cloud_and_none_where_nothing_is():
    """The share of area that cloud and shape do not have in common, of half of the shape's points and of all of them."""
    own = (SHAPE.points - SHAPE.middle) @ TRUE_TURN.T
    whole, half = (
        cloud_evidence(PLACES[0] + some, ()).scores(SHAPE, TURNS, PLACES)
        for some in (own, own[own[:, 1] > np.median(own[:, 1])])
    )
    for found in (whole, half):
        assert np.unravel_index(found.argmin(), found.shape) == (0, 0)
        assert found[:, 2] == pytest.approx(1.0)
        assert found[0, 1] > found[0, 0] + 0.05
    assert whole[0, 0] < 0.06
    assert half[0, 0] == pytest.approx(1 / 3, abs=0.08), "one half of one and a half"


def test_the_right_turn_and_place_score_best_in_silhouettes():
    start = silhouette_evidence(SEEN)
    found = start.scores(SHAPE, TURNS, PLACES)
    assert np.unravel_index(found.argmin(), found.shape) == (0, 0)
    assert found[0, 0] < 0.06
    assert found[0, 1] > found[0, 0] + 0.05
    fist = shape_of(
        MODEL, named_pose(MODEL, "fist"), "fist"
    )  # without what the masks show of fingers
    assert start.scores(fist, TURNS[:1], PLACES[:1]) > found[0, 0] + 0.05
    low = start.scores(SHAPE, TURNS, PLACES, enough=0.2)
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
