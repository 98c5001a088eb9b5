"""Other programs' models as definitions: the same kinematics, readable refusals."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from handtrack import (
    load_model,
)
from handtrack.export.motion import urdf_text
from tests.conftest import REPOSITORY, refused

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


def places(model, joint):
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
        assert_allclose(limits[parameter], low_high, atol=1e-8)


def test_a_bvh_gives_its_skeleton(tmp_path):
    (tmp_path / "person.bvh").write_text(BVH)
    model = load_model(tmp_path / "person.bvh")
    assert model.parameter_names[6:] == ("spine_z", "spine_x", "spine_y", "head_z", "head_x", "head_y")  # fmt: skip
    at = places(model, np.zeros(12))
    assert_allclose(at["head"], [0, 0.5, 0], atol=1e-9)
    assert_allclose(at["head_end"], [0, 0.6, 0.05], atol=1e-9)
    bent = np.zeros(12)
    bent[6] = np.pi / 2  # about +z: +y goes to −x
    assert_allclose(places(model, bent)["head"], [-0.3, 0.2, 0], atol=1e-9)


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
    refused(f"odd.urdf: .*{words}", load_model, tmp_path / "odd.urdf")


HAND = """<mujoco model="pincher">
  <compiler angle="degree" eulerseq="XYZ" autolimits="true"/>
  <default>
    <geom contype="1" size="0.01"/>
    <default class="finger">
      <joint axis="1 0 0" range="-10 90"/>
      <geom type="capsule" size="0.008 0.015" pos="0 0.02 0" euler="90 0 0"/>
      <default class="tip"><geom size="0.006 0.01"/></default>
    </default>
  </default>
  <worldbody>
    <geom type="plane" size="1 1 1"/>
    <body name="table" pos="1 0 0"><geom type="box" size="0.5 0.5 0.1"/></body>
    <body name="palm" pos="0.3 -0.2 0.5" euler="20 -30 40">
      <freejoint/>
      <geom type="box" size="0.03 0.04 0.012"/>
      <body name="index" childclass="finger" pos="-0.02 0.04 0.002" quat="0.9 0.1 -0.2 0.05">
        <joint name="index_spread" axis="0 0 1" pos="0 0.004 0.001" range="-20 25" ref="5"/>
        <joint name="index_bend" pos="0 0.004 0.001"/>
        <geom/>
        <body name="index_end" pos="0.001 0.045 0" axisangle="0 1 1 15">
          <joint name="index_curl"/>
          <geom class="tip"/>
          <site name="index_touch" pos="0 0.03 0.001"/>
          <body name="nail" pos="0 0.03 0.005" xyaxes="0 1 0 -1 0 0.1"><geom type="ellipsoid" size="0.004 0.005 0.001"/></body>
        </body>
      </body>
      <body name="thumb" pos="0.03 0.01 0" euler="0 0 -50">
        <joint name="thumb_bend" class="finger" axis="0.2 0 1"/>
        <geom type="capsule" fromto="0 0 0 0.01 0.04 0.005" size="0.009"/>
        <body name="thumb_end" pos="0.01 0.04 0.005" zaxis="0.1 0.2 1">
          <joint name="thumb_curl" class="finger" limited="false"/>
          <geom type="capsule" size="0.007 0.012" pos="0 0.015 0" zaxis="0 1 0"/>
          <site name="thumb_touch" pos="0 0.03 0"/>
        </body>
      </body>
    </body>
  </worldbody>
  <equality><joint joint1="thumb_curl" joint2="thumb_bend" polycoef="0 0.7 0 0 0"/></equality>
</mujoco>
"""


@pytest.fixture
def hand(tmp_path):
    (tmp_path / "pincher.xml").write_text(HAND)
    return tmp_path / "pincher.xml"


def test_it_moves_as_in_mujoco(hand, rng):
    """Places of joints and sites, in the palm's frame; a joint's `ref` is where it stands at our zero."""
    mujoco = pytest.importorskip(
        "mujoco", reason="mujoco reads this format; pip install -e '.[formats]'"
    )
    model = load_model(hand)
    theirs = mujoco.MjModel.from_xml_path(str(hand))
    data = mujoco.MjData(theirs)
    names = model.parameter_names[6:]
    assert set(names) == {"index_spread", "index_bend", "index_curl", "thumb_bend", "thumb_curl"}
    for _ in range(5):
        angles = rng.uniform(-1.0, 1.0, len(names))
        for name, angle in zip(names, angles, strict=True):
            at = theirs.joint(name).qposadr[0]
            data.qpos[at] = theirs.qpos0[at] + angle
        mujoco.mj_forward(theirs, data)
        palm = data.body("palm")
        turn = palm.xmat.reshape(3, 3)
        bones = model.bones(model.transform.solver_params(np.r_[np.zeros(6), angles]))
        ours = places(model, np.r_[np.zeros(6), angles])
        for site in ("index_touch", "thumb_touch"):
            assert_allclose(ours[site], turn.T @ (data.site(site).xpos - palm.xpos), atol=1e-8)
        for joint in ("index_spread", "index_curl", "thumb_bend", "thumb_curl"):
            assert_allclose(
                ours[joint], turn.T @ (data.joint(joint).xanchor - palm.xpos), atol=1e-8
            )
        flesh = model.ellipsoids["fine"].posed(bones)
        geoms = turn.T @ (data.geom_xpos[2:] - palm.xpos).T  # after plane and table, in their order
        assert_allclose(flesh.centre, geoms.T, atol=1e-8)


def test_limits_couplings_and_shapes(hand):
    model = load_model(hand)
    limits = dict(zip(model.parameter_names, np.rad2deg(model.limits.interval), strict=True))
    assert_allclose(limits["index_spread"], (-25, 20), atol=1e-6)
    assert_allclose(limits["index_bend"], (-10, 90), atol=1e-6)
    assert_allclose(limits["thumb_curl"], (-180, 180), atol=1e-6)
    coupled = load_model(hand, coupling="21")
    pose = coupled.joint_params(coupled.params_from({"thumb_bend": 0.5}))
    angle = dict(zip(coupled.parameter_names, pose, strict=True))
    assert angle["thumb_curl"] == pytest.approx(0.7 * angle["thumb_bend"])
    assert_allclose(
        model.ellipsoids["fine"].radii[-3:].min(axis=1), (0.001, 0.009, 0.007), atol=1e-9
    )
