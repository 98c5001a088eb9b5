"""Measures with known answers."""

import json
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from handtrack import Status, evaluate, load_model
from handtrack.diagnostics.metrics import BENT_JOINTS, flexion_deg, flexion_errors
from handtrack.geometry.rotation import rotation_matrix
from handtrack.model.articulated import keypoint_names
from handtrack.model.model_file import scale_table
from handtrack.session.truth import Truth
from tests.export.sequences import sample_sequence
from tests.sample_track import sample_frame, sample_track, stacked


def of_points(frame, points):
    return Truth(frame, None, points, (), None)


def truth_of(track, offset=(0.0, 0.0, 0.0)):
    return of_points(track.frame.copy(), track.keypoints21 + np.asarray(offset))


def moved(track, points):
    return replace(track, keypoints21=points, joint_positions=points.copy())


def test_a_perfect_track(rng):
    track = sample_track(rng)
    turned = 1.7 * track.keypoints21 @ rotation_matrix(np.array([0.3, -2.0, 1.0])).T + [1, 2, 3]
    found = evaluate(track, of_points(track.frame, turned))
    assert found["pa_mpjpe_mm"] == pytest.approx(0, abs=1e-9)
    found = evaluate(track, truth_of(track))
    assert found["pck_auc_50mm"] == found["coverage90"] == 1
    assert not any(found[name] for name in ("mpjpe_mm", "max_mm", "fingertip_mm", "lost_frames"))


def test_a_hinge_that_is_bent_more_by_an_angle_is_off_by_that_angle():
    hand = load_model("hand26")
    pip = hand.params_from({"index_pip_flex": 0.3})
    more = hand.params_from({"index_pip_flex": 0.5})
    points = np.array([hand.keypoints21(hand.bones(pose)) for pose in (pip, more)])
    off = dict(zip(BENT_JOINTS, np.diff(flexion_deg(points), axis=0)[0], strict=True))
    assert off.pop("index_pip") == pytest.approx(np.rad2deg(0.2), abs=0.2)
    assert max(map(abs, off.values())) < 1e-6


def test_wrong_frames_are_so_beside_constant_offsets_and_counted_with_their_confidence(rng):
    """Another definition of a knuckle, 40 mm away, is no error; a tip that is so in two frames is, and one of them says so."""
    first = sample_frame(rng, 0)
    assert first.keypoints21 is not None
    truth = np.tile(first.keypoints21, (9, 1, 1))
    frames = []
    for n, points in enumerate(truth.copy()):
        points[5] += 0.04
        points[20] += 0.04 if n in (3, 4) else 0.0
        status = Status.DOUBTFUL if n in (4, 7) else Status.TRACKED
        frames.append(replace(first, frame=n, keypoints21=points, status=status))
    found = evaluate(stacked(frames), of_points(np.arange(9), truth))
    assert found["wrong_frames"] == 2
    assert found["low_confidence_frames"] == 2
    assert found["wrong_low_confidence_frames"] == 1


def test_marks_lie_on_the_skin_and_mean_landmarks_are_as_uncertain_as_people_differ():
    model, track = sample_sequence("left")
    marks = track.in_landmarks("surface21")
    posed = model.ellipsoids["fine"].posed(model.bones(track.parameters[0]))
    for k, bone in enumerate(model.joint_bone):
        own = posed.subset(posed.bone == bone)
        point, joint = marks.joint_positions[0, k], track.joint_positions[0, k]
        local = np.einsum("eji,ej->ei", own.rotation, point - own.centre) / own.radii
        if not model.joint_names[k].endswith("_tip"):
            assert (local**2).sum(axis=1).min() == pytest.approx(1.0)
        assert (point - joint) @ track.T_world_bone[0, bone, :3, 2] >= 0
    mean = track.in_landmarks("mediapipe21")
    assert mean.keypoint_definition == track.landmark_definition == "mediapipe21 (mean)"
    sigma = model.landmark_definitions[mean.keypoint_definition].sigma_m
    more = mean.joint_covariance - track.joint_covariance
    assert_allclose(more[0], sigma[:, None, None] ** 2 * np.eye(3), atol=1e-12)
    truth = replace(of_points(track.frame, mean.keypoints21), keypoint_definition="mediapipe21")
    assert evaluate(marks, truth)["mpjpe_mm"] == pytest.approx(0.0, abs=1e-9)


