"""Definitions: signs, mirror images, sizes and couplings of our models, and what is wrong in one of a person's own."""

from importlib import resources

import numpy as np
import pytest
from numpy.testing import assert_allclose

from handtrack import HandScale, HandtrackError, load_model
from handtrack.model.articulated import FINGERS, keypoint_names
from handtrack.model.pose_library import named_pose, pose_names
from handtrack.model.transform import build_transform
from handtrack.terms.collision import CollisionTerm, contact

HAND, BODY = load_model(), load_model("body34")
TRUNK = ("spine", "neck"), ("neck", "head_top")


def placed(model, joint, **degrees):
    angles = {name: np.deg2rad(value) for name, value in degrees.items()}
    points = model.joint_positions(model.bones(model.params_from(angles)))
    return points[model.joint_names.index(joint)]


def test_zero_pose_is_flat_with_fingers_along_y_and_the_thumb_at_minus_x():
    points = dict(zip(keypoint_names(), HAND.keypoints21(HAND.bones(np.zeros(26))), strict=True))
    for finger in FINGERS[1:]:
        along = points[f"{finger}_tip"] - points[f"{finger}_mcp"]
        assert_allclose(along / np.linalg.norm(along), [0, 1, 0], atol=1e-12)
    assert points["thumb_tip"][0] < points["index_tip"][0] < points["little_tip"][0]
    assert np.linalg.norm(points["middle_tip"]) == pytest.approx(0.187, rel=0.02)


@pytest.mark.parametrize(
    ("parameter", "joint", "axis", "least_m"),
    [
        *((f"{f}_{j}_flex", f"{f}_tip", 2, -0.005) for f in FINGERS[1:] for j in ("mcp", "pip", "dip")),
        *((f"{f}_mcp_abd", f"{f}_tip", 0, -0.001) for f in ("index", "middle")),
        *((f"{f}_mcp_abd", f"{f}_tip", 0, 0.001) for f in ("ring", "little")),
        ("thumb_cmc_abd", "thumb_tip", 2, -0.01),  # away from the palm: to its side
        ("thumb_cmc_flex", "thumb_tip", 0, 0.01),  # across the palm
        ("left_hip_flex", "left_knee", 2, 0.1),  # the right limbs are mirror images
        ("left_hip_abd", "left_knee", 0, 0.1),
        ("left_knee_flex", "left_ankle", 2, -0.1),
        ("left_ankle_flex", "left_toe", 1, 0.02),
        ("left_hip_twist", "left_ankle", 0, -0.05),  # the knee out, the bent shin in
        ("left_elbow_flex", "left_wrist", 2, 0.05),
        ("left_shoulder_twist", "left_wrist", 0, 0.05),
        ("left_clavicle_elevate", "left_shoulder", 1, 0.05),
        ("left_clavicle_protract", "left_shoulder", 2, 0.05),
        *((f"{bone}_flex", tip, 2, 0.05) for bone, tip in TRUNK),
        *((f"{bone}_lean", tip, 0, 0.05) for bone, tip in TRUNK),
        *((f"{bone}_twist", "nose", 0, 0.03) for bone, _ in TRUNK),
    ],
)  # fmt: skip
def test_signs(parameter, joint, axis, least_m):
    """A joint moves along an axis as its parameter grows; of twists, with elbow and knee bent."""
    model = HAND if parameter in HAND.parameter_names else BODY
    bend = {"left_elbow_flex": 60.0, "left_knee_flex": 60.0} if "twist" in parameter else {}
    moved = placed(model, joint, **{parameter: 30.0}, **bend) - placed(model, joint, **bend)
    assert moved[axis] / least_m > 1.0


def test_wrist_flexion_brings_palm_and_forearm_together():
    model = load_model(forearm=True)
    bone = model.skeleton.bone("forearm")
    for name, axis, sign in (("wrist_flex", 2, -1), ("wrist_abd", 0, -1)):
        bones = model.bones(model.params_from({name: 0.4}))
        elbow = bones.to_world(bone, np.array([0, 0.25, 0]))
        assert sign * elbow[axis] > 0.05, name


def test_the_left_hand_is_the_exact_mirror_image(rng):
    right, left = load_model(forearm=True), load_model(side="left", forearm=True)
    params = rng.normal(scale=0.5, size=28)
    mirrored = params.copy()
    mirrored[0] *= -1  # the root is placed in the world, so it is mirrored like any point …
    mirrored[4:6] *= -1  # … and any rotation; joint angles keep their values
    a, b = right.bones(params), left.bones(mirrored)
    flip = np.array([-1.0, 1.0, 1.0])
    assert_allclose(right.joint_positions(a) * flip, left.joint_positions(b), atol=1e-14)
    for key in ("fine", "metaballs"):
        one, other = right.ellipsoids[key].posed(a), left.ellipsoids[key].posed(b)
        assert_allclose(one.centre * flip, other.centre, atol=1e-14)
        shape = np.einsum("eij,ej,ekj->eik", one.rotation, one.radii**2, one.rotation)
        mirror = np.einsum("eij,ej,ekj->eik", other.rotation, other.radii**2, other.rotation)
        assert_allclose(shape * np.outer(flip, flip), mirror, atol=1e-14)


