"""Several ways through a recording: which is the most probable, what the others are, and that a wrong frame is left."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from handtrack import Observation, Status, TrackerSettings, load_model
from handtrack.model.pose_changes import changes
from handtrack.simulation.scenes.simulated_views import mask_views
from handtrack.simulation.simulate import simulated_rig
from handtrack.terms.term import JointSystem
from handtrack.tracking.frame.confidence import ELSEWHERE
from handtrack.tracking.frame.frame_task import posed_result
from handtrack.tracking.frame.result import Alternative
from handtrack.tracking.whole.alternatives import with_alternatives
from handtrack.tracking.whole.likelihood import Recording
from handtrack.tracking.whole.mode_search import Minimum, Trellis
from handtrack.tracking.whole.recording_estimate import refine
from tests.tracking.scenes import bent, off_mm, posed

HAND = load_model()
CAMERAS = simulated_rig(2, (320, 240)).cameras
FRAMES, WRONG = 7, 3
CHANGE = np.diag(np.full(7, 0.1**2))


def _at(pose, cost, sure):
    return Minimum(pose, lambda there: JointSystem(cost, np.zeros(len(there)), sure), "tried")


@pytest.mark.parametrize("share", [1.0, 0.1])
def test_probabilities_are_those_of_all_ways_together(rng, share):
    counts = (2, 3, 1, 2)
    rows = [
        [_at(np.full(7, 0.1 * rng.normal()), 2.0 * rng.uniform(), 10 ** rng.uniform(1, 4) * np.eye(7)) for _ in range(n)]
        for n in counts
    ]  # fmt: skip
    trellis = Trellis(rows, CHANGE, share)

    def log_mass(way, joined):
        chosen = [row[k] for row, k in zip(rows, way, strict=True)]
        spreads = [np.linalg.inv(share * m.system.hessian + np.linalg.inv(CHANGE)) for m in chosen]
        total = sum(-share * m.system.cost + 0.5 * np.linalg.slogdet(c)[1] for m, c in zip(chosen, spreads, strict=True))  # fmt: skip
        for n in range(len(chosen) - 1):
            step = changes(np.array([chosen[n].pose, chosen[n + 1].pose]))[0]
            wide = CHANGE + spreads[n] + spreads[n + 1]
            off = 0.5 * step @ np.linalg.solve(wide, step) + 0.5 * np.linalg.slogdet(wide)[1]
            total -= joined * off
        return total

    ways = list(product(*map(range, counts)))
    assert tuple(trellis.best) == max(ways, key=lambda way: log_mass(way, 1.0))
    mass = np.exp([log_mass(way, share) for way in ways])
    for n, found in enumerate(trellis.probabilities):
        there = [mass[[way[n] == k for way in ways]].sum() for k in range(counts[n])]
        assert_allclose(found, np.array(there) / mass.sum(), rtol=1e-6)


@pytest.fixture(scope="module")
def turning():
    """A hand that turns a little: its poses, and what is seen."""
    poses = np.tile(posed(HAND, "rest"), (FRAMES, 1))
    poses[:, 4] += np.linspace(0.0, 0.15, FRAMES)
    views = [mask_views(HAND, pose, CAMERAS) for pose in poses]
    return poses, [Observation(n, n / 25.0, seen.silhouettes) for n, seen in enumerate(views)]


def _tracked(poses, views):
    return [
        replace(posed_result(HAND, seen, pose), energy=30.0, views=2)
        for pose, seen in zip(poses, views, strict=True)
    ]


def _off_mm(result, pose):
    return off_mm(result, HAND, pose).max()


def test_a_finger_that_one_frame_has_wrong_goes_with_those_beside_it(turning):
    """Its minimum is one: descent alone does not lead out of it."""
    poses, views = turning
    taken = poses.copy()
    taken[WRONG] = bent(HAND, poses[WRONG], "index", 100.0)
    found = refine(
        Recording(HAND, TrackerSettings(), lambda n, _: views[n]), _tracked(taken, views)
    )
    assert _off_mm(_tracked(taken, views)[WRONG], poses[WRONG]) > 40.0
    assert max(map(_off_mm, found, poses)) < 2.0  # measured 0.6; 116 with one minimum a frame


def test_a_hand_thrown_away_while_one_camera_sees_it_comes_back(turning):
    """Depth is what one view cannot tell: half of the recording a finger's breadth away, and turned."""
    poses, views = turning
    seen = [replace(v, silhouettes=v.silhouettes[: 1 if n < 4 else 2]) for n, v in enumerate(views)]
    taken = poses.copy()
    taken[1:4, :3] += 0.04 * CAMERAS[0].rotation[2]
    taken[1:4, 3] += 0.3
    found = refine(Recording(HAND, TrackerSettings(), lambda n, _: seen[n]), _tracked(taken, seen))
    assert max(map(_off_mm, found, poses)) < 4.0  # measured 1.3; 11 with one minimum a frame