def test_constant_offsets_come_from_the_other_half_of_the_frames():
    """The truth's knuckle is 8 mm beside ours in its bone's frame; from the middle on its wrist is 5 mm elsewhere, too."""
    model, track = sample_sequence("right")
    seen = replace(model.scale, offsets_mm={"index_mcp": (0.0, 0.0, 8.0 / model.scale.overall)})
    theirs = replace(track, scale=json.dumps(scale_table(seen))).landmarks
    found = evaluate(track, of_points(track.frame, theirs))
    assert found["position_index_mcp_mm"] == pytest.approx(8.0)
    assert found["mpjpe_mm"] == pytest.approx(8.0 / 21)
    assert found["offset_free_mm"] == pytest.approx(0.0, abs=1e-9)
    later = theirs.copy()
    later[len(later) // 2 :, 0] = np.nan
    assert evaluate(track, of_points(track.frame, later))["position_wrist_offset_free_mm"] is None
    root = track.T_world_bone[len(later) // 2 :, 0, :3, :3]
    later[len(later) // 2 :, 0] = theirs[len(later) // 2 :, 0] + 0.005 * root[:, :, 1]
    found = evaluate(track, of_points(track.frame, later))
    assert found["position_wrist_mm"] == pytest.approx(2.5)
    assert found["position_wrist_offset_free_mm"] == pytest.approx(5.0)
    assert found["offset_free_mm"] == pytest.approx(5.0 / 21)


def test_angles_of_another_definition_are_off_by_what_the_other_half_says():
    """Bent by 0.1 rad more throughout, and by 0.2 more in the second half: each half knows the other's offset only."""
    hand = load_model("hand26")
    bends = np.linspace(0.3, 1.1, 6)
    more = bends + np.where(np.arange(6) < 3, 0.1, 0.3)
    points, true = (
        np.array([hand.keypoints21(hand.bones(hand.params_from({"index_pip_flex": b}))) for b in some])
        for some in (bends, more)
    )  # fmt: skip
    found = flexion_errors(points, true)
    assert found["flexion_index_pip_deg"] == pytest.approx(np.rad2deg(0.2), abs=0.3)
    assert found["flexion_index_pip_offset_free_deg"] == pytest.approx(np.rad2deg(0.2), abs=0.3)
    constant = flexion_errors(points[:3], true[:3])
    assert constant["flexion_index_pip_deg"] == pytest.approx(np.rad2deg(0.1), abs=0.3)
    assert constant["flexion_index_pip_offset_free_deg"] == pytest.approx(0.0, abs=0.3)


def test_a_tip_on_another_fingers_true_tip_is_a_swap(rng):
    track = sample_track(rng)
    assert evaluate(track, truth_of(track))["finger_swaps"] == 0
    names = keypoint_names()
    points = track.keypoints21.copy()
    index, middle = names.index("index_tip"), names.index("middle_tip")
    points[2, [index, middle]] = points[2, [middle, index]]
    points[3, index] = 0.6 * points[3, middle] + 0.4 * points[3, index]
    assert evaluate(moved(track, points), truth_of(track))["finger_swaps"] == 3
    truth = truth_of(track)
    truth.keypoints21[:, middle] = np.nan  # nobody can say
    assert evaluate(moved(track, points), truth)["finger_swaps"] <= 1


def test_a_lost_frame_counts_with_the_estimate_it_holds(rng):
    track = sample_track(rng, range(3))
    track.status[1] = Status.LOST
    for points in (track.keypoints21, track.joint_positions):
        points[1] = points[0]
    truth = truth_of(track)
    truth.keypoints21[1, :, 0] += 0.03
    found = evaluate(track, truth)
    assert found["lost_frames"] == 1
    assert found["mpjpe_mm"] == pytest.approx(10)
    assert found["mpjpe_tracked_mm"] == 0


def test_unknown_truth_points_do_not_count(rng):
    track = sample_track(rng)
    truth = truth_of(track, (0.001, 0, 0))
    truth.keypoints21[:, 5, 1] = np.nan
    truth.keypoints21[2] = np.nan
    found = evaluate(track, truth)
    assert found["mpjpe_mm"] == pytest.approx(1.0)
    assert found["pa_mpjpe_mm"] == pytest.approx(0, abs=1e-9)
    used = [found[f"used_{name}"] for name in keypoint_names()]
    assert used == [4 * (n != 5) for n in range(21)]
    counts = found["frames_used"], found["points_used"], found["points_unknown"]
    assert counts == (4, 80, 4)


def test_joints_of_equal_name_are_compared(rng):
    track = sample_track(rng)
    names = ("little_tip", "elbow", "wrist")
    joints = np.stack(
        [
            track.joint_positions[:, 20],
            np.zeros((5, 3)),
            track.joint_positions[:, 0] + [0, 0.01, 0],
        ],
        axis=1,
    )
    found = evaluate(track, Truth(track.frame, None, None, names, joints))
    assert found["mpjpe_mm"] == pytest.approx(5.0)
    assert found["fingertip_mm"] == pytest.approx(0.0)
    assert found["pa_mpjpe_mm"] is None  # two points fit any two


def test_jitter_is_the_second_difference(rng):
    track = sample_track(rng, range(9))
    start, speed = rng.normal(size=(21, 3)), rng.normal(size=(21, 3))
    steady = start + speed * np.arange(9)[:, None, None]
    assert evaluate(moved(track, steady), truth_of(track))["jitter_mm"] == pytest.approx(
        0, abs=1e-9
    )
    bent = steady + 0.0005 * np.array([1.0, 0, 0]) * (np.arange(9)[:, None, None] ** 2)
    assert evaluate(moved(track, bent), truth_of(track))["jitter_mm"] == pytest.approx(1.0)


def test_coverage_of_errors_that_follow_their_covariance(rng):
    track = sample_track(rng, range(200))
    root = rng.normal(size=(200, 21, 3, 3)) * 0.004
    spread = root @ np.swapaxes(root, 2, 3)
    error = np.einsum("fjab,fjb->fja", root, rng.normal(size=(200, 21, 3)))
    honest = replace(track, joint_covariance=spread)
    truth = of_points(track.frame, track.keypoints21 + error)
    assert evaluate(honest, truth)["coverage90"] == pytest.approx(0.9, abs=0.015)
    boasting = replace(track, joint_covariance=spread / 9)
    assert evaluate(boasting, truth)["coverage90"] < 0.5