def test_spread_shrinks_as_the_knuckle_bends():
    abd, bent = HAND.skeleton.parameter("index_mcp_abd"), np.zeros(26)
    straight = np.ptp(HAND.limits.bounds(bent)[abd])
    bent[HAND.skeleton.parameter("index_mcp_flex")] = np.deg2rad(90)
    assert np.ptp(HAND.limits.bounds(bent)[abd]) < 0.5 * straight


@pytest.mark.parametrize("name", ["body34", "body38"])
def test_left_and_right_are_mirror_images(name, rng):
    """The same angles left and right, and opposite leans and twists of the trunk, give the mirrored pose."""
    body = load_model(name)

    def other(side_and_part):
        side, _, part = side_and_part.partition("_")
        return {"left": f"right_{part}", "right": f"left_{part}"}.get(side, side_and_part)

    low, high = body.limits.interval[6:].T
    joint = np.r_[np.zeros(6), rng.uniform(low, high)]
    mirrored = joint[[body.skeleton.parameter(other(n)) for n in body.parameter_names]]
    turned = [
        n.startswith(("spine", "neck")) and not n.endswith("flex") for n in body.parameter_names
    ]
    mirrored[turned] *= -1.0
    a, b = (body.joint_positions(body.bones(pose)) for pose in (joint, mirrored))
    swapped = [body.joint_names.index(other(n)) for n in body.joint_names]
    assert_allclose(a * [-1.0, 1.0, 1.0], b[swapped], atol=1e-12)


def test_proportions_move_hips_clavicles_and_skull():
    parts = {"hip": "hip", "clavicle": "shoulder", "skull": "head_top"}
    places = BODY.joint_positions(BODY.bones(np.zeros(34)))
    for name in BODY.proportions.names:
        changed = load_model("body34", scale=HandScale(1.0, {}, {name: 2.0}))
        moved = np.abs(changed.joint_positions(changed.bones(np.zeros(34))) - places).max(axis=1)
        assert ((moved > 0.005) == (moved > 0)).all(), name
        own = [joint.endswith(parts[name.split("_")[0]]) for joint in BODY.joint_names]
        assert moved[own].min() > 0.005, name
    wide = load_model("body34", scale=HandScale(1.0, {}, {"hip_width": 1.0}))
    assert placed(wide, "left_hip")[0] - placed(BODY, "left_hip")[0] == pytest.approx(0.007)
    assert placed(wide, "right_hip")[0] == pytest.approx(-placed(wide, "left_hip")[0])


def test_signs_of_wrists():
    """Palms face the thighs: flexion brings the knuckles to the body's middle, abduction to the thumb, which points ahead."""
    body = load_model("body38")
    still = placed(body, "left_hand")
    flexed = placed(body, "left_hand", left_wrist_flex=60) - still
    towards_thumb = placed(body, "left_hand", left_wrist_abd=20) - still
    assert flexed[0] < -0.05 and abs(flexed[2]) < 1e-9
    assert towards_thumb[2] > 0.02 and abs(towards_thumb[0]) < 1e-9
    for knuckle, ahead in (("index", 1), ("pinky", -1)):
        assert (placed(body, f"left_{knuckle}") - still)[2] * ahead > 0.02
    # a flexed hand still turns to the thumb: flexion first, abduction about the axis that it carried along
    both = placed(body, "left_hand", left_wrist_flex=60, left_wrist_abd=20)
    assert both[2] - still[2] == pytest.approx(towards_thumb[2], abs=1e-9)


