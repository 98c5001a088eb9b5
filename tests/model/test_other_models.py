"""Other programs' models as definitions: the same kinematics, readable refusals."""

import numpy as np
import pytest

from handtrack.errors import HandtrackError
from handtrack.export.motion.urdf import urdf_text
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.model_file import load_model
from handtrack.observation.observation import Observation, Silhouette
from handtrack.session.bundled import bundled_session
from handtrack.simulation.scenes.simulated_views import model_mask
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.track import track
from tests.conftest import REPOSITORY

GRIPPER = REPOSITORY / "docs" / "notebooks" / "gripper.urdf"
CLAW = REPOSITORY / "tests" / "export" / "claw.toml"
EXACT_M = 1e-8
"""definitions hold nine decimals of millimetres and of unit vectors, over a decimetre"""

BVH = """HIERARCHY
ROOT hips
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT spine
  {
    OFFSET 0 20 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    JOINT head
    {
      OFFSET 0 30 0
      CHANNELS 3 Zrotation Xrotation Yrotation
      End Site
      {
        OFFSET 0 10 5
      }
    }
  }
}
MOTION
Frames: 0
"""


def places(model: ArticulatedModel, joint: np.ndarray) -> dict[str, np.ndarray]:
    bones = model.bones(model.transform.solver_params(joint))
    return dict(zip(model.joint_names, model.joint_positions(bones), strict=True))


@pytest.mark.parametrize(("name", "side"), [("hand26", "right"), ("hand26", "left"), (CLAW, "right"), ("body34", "right")])  # fmt: skip
def test_a_model_written_as_urdf_and_read_again_moves_the_same(tmp_path, rng, name, side):
    model = load_model(name, side)
    (tmp_path / "robot.urdf").write_text(urdf_text(model))
    again = load_model(tmp_path / "robot.urdf")
    interval = np.clip(model.limits.interval, -1.0, 1.0)
    for _ in range(5):
        joint = rng.uniform(interval[:, 0], interval[:, 1])
        named = dict(zip(model.parameter_names, joint, strict=True))
        here = places(model, joint)
        there = places(again, np.array([named[n] for n in again.parameter_names]))
        assert max(np.abs(here[n] - there[n]).max() for n in here.keys() & there.keys()) < EXACT_M
    assert len(here.keys() & there.keys()) >= 0.8 * len(here)
    limits = dict(zip(again.parameter_names, again.limits.interval, strict=True))
    for parameter, low_high in zip(model.parameter_names[6:], model.limits.interval[6:], strict=True):  # fmt: skip
        np.testing.assert_allclose(limits[parameter], low_high, atol=1e-8)


def test_a_robot_hand_is_tracked_by_its_own_model():
    """By three silhouettes, from a start 15° off; its thumb's second joint follows the first."""
    from handtrack.capture.calibration.rig_file import read_rig

    robot = load_model(GRIPPER, coupling="21")
    cameras = list(read_rig(bundled_session() / "calibration.toml"))
    place = np.mean([c.centre + 0.45 * c.rotation[2] for c in cameras], axis=0)
    angles = {"left_bend": 0.5, "left_curl": 0.9, "right_bend": 0.3, "right_curl": 0.6, "thumb_bend": 0.5, "thumb_curl": 0.4}  # fmt: skip
    root = dict(zip(("root_tx", "root_ty", "root_tz"), place, strict=True))
    true = robot.params_from(angles | root)
    off = {name: value - 0.26 for name, value in angles.items()}
    start = robot.params_from(off | root, nearest=True)
    flesh = robot.flesh["fine"].posed(robot.bones(true))
    seen = tuple(Silhouette(c, model_mask(c, flesh)) for c in cameras)
    result = track(robot, [Observation(0, 0.0, silhouettes=seen)], start, TrackerSettings())
    for name, value in angles.items():
        assert result.angle(name, degrees=False)[0] == pytest.approx(value, abs=0.03), name
    assert result.angle("thumb_curl") == pytest.approx(0.8 * result.angle("thumb_bend"))


def test_a_bvh_gives_its_skeleton(tmp_path):
    (tmp_path / "person.bvh").write_text(BVH)
    model = load_model(tmp_path / "person.bvh")
    assert model.parameter_names[6:] == ("spine_z", "spine_x", "spine_y", "head_z", "head_x", "head_y")  # fmt: skip
    at = places(model, np.zeros(12))
    np.testing.assert_allclose(at["head"], [0, 0.5, 0], atol=1e-9)
    np.testing.assert_allclose(at["head_end"], [0, 0.6, 0.05], atol=1e-9)
    bent = np.zeros(12)
    bent[6] = np.pi / 2  # about +z: +y goes to −x
    np.testing.assert_allclose(places(model, bent)["head"], [-0.3, 0.2, 0], atol=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            'type="revolute"',
            'type="prismatic"',
            "joint 'left_bend' is prismatic; expected revolute",
        ),
        ('<limit lower="-0.3" upper="1.5" effort="2" velocity="3"/>', "", "has no <limit>"),
        ('lower="-0.3" upper="1.5"', 'lower="2" upper="1.5"', "expected lower ≤ upper"),
        ('xyz="-0.028 0.06 0"', 'xyz="-0.028 0.06"', "expected 3 numbers"),
        ('<child link="left_lower"/>', '<child link="leftlower"/>', "names the link 'leftlower'"),
        ('multiplier="0.8"', 'multiplier="0.8" offset="0.1"', "with an offset of 0.1 rad"),
        ("<robot", "<model", "not valid XML"),
        ("</robot>", '<link name="alone"/></robot>', r"2 links hang on no joint \(palm, alone\)"),
    ],
)
def test_what_is_no_hand_is_refused(tmp_path, old, new, words):
    text = GRIPPER.read_text()
    assert old in text
    (tmp_path / "odd.urdf").write_text(text.replace(old, new, 1))
    with pytest.raises(HandtrackError, match=f"odd.urdf: .*{words}"):
        load_model(tmp_path / "odd.urdf")
