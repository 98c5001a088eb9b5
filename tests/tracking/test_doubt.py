"""How sure a frame is said to be: stated covariances, the probabilities of being off, and the status that follows."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from handtrack import Observation, Status, Tracker, TrackerSettings, load_model
from handtrack.simulation.motion import motion
from handtrack.simulation.scenes.simulated_views import mask_views
from handtrack.simulation.simulate import simulated_rig
from handtrack.tracking.frame.confidence import (
    CLOUD,
    calibrated_covariance,
    curls,
    failure_probabilities,
    frame_confidence,
    probably_beyond,
)
from handtrack.tracking.frame.frame_task import posed_result
from handtrack.tracking.frame.frame_terms import frame_terms
from handtrack.tracking.search.frame_solve import free_sign
from handtrack.tracking.sequence import track_recording
from tests.tracking.scenes import inside_stated, joints_seen

HAND = load_model("hand26")


def flat(total_m):
    return np.tile(total_m**2 / 3 * np.eye(3), (len(HAND.joint_names), 1, 1))


def test_the_tail_is_a_normal_distribution_s(rng):
    """Of joints of which one direction is known less than the others, a hundred thousand drawn."""
    cov = flat(0.002)
    cov[5] = np.diag([0.015, 0.004, 0.002]) ** 2
    drawn = rng.multivariate_normal(np.zeros(3), cov[5], 100_000)
    true = (np.linalg.norm(drawn, axis=1) > 0.025).mean()
    found = probably_beyond(cov, 0.025).max()
    assert found == pytest.approx(true, abs=0.015)
    sigma = np.linspace(0.002, 0.05, 50)
    exact = chi2.sf((0.025 / sigma) ** 2, 3)
    assert probably_beyond(sigma[:, None, None] ** 2 * np.eye(3), 0.025) == pytest.approx(
        exact, rel=0, abs=1e-13
    )


def test_what_fits_badly_and_fingers_that_are_closed_are_known_less():
    joint, raw = HAND.rest.copy(), flat(0.002)
    fist = joint.copy()
    fist[[n.startswith(("index", "thumb")) and "flex" in n for n in HAND.parameter_names]] = 1.3
    good, bad, closed = (
        dict(zip(HAND.joint_names, np.trace(calibrated_covariance(HAND, curls(HAND, pose), raw, m, CLOUD), axis1=1, axis2=2)))
        for pose, m in ((joint, 0.5), (joint, 2.0), (fist, 2.0))
    )  # fmt: skip
    assert good["index_tip"] < bad["index_tip"] < closed["index_tip"]
    for joints in ("index_mcp index_pip index_dip index_tip", "thumb_mcp thumb_ip thumb_tip"):
        along = [closed[name] for name in joints.split()]
        assert (np.diff(along) > 0).all(), "hidden bends add up towards the tip"
    assert bad["wrist"] < closed["wrist"] < 1.5 * bad["wrist"]


def test_the_own_hand_s_stated_90_percent_hold(rng):
    """Exact masks of the very model: what is stated of a closing hand is not too little, and an open one is not called doubtful."""
    joint = motion(HAND, "open_fist_open", 48, rng)[6:24:3]
    rig = simulated_rig(3, (320, 240), 0.4)
    poses = np.array([HAND.transform.solver_params(j) for j in joint])
    seen = [
        replace(mask_views(HAND, pose, rig), frame=n, time_s=n / 25) for n, pose in enumerate(poses)
    ]
    tracked = track_recording(Tracker(HAND), lambda f, *_: seen[f], 0, poses[0], range(len(joint)))
    last = {result.frame: result for result in tracked}
    assert [last[n].status for n in (0, 1, 2)] == [Status.TRACKED] * 3
    inside = [inside_stated(last[n], HAND, pose) for n, pose in enumerate(poses)]
    assert np.mean(inside) > 0.85
    assert all(0 <= r.p_off_25mm <= 1 and r.p_off_10mm.shape == (6,) for r in last.values())


def seen_flat(seen, pose, total_m):
    """Return a frame at a pose whose joints are so exact, by its masks."""
    result = posed_result(HAND, seen, pose)
    return replace(result, energies={"coverage": 10.0}, joint_covariance=flat(total_m))


def test_fingers_that_fit_elsewhere_as_well_are_a_sign_of_an_error(rng):
    """Two cameras' joints without the middle finger's leave it alone free."""
    pose = HAND.transform.solver_params(motion(HAND, "open_fist_open", 8, rng)[0])
    seen = HAND.keypoints21(HAND.bones(pose))
    free = seen.copy()
    free[10:13] = np.nan

    def doubt(points):
        views = Observation(0, 0.0, keypoints=joints_seen(simulated_rig(2), points))
        terms = frame_terms(HAND, TrackerSettings(), views, HAND.bones(pose))
        signs = {"moved": 0.0, "free": free_sign(terms, pose)}
        return failure_probabilities(HAND, flat(0.003), signs)[0]

    assert doubt(free) > 2.0 * doubt(seen)


@pytest.mark.parametrize(("turn", "doubt_left"), [(0.0, 0.5), (np.pi / 2, 0.9)])
def test_detected_joints_that_agree_lower_the_doubt_of_a_closed_hand(rng, turn, doubt_left):
    """Of two cameras; where they see them elsewhere, or flesh hides them as from the side of a fist, they confirm nothing."""
    pose = HAND.transform.solver_params(motion(HAND, "open_fist_open", 8, rng)[4])
    pose[4] += turn
    rig = simulated_rig(2, (160, 120), 0.4)
    seen, bones = mask_views(HAND, pose, rig), HAND.bones(pose)

    def doubt(off_px):
        cameras = rig if off_px is not None else []
        joints = joints_seen(cameras, HAND.keypoints21(bones), off_px)
        terms = frame_terms(HAND, TrackerSettings(), replace(seen, keypoints=joints), bones, None)
        found = frame_confidence(seen_flat(seen, pose, 0.003), terms, pose, 10.0, ())
        spread = np.trace(found.joint_covariance, axis1=1, axis2=2)
        return float(found.p_off_10mm.max()), float(spread.max())

    agreeing, alone, elsewhere = doubt(0.0), doubt(None), doubt(30.0)
    assert agreeing[0] / alone[0] == pytest.approx(doubt_left, abs=0.1)
    assert agreeing[1] < alone[1]
    assert elsewhere == pytest.approx(alone, rel=0.1)
