"""What one camera cannot see of a body: limbs that look the same bent towards it and away, in a frame and in all together."""

from dataclasses import replace

import numpy as np
import pytest

from handtrack import (
    ImageKeypoints,
    Observation,
    Silhouette,
    Status,
    Tracker,
    TrackerSettings,
    load_model,
)
from handtrack.geometry.rotation import rotation_matrix
from handtrack.model.pose_changes import PLACE
from handtrack.observation.observation import ImageView
from handtrack.sampling.chains import chain_along
from handtrack.sampling.interpretation_tree import interpretation_tree
from handtrack.tracking.frame.confidence import frame_confidence
from handtrack.tracking.frame.descent import mirrored_covariance
from handtrack.tracking.frame.frame_task import posed_result
from handtrack.tracking.frame.frame_terms import frame_terms
from handtrack.tracking.sequence import track_recording
from handtrack.tracking.size.estimate import estimate_whole
from handtrack.tracking.whole.likelihood import Recording, RecordingLikelihood, new_share
from handtrack.tracking.whole.trajectory_hypotheses import (
    trajectory_cost,
    trajectory_hypotheses,
)
from tests.cameras import FACING, pinhole

BODY = load_model("body34")
FRONT = pinhole("front", (1080, 1920), 1200, FACING, (0, 0, 4), at=(540, 960))
SIDE = replace(FRONT, name="side", rotation=FRONT.rotation @ rotation_matrix(np.r_[0, 1.4, 0]).T)
WRIST = BODY.joint_names.index("left_wrist")


STEPPING = BODY.params_from({"left_shoulder_flex": 0.5, "right_hip_flex": 0.6, "right_knee_flex": 0.7})  # fmt: skip
"""an arm held out to the front and a knee bent: of both the mirror image is a pose, too"""


def places_of(pose):
    """Return the body's joints (J, 3) in a pose."""
    return BODY.joint_positions(BODY.bones(pose))


def joints_of_body(pose, *cameras, off_px=np.zeros(2), sigma_px=10.0):
    """Return where cameras see a body's joints."""
    places = places_of(pose)
    joints = [
        ImageKeypoints(c, BODY.joint_names, c.project(places) + off_px, sigma_px) for c in cameras
    ]
    return Observation(0, 0.0, keypoints=tuple(joints))


def _flipped(pose):
    """Return the pose with its left arm flipped as far as it goes."""
    chain = chain_along(BODY, "arm", ("left_shoulder", "left_elbow", "left_wrist"))
    leaves = interpretation_tree(BODY, pose, [chain], FRONT)
    places = [places_of(leaf)[WRIST] for leaf in leaves]
    far = np.linalg.norm(places - places_of(pose)[WRIST], axis=1)
    return leaves[int(far.argmax())]


def test_one_camera_s_mask_or_image_leaves_flips_open_and_two_cameras_do_not():
    """A limb's outline is nearly its flip's: what is stated contains it, and the frame is no tracked one."""
    pose = STEPPING
    mask = np.zeros(FRONT.size[::-1], np.float32)
    mask[400:1500, 400:700] = 1.0
    image = np.zeros((*FRONT.size[::-1], 3), np.uint8)
    by_mask = Observation(0, 0.0, silhouettes=(Silhouette(FRONT, mask),))
    by_image = Observation(0, 0.0, images=(ImageView(FRONT, image),))
    edges = TrackerSettings().with_values({"edges.weight": 1.0})
    for seen, settings in ((by_mask, TrackerSettings()), (by_image, edges)):
        terms = frame_terms(BODY, settings, seen, BODY.bones(pose), None)
        spread = np.sqrt(np.trace(mirrored_covariance(terms, pose)[WRIST]))
        assert spread > 0.1
        none = np.zeros((len(BODY.joint_names), 3, 3))
        result = replace(posed_result(BODY, seen, pose), joint_covariance=none)
        result = frame_confidence(result, terms, pose, 1.0, ())
        assert result.status != Status.TRACKED
        beside = replace(seen, silhouettes=(*seen.silhouettes, Silhouette(SIDE, mask)))
        terms = frame_terms(BODY, settings, beside, BODY.bones(pose), None)
        assert not mirrored_covariance(terms, pose).any()


