"""What is copied, kept for other pages, and pasted: whole, a finger into another, with its place or without."""

import pytest

from handtrack import load_model
from handtrack.files.user_folder import user_data_folder
from handtrack_app.page.panels.copying import ALL, CopiedPose, read_copied, save_copied

HAND = load_model().parameter_names
BODY = load_model("body34").parameter_names


@pytest.fixture(autouse=True)
def home(tmp_path, monkeypatch):
    monkeypatch.setenv("HANDTRACK_HOME", str(tmp_path))


def _of(names, part=ALL):
    whole = CopiedPose(ALL, "a", 7, {name: 0.01 * i for i, name in enumerate(names)})
    return whole if part == ALL else CopiedPose(part, "a", 7, whole.pasted(names, part))


def test_a_pose_is_pasted_where_the_hand_is_or_with_its_place():
    copied = _of(HAND)
    joints = copied.pasted(HAND, ALL)
    assert set(joints) == set(HAND[6:])
    assert copied.pasted(HAND, ALL, with_place=True) == copied.parameters


def test_a_finger_is_pasted_into_itself_and_into_another():
    finger = _of(HAND, "Index")
    assert set(finger.parameters) == {n for n in HAND if n.startswith("index_")}
    given = finger.pasted(HAND, "Ring")
    assert given["ring_pip_flex"] == finger.parameters["index_pip_flex"]
    assert set(given) == {n for n in HAND if n.startswith("ring_")}
    assert _of(HAND).pasted(HAND, "Ring")["ring_pip_flex"] != given["ring_pip_flex"]
    thumb = finger.pasted(HAND, "Thumb")
    assert set(thumb) == {"thumb_mcp_flex"}, "what both have"


def test_an_arm_is_pasted_to_the_other_side_and_to_no_leg():
    arm = _of(BODY, "Left arm")
    given = arm.pasted(BODY, "Right arm")
    assert given["right_elbow_flex"] == arm.parameters["left_elbow_flex"]
    assert all(name.startswith("right_") for name in given)
    assert arm.pasted(BODY, "Left leg") == {}


def test_a_model_takes_what_it_has():
    simple = load_model("glove9").parameter_names
    assert set(_of(HAND).pasted(simple, ALL)) <= set(simple)
    assert _of(BODY, "Left arm").pasted(HAND, "Index") == {}


def test_it_is_kept_for_the_page_of_another_recording():
    assert read_copied() is None
    save_copied(_of(HAND, "Index"))
    assert read_copied() == _of(HAND, "Index")


@pytest.mark.parametrize(
    "text",
    ["", "[]", "{}", '{"part": "all", "session": "", "frame": 1, "parameters": [1]}',
     '{"part": "all", "session": "", "frame": 1, "parameters": {"index_mcp_flex": 1e999}}',
     '{"part": "all", "session": "", "frame": 1, "parameters": {"index_mcp_flex": "much"}}'],
)  # fmt: skip
def test_a_file_that_is_none_is_passed_over(text):
    save_copied(_of(HAND))
    (user_data_folder() / "copied_pose.json").write_text(text)
    assert read_copied() is None
