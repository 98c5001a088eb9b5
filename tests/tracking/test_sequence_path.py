"""After tracking: the line that led to the end, and how it is smoothed."""

from dataclasses import replace

import numpy as np
import pytest

from handtrack.geometry.rotation import rotation_matrix, rotation_vector
from handtrack.model.model_file import load_model
from handtrack.solver.problem import Problem
from handtrack.terms.bone_system import JointSystem
from handtrack.terms.priors.priors import GaussianPrior
from handtrack.tracking.frame.result import Alternative, FrameResult, Status
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.hypotheses.motion_belief import MotionBelief
from handtrack.tracking.hypotheses.moving_hypothesis import MovingHypothesis, with_wrapped_turn
from handtrack.tracking.hypotheses.sequence_path import chosen_sequence, lineage, smoothed

MODEL = load_model("ball6")
PUSH = np.full(6, 0.01)


def _hypothesis(params, weight=1.0, sigma=0.05, origin="followed"):
    """A hypothesis whose frame saw exactly its pose, with a standard deviation."""
    params = np.asarray(params, dtype=float)
    seen = JointSystem(0.0, np.zeros(6), np.eye(6) / sigma**2)
    belief = MotionBelief.at_rest(params, sigma**2 * np.eye(6), PUSH)
    return MovingHypothesis(params, 0.0, sigma**2 * np.eye(6), weight, origin, belief, seen)


def _frame(number, hypotheses, parents):
    """Return a frame's result and the hypotheses that are carried on from it."""
    best = hypotheses[0].params if hypotheses else np.zeros(6)
    bones = MODEL.bones(best)
    places = MODEL.joint_positions(bones)
    rows = zip(hypotheses, parents, strict=True)
    alternatives = tuple(Alternative(h.params, h.cost, h.weight, p, h.origin) for h, p in rows)
    result = FrameResult(
        number, number / 25.0, best, Status.TRACKED, 1.0, 1, np.zeros(6), np.zeros((len(places), 3, 3)),
        bones.T_world_bone, places, None, alternatives=alternatives,
    )  # fmt: skip
    return result, tuple(hypotheses)


def _at(x):
    return [x, 0, 0, 0, 0, 0]


def test_the_line_that_led_to_the_end_is_chosen():
    frames = [
        _frame(0, [_hypothesis(_at(0.0)), _hypothesis(_at(1.0))], (-1, -1)),
        _frame(1, [_hypothesis(_at(0.1)), _hypothesis(_at(1.1))], (0, 1)),
        _frame(2, [_hypothesis(_at(1.2)), _hypothesis(_at(0.2))], (1, 0)),
    ]
    assert [h.params[0] for h in lineage(frames)] == [1.0, 1.1, 1.2]
    settings = TrackerSettings().with_values({"mixture.sequence": "path"})
    done = chosen_sequence(MODEL, settings, frames)
    assert [r.frame for r in done] == [0, 1, 2]
    assert [r.parameters[0] for r in done] == [1.0, 1.1, 1.2]
    np.testing.assert_allclose(
        done[0].joint_positions[0], MODEL.bones(np.array(_at(1.0))).position[0]
    )
    best = chosen_sequence(MODEL, TrackerSettings(), frames)
    assert [r.parameters[0] for r in best] == [0.0, 0.1, 1.2]


def test_frames_before_the_first_pose_are_a_line_of_their_own():
    """Backward, the order of tracking is that of falling numbers: parents are of the frame after."""
    frames = [
        _frame(2, [_hypothesis(_at(5.2)), _hypothesis(_at(6.2))], (-1, -1)),
        _frame(1, [_hypothesis(_at(5.1)), _hypothesis(_at(6.1))], (0, 1)),
        _frame(0, [_hypothesis(_at(5.0)), _hypothesis(_at(6.0))], (1, 0)),
    ]
    settings = TrackerSettings().with_values({"mixture.sequence": "path"})
    done = chosen_sequence(MODEL, settings, frames)
    assert [r.frame for r in done] == [2, 1, 0]
    assert [r.parameters[0] for r in done] == [6.2, 6.1, 5.0]