def test_other_ways_stay_with_the_frame_and_are_a_doubt_where_they_are_elsewhere():
    pose, sure = HAND.rest_params(), 1e4 * np.eye(26)
    near, far = pose + 0.002 * (np.arange(26) == 0), bent(HAND, pose, "index", 90.0)
    rows = [[_at(pose, 5.0, sure)] + [_at(x, 5.5, sure) for x in others] for others in ((), (near,), (far,))]  # fmt: skip
    known = np.tile(1e-6 * np.eye(3), (len(HAND.joint_names), 1, 1))
    result = posed_result(HAND, Observation(0, 0.0), pose)
    told = {"p_off_25mm": 0.18, "p_off_10mm": np.full(6, 0.02)}
    results = [replace(result, joint_covariance=known, **told)] * 3
    alone, two, apart = with_alternatives(HAND, results, Trellis(rows, 100.0 * np.eye(26), 1.0))
    assert [len(r.alternatives) for r in (alone, two, apart)] == [0, 2, 2]
    assert alone.status == two.status == Status.TRACKED
    held, other = apart.alternatives
    assert held.weight + other.weight == pytest.approx(1.0)
    assert other.weight == pytest.approx(np.exp(-0.5) / (1 + np.exp(-0.5)), abs=0.01)
    assert apart.status == Status.DOUBTFUL
    assert apart.reason.part == "index tip"
    assert alone.p_off_25mm == 0.18
    assert two.p_off_25mm == pytest.approx(0.18)
    odds = (999.0 * other.weight / held.weight) ** ELSEWHERE / 49.0
    assert apart.p_off_25mm > 0.2
    assert_allclose(apart.p_off_10mm, np.where(np.arange(6) == 2, odds / (1.0 + odds), 0.02))
    tip, wrist = HAND.joint_names.index("index_tip"), HAND.joint_names.index("wrist")
    off = HAND.joint_positions(HAND.bones(far))[tip] - apart.joint_positions[tip]
    added = other.weight * np.outer(off, off)
    assert_allclose(apart.joint_covariance[tip], known[tip] + added, rtol=0.02)
    assert_array_equal(apart.joint_covariance[wrist], known[wrist])


def test_hypotheses_that_were_carried_are_candidates(turning):
    """Nothing jumps and nothing is in doubt: no way is looked for, but one is known."""
    poses, views = turning
    taken = np.array([bent(HAND, pose, "index", 100.0) for pose in poses])
    tracked = [
        replace(
            result,
            alternatives=tuple(
                Alternative(HAND.joint_params(pose), 30.0, 0.5, -1, "followed") for pose in pair
            ),
        )
        for result, pair in zip(_tracked(taken, views), zip(taken, poses, strict=True), strict=True)
    ]
    settings = TrackerSettings().with_values({"tracker.hypotheses": 2, "tracker.estimate": "whole"})
    assert settings.refines
    found = refine(Recording(HAND, settings, lambda n, _: views[n]), tracked)
    assert max(map(_off_mm, found, poses)) < 2.0
    assert {len(result.alternatives) for result in found} == {2}
