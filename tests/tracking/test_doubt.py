"""How sure a frame is said to be: stated covariances, the probabilities of being off, and the status that follows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from handtrack.model.articulated import keypoint_names
from handtrack.model.model_file import load_model
from handtrack.observation.observation import ImageKeypoints
from handtrack.session.formats.tables import read_npz, write_npz
from handtrack.simulation.motion import motion
from handtrack.simulation.scenes.simulated_views import mask_views
from handtrack.simulation.simulate import simulated_rig
from handtrack.tracking.frame.assessment import what_is_open
from handtrack.tracking.frame.doubt.judgement import judged
from handtrack.tracking.frame.doubt.stated import curls, misfit, stated_covariance
from handtrack.tracking.frame.doubt.wrong import Signs, probably_beyond, probably_off
from handtrack.tracking.frame.frame_terms import frame_terms
from handtrack.tracking.frame.result import PARTS, Status
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.sequence import track_recording
from handtrack.tracking.tracker import Tracker
from tests.sample_track import sample_frame, stacked

HAND = load_model("hand26")
CHI2_90 = 6.251388631170325


def flat(total_m: float) -> np.ndarray:
    return np.tile(total_m**2 / 3 * np.eye(3), (len(HAND.joint_names), 1, 1))


@pytest.mark.parametrize("name", Signs.__dataclass_fields__)
def test_no_sign_makes_a_gross_error_less_probable(name):
    found = [
        probably_off(HAND, flat(0.003), Signs(**{name: size})) for size in (0.0, 0.5, 1.0, 2.0)
    ]
    assert (np.diff([off.frame for off in found]) >= 0).all()
    assert (np.diff([off.parts for off in found], axis=0) >= 0).all()


def test_the_less_sure_a_joint_the_more_probably_it_is_off():
    off = [probably_off(HAND, flat(s), Signs()) for s in (0.001, 0.01, 0.02, 0.05)]
    assert (np.diff([o.frame for o in off]) > 0).all()
    assert off[0].frame < 0.02
    assert off[-1].frame > 0.8
    wide = flat(0.002)
    wide[HAND.joint_names.index("ring_tip")] *= 100.0
    found = probably_off(HAND, wide, Signs())
    assert PARTS[int(np.argmax(found.parts))] == "ring"


def test_the_tail_is_a_normal_distribution_s(rng):
    """Of joints of which one direction is known less than the others, a hundred thousand drawn."""
    cov = flat(0.002)
    cov[5] = np.diag([0.015, 0.004, 0.002]) ** 2
    drawn = rng.multivariate_normal(np.zeros(3), cov[5], 100_000)
    true = (np.linalg.norm(drawn, axis=1) > 0.025).mean()
    found = probably_beyond(cov, 0.025).max()
    assert found == pytest.approx(true, abs=0.015)


def test_what_fits_badly_and_fingers_that_are_closed_are_known_less():
    joint, raw = HAND.rest.copy(), flat(0.002)
    fist = joint.copy()
    fist[["index" in n and "flex" in n for n in HAND.parameter_names]] = 1.3
    tip, wrist = HAND.joint_names.index("index_tip"), HAND.joint_names.index("wrist")
    straight, bent = curls(HAND, joint), curls(HAND, fist)
    good, bad = (stated_covariance(HAND, straight, raw, m, by_cloud=True) for m in (0.5, 2.0))
    closed = stated_covariance(HAND, bent, raw, 2.0, by_cloud=True)
    assert np.trace(good[tip]) < np.trace(bad[tip]) < np.trace(closed[tip])
    along = [np.trace(closed[HAND.joint_names.index(f"index_{j}")]) for j in ("mcp", "pip", "dip", "tip")]  # fmt: skip
    assert (np.diff(along) > 0).all(), "hidden bends add up towards the tip"
    still = HAND.joint_names.index("middle_pip")
    assert np.trace(bad[wrist]) < np.trace(closed[wrist]) < 1.5 * np.trace(bad[wrist])
    assert np.trace(closed[still]) < np.trace(closed[tip])
    assert bent[1] > 0.9 > bent[2]
    assert misfit({"coverage": 60.0, "rest": 500.0}, 2) == pytest.approx(2.0)
    assert misfit({"keypoints": 60.0}, 2) == 1.0


def test_the_own_hand_s_stated_90_percent_hold(rng):
    """Exact masks of the very model: what is stated of a closing hand is not too little, and an open one is not called doubtful."""
    joint = motion(HAND, "open_fist_open", 48, rng)[6:24:3]
    rig = list(simulated_rig(3, (320, 240), 0.4))
    poses = np.array([HAND.transform.solver_params(j) for j in joint])
    seen = [
        replace(mask_views(HAND, pose, rig), frame=n, time_s=n / 25) for n, pose in enumerate(poses)
    ]
    tracked = track_recording(Tracker(HAND), lambda f, *_: seen[f], 0, poses[0], range(len(joint)))
    last = {result.frame: result for result in tracked}
    assert [last[n].status for n in (0, 1, 2)] == [Status.TRACKED] * 3
    inside = []
    for n, pose in enumerate(poses):
        off = last[n].joint_positions - HAND.joint_positions(HAND.bones(pose))
        stated = np.linalg.solve(last[n].joint_covariance, off[..., None])[..., 0]
        inside.append((off * stated).sum(axis=1) < CHI2_90)
    assert np.mean(inside) > 0.85
    assert all(0 <= r.p_off_25mm <= 1 and r.p_off_10mm.shape == (6,) for r in last.values())


def test_a_live_frame_is_no_surer_for_what_nobody_knows_yet(rng):
    """Frames after have yet to move it: it counts as moved as far as most are, neither not at all nor far."""
    pose = HAND.transform.solver_params(motion(HAND, "open_fist_open", 8, rng)[0])
    seen = mask_views(HAND, pose, list(simulated_rig(2, (160, 120), 0.4)))
    terms = frame_terms(HAND, TrackerSettings(), seen, HAND.bones(pose), None)
    energies = {"coverage": 10.0}
    off = [
        judged(terms, pose, 10.0, energies, flat(0.003), (), moved_m).p_off_25mm
        for moved_m in (0.0, None, 0.05)
    ]
    assert (np.diff(off) > 0).all()


def test_detected_joints_that_agree_lower_the_doubt_of_a_closed_hand(rng):
    """Of two cameras; where they see them elsewhere they confirm nothing."""
    pose = HAND.transform.solver_params(motion(HAND, "open_fist_open", 8, rng)[4])
    rig = list(simulated_rig(2, (160, 120), 0.4))
    seen, bones = mask_views(HAND, pose, rig), HAND.bones(pose)
    places = HAND.joint_positions(bones)[[HAND.joint_names.index(n) for n in keypoint_names()]]

    def doubt(off_px: float | None) -> tuple[float, float]:
        joints = () if off_px is None else tuple(
            ImageKeypoints(c, keypoint_names(), c.project(places) + off_px, 2.0) for c in rig
        )  # fmt: skip
        terms = frame_terms(HAND, TrackerSettings(), replace(seen, keypoints=joints), bones, None)
        found = judged(terms, pose, 10.0, {"coverage": 10.0}, flat(0.003), (), 0.0)
        return found.p_off_25mm, float(np.trace(found.joint_covariance, axis1=1, axis2=2).max())

    agreeing, alone, elsewhere = doubt(0.0), doubt(None), doubt(30.0)
    assert agreeing[0] < 0.8 * alone[0]
    assert agreeing[1] < 0.8 * alone[1]
    assert elsewhere == alone


def test_probabilities_are_kept_in_poses_npz(rng, tmp_path):
    told = replace(sample_frame(rng, 3), p_off_25mm=0.2, p_off_10mm=np.linspace(0, 0.5, 6))
    track = stacked([told, sample_frame(rng, 4)])
    write_npz(tmp_path / "poses.npz", track)
    arrays = np.load(tmp_path / "poses.npz")
    assert arrays["part_names"].tolist() == ["palm", "thumb", "index", "middle", "ring", "little"]
    np.testing.assert_array_equal(arrays["p_off_25mm"], [0.2, np.nan])
    back = read_npz(tmp_path / "poses.npz")
    assert back.at(3).p_off_25mm == 0.2
    np.testing.assert_array_equal(back.at(3).p_off_10mm, told.p_off_10mm)
    assert back.at(4).p_off_10mm is None


def test_a_body_whose_joints_are_15_cm_open_is_doubtful():
    """As before one camera: stated 15 to 20 cm, it was called tracked."""
    body = load_model("body34")
    wide = np.tile(0.18**2 / 3 * np.eye(3), (len(body.joint_names), 1, 1))
    reason = what_is_open(body, wide, 15.0)
    assert reason is not None
    assert reason.words == "what was seen leaves the whole body open: ± 180 mm"
    assert what_is_open(body, wide / 4, 15.0) is None


def test_what_was_not_seen_is_no_surer_for_little_noise():
    """Clouds that fit better than their noise say so of what they show, not of a finger behind the hand."""
    straight = curls(HAND, HAND.joint_params(HAND.rest_params()))
    known, hidden = 0.002**2, 0.02**2
    covariance = np.tile(np.diag([known, known, hidden]), (len(HAND.joint_names), 1, 1))
    stated = stated_covariance(HAND, straight, covariance, 0.3, by_cloud=True)
    wrist = HAND.joint_names.index("wrist")
    assert stated[wrist, 2, 2] > 0.9 * hidden
    assert stated[wrist, 0, 0] < 0.7 * known