def test_results_without_hypotheses_stay_as_they_are():
    frames = [_frame(0, [], ()), _frame(1, [], ())]
    settings = TrackerSettings().with_values({"mixture.sequence": "smooth"})
    assert chosen_sequence(MODEL, settings, frames) == [result for result, _ in frames]


def test_smoothing_takes_noise_and_leaves_steady_motion(rng):
    count = 40
    true = np.zeros((count, 6))
    true[:, 0] = 0.02 * np.arange(count)
    true[:, 4] = 0.05 * np.arange(count)  # a steady turn about one axis
    steady = [_hypothesis(row) for row in true]
    frames = np.arange(count)
    np.testing.assert_allclose(smoothed(MODEL, steady, frames, PUSH), true, atol=1e-7)
    noisy = [_hypothesis(row + 0.05 * rng.normal(size=6)) for row in true]
    moved = smoothed(MODEL, noisy, frames, PUSH)
    off = np.abs(np.array([h.params for h in noisy]) - true)[:, :3].mean()
    assert np.abs(moved - true)[:, :3].mean() < 0.6 * off


def test_smoothing_is_the_least_squares_solution(rng):
    """Translations only: the same as a dense linear system set up by hand."""
    count, sigma = 7, 0.05
    rows = np.zeros((count, 6))
    rows[:, :3] = rng.normal(scale=0.1, size=(count, 3))
    moved = smoothed(MODEL, [_hypothesis(r, sigma=sigma) for r in rows], np.arange(count), PUSH)
    bend = np.zeros((count - 2, count))
    for n in range(count - 2):
        bend[n, n : n + 3] = 1.0, -2.0, 1.0
    normal = np.eye(count) / sigma**2 + bend.T @ bend / PUSH[0] ** 2
    expected = np.linalg.solve(normal, rows[:, :3] / sigma**2)
    np.testing.assert_allclose(moved[:, :3], expected, atol=1e-7)


@pytest.mark.parametrize("origin", ["left_arm jumped", "followed"])
def test_nothing_is_smoothed_across_a_jump(origin):
    rows = [_hypothesis(_at(0.0)) for _ in range(4)]
    rows += [_hypothesis(_at(1.0), origin=origin)] + [_hypothesis(_at(1.0)) for _ in range(3)]
    moved = smoothed(MODEL, rows, np.arange(8), PUSH)[:, 0]
    stays = np.allclose(moved, [0, 0, 0, 0, 1, 1, 1, 1], atol=1e-6)
    assert stays == (origin != "followed")


def test_a_turn_beyond_half_is_the_same_hypothesis_written_shorter(rng):
    """Place, spread, motion and what was seen are carried over to the other rotation vector."""
    long = np.array([0.1, 0.2, 0.3, 0.4, 3.6, -0.3])
    prior = GaussianPrior(np.zeros(6), np.full(6, 0.7))
    problem = Problem(MODEL, [], [prior])
    belief = MotionBelief(long, rng.normal(scale=0.01, size=6), 1e-4 * np.eye(12))
    before = replace(_hypothesis(long), belief=belief, seen=problem.linearize(long))
    after = with_wrapped_turn(before)
    assert np.linalg.norm(after.params[3:6]) <= np.pi
    np.testing.assert_allclose(
        rotation_matrix(after.params[3:6]), rotation_matrix(long[3:6]), atol=1e-12
    )
    # one frame on, both are at the same attitude, to first order in the motion
    moved = [rotation_matrix((b.mean + b.velocity)[3:6]) for b in (before.belief, after.belief)]
    assert np.linalg.norm(rotation_vector(moved[0] @ moved[1].T)) < 1e-3
    assert np.linalg.norm(after.belief.velocity[3:6]) > 1e-3
    assert after.seen.cost == before.seen.cost
    # the gradient still tells how the cost changes
    step = np.array([0.0, 0.0, 0.0, 1e-5, -2e-5, 1e-5])
    there = rotation_matrix(after.params[3:6] + step[3:6])
    near = long.copy()
    near[3:6] = rotation_vector(there)
    near[3:6] *= 1 - 2 * np.pi / np.linalg.norm(near[3:6])
    change = problem.cost(near) - problem.cost(long)
    assert change == pytest.approx(float(after.seen.gradient @ step), rel=1e-3)
