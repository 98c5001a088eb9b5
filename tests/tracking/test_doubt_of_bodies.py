"""What one camera cannot see of a body is in what is stated: limbs that look the same bent towards it and away."""

from dataclasses import replace

import numpy as np

from handtrack import (
    Camera,
    ImageKeypoints,
    Observation,
    Silhouette,
    Status,
    Tracker,
    TrackerSettings,
    load_model,
)
from handtrack.arrays import Floats
from handtrack.geometry.rotation import rotation_matrix
from handtrack.observation.observation import ImageView
from handtrack.sampling.chains import chain_along
from handtrack.sampling.interpretation_tree import interpretation_tree
from handtrack.tracking.frame.confidence import frame_confidence
from handtrack.tracking.frame.depth_flips import mirrored_covariance
from handtrack.tracking.frame.frame_terms import frame_terms
from handtrack.tracking.sequence import track_recording
from tests.cameras import FACING, pinhole

BODY = load_model("body34")
FRONT = pinhole("front", (1080, 1920), 1200, FACING, (0, 0, 4), at=(540, 960))
SIDE = replace(FRONT, name="side", rotation=FRONT.rotation @ rotation_matrix(np.r_[0, 1.4, 0]).T)
WRIST = BODY.joint_names.index("left_wrist")


def _stepping() -> np.ndarray:
    """Return a body with an arm held out to the front and a knee bent: of both the mirror image is a pose, too."""
    joint = BODY.joint_params(BODY.rest_params())
    for name, angle in (("left_shoulder_flex", 0.5), ("right_hip_flex", 0.6), ("right_knee_flex", 0.7)):  # fmt: skip
        joint[BODY.parameter_names.index(name)] = angle
    return BODY.clipped(BODY.transform.solver_params(joint))


def joints_of_body(pose: np.ndarray, *cameras: Camera, off_px: Floats = np.zeros(2)) -> Observation:
    """Return where cameras see a body's joints."""
    places = BODY.joint_positions(BODY.bones(pose))
    joints = [
        ImageKeypoints(c, BODY.joint_names, c.project(places) + off_px, 10.0) for c in cameras
    ]
    return Observation(0, 0.0, keypoints=tuple(joints))


def _flipped(pose: np.ndarray) -> np.ndarray:
    """Return the pose with its left arm flipped as far as it goes."""
    chain = chain_along(BODY, "arm", ("left_shoulder", "left_elbow", "left_wrist"))
    leaves = interpretation_tree(BODY, pose, [chain], FRONT).params
    places = [BODY.joint_positions(BODY.bones(leaf))[WRIST] for leaf in leaves]
    far = np.linalg.norm(places - BODY.joint_positions(BODY.bones(pose))[WRIST], axis=1)
    return leaves[int(far.argmax())]


def test_one_camera_s_mask_or_image_leaves_flips_open_and_two_cameras_do_not():
    """A limb's outline is nearly its flip's: what is stated contains it, and the frame is no tracked one."""
    pose = _stepping()
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
        result = frame_confidence(terms, pose, 1.0, {}, np.zeros((len(BODY.joint_names), 3, 3)), ())
        assert result.status != Status.TRACKED
        beside = replace(seen, silhouettes=(*seen.silhouettes, Silhouette(SIDE, mask)))
        terms = frame_terms(BODY, settings, beside, BODY.bones(pose), None)
        assert not mirrored_covariance(terms, pose).any()


def test_a_body_in_one_camera_is_doubtful_and_in_two_it_is_not():
    true = _stepping()
    status = {}
    for name, cameras in (("one", (FRONT,)), ("two", (FRONT, SIDE))):
        seen = joints_of_body(true, *cameras)
        frames = [replace(seen, frame=n, time_s=n / 25) for n in range(4)]
        path = track_recording(
            Tracker(BODY), lambda n, _, f=frames: f[n], 0, _flipped(true), range(4)
        )
        last = {result.frame: result for result in path}.values()
        status[name] = {result.status for result in last}
        places = BODY.joint_positions(BODY.bones(true))
        for result in last:
            off = np.linalg.norm(result.joint_positions - places, axis=1)
            stated = np.sqrt(np.trace(result.joint_covariance, axis1=1, axis2=2))
            assert np.sqrt((off**2).mean()) < 2.0 * np.sqrt((stated**2).mean())
            assert 0.0 <= result.p_off_25mm <= 1.0
            assert result.p_off_10mm is None
    assert status == {"one": {Status.DOUBTFUL}, "two": {Status.TRACKED}}
