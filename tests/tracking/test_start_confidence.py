"""What a search for the first pose goes by, how sure that pose is said to be, as often as it is right, and how near its size comes."""

from dataclasses import replace

import numpy as np
import pytest

from handtrack import Silhouette, TrackerSettings, load_model
from handtrack.geometry.rotation import rotation_matrix, spread_rotations
from handtrack.model.pose_library import named_pose
from handtrack.simulation.scenes.simulated_views import mask_views
from handtrack.simulation.simulate import simulated_rig
from handtrack.tracking.search.engine import Candidate
from handtrack.tracking.search.global_search import (
    GlobalObjective,
    finger_bends,
    narrow,
    wide,
)
from handtrack.tracking.search.scores import (
    cloud_score,
    palm_middle,
    shape_of,
    silhouette_score,
    visual_hull,
)
from handtrack.tracking.search.start_confidence import (
    BASIN_M,
    KNOWN_SIZE_SIGMA,
    SIZE_SIGMA,
    p_in_basin,
    shares,
)
from tests.experiments.scenes.start_frames import another_hand

MODEL = load_model()


def seen_by(cameras, rng, pose="point"):
    """Return what cameras see of another hand, its joints, and the same pose of the model's."""
    filmed = another_hand(rng)
    joint = named_pose(filmed, pose)
    joint[6:] += np.deg2rad(8.0) * rng.normal(size=len(joint) - 6)
    joint[3:6] = rng.uniform(-1.0, 1.0, size=3)
    params = filmed.clipped(filmed.transform.solver_params(joint))
    params[:3] -= filmed.keypoints21(filmed.bones(params)).mean(axis=0)
    seen = mask_views(filmed, params, simulated_rig(cameras, (320, 240)).cameras)
    shape = shape_of(MODEL, filmed.joint_params(params), pose)
    objective = GlobalObjective.of(seen, TrackerSettings())
    true = filmed.keypoints21(filmed.bones(params))
    start = Candidate(MODEL, params, 0.0, shape=shape)
    shift = (true - start.joints).mean(axis=0)
    return objective, true, replace(start, params=params + np.r_[shift, np.zeros(len(params) - 3)])


def settled(objective, candidate):
    """Return where a pose comes to rest, wide and then narrow, and its cost there."""
    near = wide(objective, [candidate], 12)[0]
    for _ in range(2):  # what counts around a pose is taken anew
        near = narrow(objective, [near], 8)[0]
    return near


def test_they_are_as_sure_as_they_are_right():
    """Fingers of two dozen hands are looked for in one, two or three views; nothing is told of place and turn."""
    said, right = [], []
    for seed in range(24):
        rng = np.random.default_rng(500 + seed)
        objective, true, start = seen_by(1 + seed % 3, rng, ("point", "rest", "fist")[seed // 8])
        starts = [start, *finger_bends(objective, [start], 12)]
        ends = [settled(objective, start) for start in starts]
        best, *_ = kept = objective.distinct(ends, 5)
        count = objective.independent_errors(best)
        share = shares(np.array([end.cost for end in kept]), count)[0]
        near = p_in_basin(objective.narrow_problem(best), best.params, count, SIZE_SIGMA)
        said.append(share * near)
        right.append(np.linalg.norm(best.joints - true, axis=1).mean() < BASIN_M)
    sure = np.array(said)
    spread = np.sqrt((sure * (1.0 - sure)).sum())
    assert abs(sure.sum() - np.sum(right)) < 3.0 * spread
    assert np.array(right)[sure > 0.9].mean() > 0.8
    assert np.array(right)[sure < 0.3].mean() < 0.5


def test_one_camera_cannot_tell_a_large_hand_from_a_near_one(rng):
    found = {}
    for cameras in (1, 3):
        objective, _, start = seen_by(cameras, rng, "open")
        there = settled(objective, start)
        problem = objective.narrow_problem(there)
        count = objective.independent_errors(there)
        found[cameras] = [
            p_in_basin(problem, there.params, count, sigma)
            for sigma in (SIZE_SIGMA, KNOWN_SIZE_SIGMA)
        ]
    assert found[1][0] < 0.5
    assert found[1][0] < found[1][1]
    assert found[3][0] > 0.9


def test_a_pointing_finger_is_found_among_bent_ones(rng):
    """Started as a fist that is rightly turned: the descent alone keeps the index bent."""
    objective, true, start = seen_by(3, rng, "point")
    joint = named_pose(MODEL, "fist")
    joint[:6] = MODEL.joint_params(start.params)[:6]
    fist = replace(start, params=MODEL.clipped(MODEL.transform.solver_params(joint)))
    (alone,) = wide(objective, [fist], 12)
    found = min(wide(objective, finger_bends(objective, [fist], 12), 12), key=lambda c: c.cost)
    index = [5, 6, 7, 8]
    off = [1e3 * np.linalg.norm(end.joints - true, axis=1)[index].mean() for end in (alone, found)]
    assert off[0] > 25.0 and off[1] < 12.0


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
    points, (field, low, spacing) = SHAPE.samples[0], SHAPE.field
    nodes = np.rint((points - low) / spacing).astype(int)
    assert field[tuple(nodes.T)].max() < spacing
    own = (points - SHAPE.middle) @ TRUE_TURN.T
    whole, half = (
        cloud_score(PLACES[0] + some, ()).scores(SHAPE, TURNS, PLACES)
        for some in (own, own[own[:, 1] > np.median(own[:, 1])])
    )
    for found in (whole, half):
        assert np.unravel_index(found.argmin(), found.shape) == (0, 0)
        assert found[:, 2] == pytest.approx(1.0)
        assert found[0, 1] > found[0, 0] + 0.05
    assert whole[0, 0] < 0.06
    assert half[0, 0] == pytest.approx(1 / 3, abs=0.08), "one half of one and a half"


def test_the_right_turn_and_place_score_best_in_silhouettes():
    start = silhouette_score(SEEN)
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


def test_the_hull_holds_the_hand_and_lies_in_every_mask():
    centres, inside = visual_hull(SEEN)
    nearest = np.linalg.norm(centres - JOINTS[:, None], axis=2).min(axis=1)
    assert nearest.max() < 0.01, "every joint is in it"
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