def test_a_body_in_one_camera_is_doubtful_and_in_two_it_is_not():
    true = STEPPING
    status = {}
    for name, cameras in (("one", (FRONT,)), ("two", (FRONT, SIDE))):
        seen = joints_of_body(true, *cameras)
        frames = [replace(seen, frame=n, time_s=n / 25) for n in range(4)]
        path = track_recording(
            Tracker(BODY), lambda n, _, f=frames: f[n], 0, _flipped(true), range(4)
        )
        last = {result.frame: result for result in path}.values()
        status[name] = {result.status for result in last}
        places = places_of(true)
        for result in last:
            off = np.linalg.norm(result.joint_positions - places, axis=1)
            stated = np.sqrt(np.trace(result.joint_covariance, axis1=1, axis2=2))
            assert np.sqrt((off**2).mean()) < 2.0 * np.sqrt((stated**2).mean())
            assert 0.0 <= result.p_off_25mm <= 1.0
            assert result.p_off_10mm is None
    assert status == {"one": {Status.DOUBTFUL}, "two": {Status.TRACKED}}


FRAMES = range(4)


POSES = np.array([BODY.params_from({"left_shoulder_flex": 0.4 + 0.02 * n}) for n in FRAMES])
"""an arm that is held out to the front, and a little more so in each frame"""


def _evidence(*cameras, off_px=np.zeros((4, 1, 2))):
    def observe(frame, _bones=None):
        seen = joints_of_body(POSES[frame], *cameras, off_px=off_px[frame])
        return replace(seen, frame=frame, time_s=frame / 25.0)

    settings = TrackerSettings().with_values({"prior.motion_sigma_deg": 5.0})
    return RecordingLikelihood(Recording(BODY, settings, observe), dict(enumerate(POSES)), 0.04)


def _way(*cameras):
    likelihood = _evidence(*cameras)
    found = estimate_whole(likelihood, FRAMES, POSES, sweeps=3)
    return likelihood, found


def test_limbs_are_flipped_in_all_frames_alone_and_together():
    likelihood, first = _way(FRONT)
    ways = trajectory_hypotheses(likelihood, first, FRAMES, 6)
    costs = [trajectory_cost(likelihood, way) for way in ways]
    assert costs == sorted(costs)
    places = [np.array([places_of(pose) for pose in way.poses]) for way in ways]
    deep = [np.abs((off - places[0]) @ FRONT.rotation[2]).max(axis=1) for off in places[1:]]
    assert any((frames > 0.1).all() for frames in deep)
    assert any(way.origin.count(" flipped") == 2 for way in ways)


def test_what_two_cameras_see_has_one_way():
    likelihood, way = _way(FRONT, SIDE)
    assert trajectory_hypotheses(likelihood, way, FRAMES, 6) == [way]


def test_joints_of_one_camera_count_as_often_as_their_errors_are_new():
    one, two = (
        replace(_evidence(*cameras), new=0.2).of(0) for cameras in ((FRONT,), (FRONT, SIDE))
    )
    assert (one.share, two.share) == (0.2, 1.0)
    whole, seen = one.linearize(POSES[0], [], 0, _evidence(FRONT).shared.person)
    counted = whole.hessian[PLACE, PLACE].trace()
    assert counted == pytest.approx(0.2 * seen[PLACE, PLACE].trace(), rel=1e-6)


@pytest.mark.parametrize(("lasts", "least", "most"), [(0.0, 0.75, 1.0), (1.0, 0.05, 0.06)])
def test_errors_that_come_again_are_told_from_new_ones(rng, lasts, least, most):
    new, again = rng.normal(scale=5.0, size=(2, len(FRAMES), len(BODY.joint_names), 2))
    off_px = (1.0 - lasts) * new + lasts * again[0]
    assert least <= new_share(_evidence(FRONT, off_px=off_px), FRAMES, POSES) <= most