TEXT = resources.files("handtrack.model.definitions").joinpath("glove9.toml").read_text("utf-8")
BAD = {
    "key missing": ("length_mm", "length_m", "Object missing required field `length_mm`."),
    "kind": ('kind = "hand"', 'kind = "foot"', "Invalid enum value 'foot' - at `$.kind`."),
    "not finite": ("up = [0, 0, 1]", "up = [0, 0, nan]", "- at `$.bone[0].up[2]`."),
    "unknown freedom": (
        "[joints]",
        '[narrowing]\npairs = [["root_abd", "root_flex"]]\nat_deg = 90\nto = 0.3\n[joints]',
        "no freedom 'root_abd' in narrowing",
    ),
    "unknown bone": ('parent = "root"', 'parent = "rot"', "no bone 'rot' in the model definition"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_a_bad_definition_is_refused(case, tmp_path):
    old, new, words = BAD[case]
    assert old in TEXT
    path = tmp_path / "mine.toml"
    path.write_text(TEXT.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(HandtrackError) as refused:
        load_model(path)
    assert f"model definition {path}" in str(refused.value)
    assert words in str(refused.value)


LOCKED = """
format = 1
name = "stiff"
extends = "BASE"
length_mm = 200.0

[[bone]]
name = "index_distal"
freedoms = []
tail = [-27.5, 190, 0]

[[bone]]
name = "ring_finger_ring"
parent = "ring_proximal"
group = "ring"
head = [0, 90, 0]
tail = [0, 95, 0]
up = [0, 0, 1]

[joints]
ring_of_the_ring = ["ring_finger_ring", "tail"]

[landmarks.markers]
index_tip = [1, 2, 3, 0.5]
"""


def test_a_definition_extends_another(tmp_path):
    """Named bones and freedoms are changed or added, what is not named stays; a file may be extended as ours may."""
    (tmp_path / "stiff.toml").write_text(LOCKED.replace("BASE", "hand26"), encoding="utf-8")
    longer = 'format = 1\nname = "longer"\nextends = "stiff.toml"\nlength_mm = 220.0\n'
    (tmp_path / "longer.toml").write_text(longer, encoding="utf-8")
    ours, mine = load_model("hand26"), load_model(tmp_path / "longer.toml")
    gone = {"index_dip_flex"}
    assert mine.parameter_names == tuple(n for n in ours.parameter_names if n not in gone)
    assert mine.name == "longer"
    assert mine.joint_names == (*ours.joint_names, "ring_of_the_ring")
    assert mine.skeleton.bone_names == (*ours.skeleton.bone_names, "ring_finger_ring")
    rest = [model.joint_positions(model.bones(model.params_from({}))) for model in (ours, mine)]
    longest = ours.joint_names.index("index_tip")
    assert rest[1][longest, 1] == pytest.approx(0.190)
    others = [n for n in range(len(ours.joint_names)) if n != longest]
    assert (rest[1][others] == rest[0][others]).all()
    markers = mine.landmark_definitions["markers (mean)"]
    assert_allclose((markers.point - mine.joint_point)[longest], [0.001, 0.002, 0.003])
    assert markers.sigma_m.tolist().index(0.0005) == longest


@pytest.mark.parametrize("coupling", ["26", "21", "18"])
def test_reduced_sets(coupling, rng):
    model = load_model(coupling=coupling)
    params = rng.normal(size=int(coupling))
    joint = model.joint_params(params)
    assert_allclose(model.transform.solver_params(joint), params, atol=1e-12)
    value = dict(zip(model.parameter_names, joint, strict=True))
    if coupling != "26":
        for finger in ("index", "middle", "ring", "little"):
            assert value[f"{finger}_dip_flex"] == pytest.approx(2 / 3 * value[f"{finger}_pip_flex"])
        assert value["thumb_ip_flex"] == pytest.approx(2 / 3 * value["thumb_mcp_flex"])


def test_a_leaders_bounds_are_the_intersection():
    """pip in [0, 110°] and dip = 2/3 pip in [0, 60°] leave pip [0, 90°]; a ratio below 0 changes the ends."""
    couplings = {"dip": ("pip", 2 / 3), "ring": ("spread", 2.0), "index": ("spread", -1.0)}
    transform = build_transform(("pip", "dip", "ring", "index"), couplings)
    reduced = transform.reduce_bounds(np.deg2rad([[0, 110], [0, 60], [-20, 30], [-5, 40]]))
    assert_allclose(np.rad2deg(reduced), [[0, 90], [-10, 5]])


@pytest.mark.parametrize(
    ("kind", "name", "term", "deepest_m"),
    [("hand", "hand26", contact, 3.2e-3), ("body", "body34", CollisionTerm.of, 0.03)],
)
def test_every_pose_is_within_limits_and_hardly_a_part_lies_in_another(kind, name, term, deepest_m):
    """Flesh gives way by about 3 mm where pads press on each other; fingers had lain up to 14.7 mm deep (S)."""
    model = load_model(name)
    for pose in pose_names(kind):
        joint = named_pose(model, pose)
        low, high = model.limits.bounds(joint).T
        assert ((joint >= low - 1e-9) & (joint <= high + 1e-9)).all(), pose
        assert not joint[:6].any(), "the root stays at the world's origin"
        bones = model.bones(model.transform.solver_params(joint))
        assert term(model).depths(bones).max() < deepest_m, pose
