"""Constant velocity from the last two frames with a pose, if they are neither too far apart nor too long ago."""

from types import SimpleNamespace

import numpy as np
import pytest

from handtrack import Keypoints, Observation, Status, Tracker, TrackerSettings, load_model
from handtrack.geometry.rotation import rotation_matrix, rotation_vector
from handtrack.tracking.frame.frame_task import predict
from handtrack.tracking.frame.terms.priors import motion_prior
from handtrack.tracking.sequence import track_frames

MODEL = load_model()


def frame(number, params, status=Status.TRACKED):
    return SimpleNamespace(frame=number, parameters=params, status=status)


def test_a_turn_goes_on_across_half_a_turn():
    """Rotation vectors jump at π; turns do not."""
    axis = np.array([0.0, 0.0, 1.0])
    a, b = np.zeros(26), np.zeros(26)
    a[3:6], b[3:6] = axis * (np.pi - 0.05), -axis * (np.pi - 0.05)
    turned = rotation_matrix(predict(MODEL, [frame(0, a), frame(1, b)], 2)[3:6])
    wanted = rotation_matrix(axis * (np.pi + 0.15))
    assert np.linalg.norm(rotation_vector(turned @ wanted.T)) < 1e-9


def test_a_prediction_stays_within_limits():
    a, b = np.zeros(26), np.zeros(26)
    flex = MODEL.skeleton.parameter("index_pip_flex")
    a[flex], b[flex] = 0.5, 1.5
    assert predict(MODEL, [frame(0, a), frame(1, b)], 2)[flex] <= MODEL.limits.interval[flex, 1]


def test_more_smoothing_pulls_more_and_a_longer_gap_less():
    """A displacement costs in proportion to `tracker.smoothing`, and inversely to the frames since the last one."""
    expected = MODEL.rest_params()
    moved, settings = expected + 0.01, TrackerSettings().prior

    def cost(smoothing, ahead):
        return motion_prior(expected, settings, smoothing, ahead).cost(moved)

    once = cost(1.0, 1)
    assert [cost(4.0, 1), cost(1.0, 4), cost(2.0, 2)] == pytest.approx([4 * once, once / 4, once])


def test_the_longer_a_finger_is_hidden_the_less_is_known_of_it():
    """It is as if each frame were sure of the one before, otherwise: hidden for a second or for one frame, all the same."""
    pose = MODEL.rest_params()
    points = MODEL.joint_positions(MODEL.bones(pose))
    hidden = [n.startswith("index") and n != "index_mcp" for n in MODEL.joint_names]

    def observe(frame, _bones):
        seen = np.where(np.array(hidden)[:, None] & (0 < frame < 8), np.nan, points)
        return Observation(frame, frame / 30.0, (), (Keypoints(MODEL.joint_names, seen, 0.002),))

    tracker = Tracker(MODEL, TrackerSettings().with_values({"tracker.recovery": False}))
    results = list(track_frames(tracker, observe, 0, pose, range(9)))
    tip, wrist = (MODEL.joint_names.index(name) for name in ("index_tip", "wrist"))
    std = np.sqrt([np.trace(r.joint_covariance[[tip, wrist]], axis1=1, axis2=2) for r in results])
    assert (np.diff(std[:8, 0]) > 0).all()
    assert std[7, 0] > 1.3 * std[1, 0]
    assert std[8, 0] < 1.01 * std[0, 0]  # seen again
    assert std[:, 1].max() < 1.01 * std[0, 1]  # the wrist was never hidden


T, D, L = Status.TRACKED, Status.DOUBTFUL, Status.LOST


@pytest.mark.parametrize(
    ("frames", "at", "expected"),
    [
        ({0: T, 1: T}, 2, 2.0),
        ({0: T, 4: T}, 8, 2.0),  # both spans at their longest
        ({0: T, 4: T}, 5, 1.25),
        ({0: T, 5: T}, 6, 1.0),  # too far apart: the hand stays where it was
        ({0: T, 1: T}, 6, 1.0),  # too long ago
        ({8: T, 4: T}, 0, 2.0),  # backward in time
        ({9: T, 4: T}, 3, 1.0),
        ({0: T, 2: T}, 1, 1.0),  # between both: they were not tracked in this direction
        ({0: T, 1: T, 2: T, 3: L}, 4, 4.0),  # from frame 2 on, by a step a frame
        ({0: L, 1: T}, 2, 1.0),
        ({0: D, 1: D}, 2, 2.0),
    ],
)
def test_a_motion_goes_on_for_four_frames_and_no_longer(frames, at, expected):
    """The wrist has moved by one step (x, 12 mm) between each two of these frames."""
    steps = 0.012 * np.eye(26)[0] * np.arange(len(frames))[:, None]
    previous = [
        frame(n, step, status) for (n, status), step in zip(frames.items(), steps, strict=True)
    ]
    assert predict(MODEL, previous, at)[0] / 0.012 == pytest.approx(expected)
