"""Model definitions of a person's own: what is wrong in one is said, before anything is built from it."""

from importlib import resources

import pytest

from handtrack.errors import HandtrackError
from handtrack.model.model_file import load_model

TEXT = resources.files("handtrack.model.definitions").joinpath("glove9.toml").read_text("utf-8")
BAD = {
    "key missing": ("length_mm", "length_m", "Object missing required field `length_mm`."),
    "bone's key missing": ("tail =", "tial =", "Object missing required field `tail` - at `$.bone[0]`."),
    "kind": ('kind = "hand"', 'kind = "foot"', "Invalid enum value 'foot' - at `$.kind`."),
    "a text for a number": ("up = [0, 0, 1]", 'up = [0, 0, "1"]', "got `str` - at `$.bone[0].up[2]`."),
    "too few numbers": ("up = [0, 0, 1]", "up = [0, 1]", "length 3, got 2 - at `$.bone[0].up`."),
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
