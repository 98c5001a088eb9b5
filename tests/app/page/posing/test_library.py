"""The pose library by name and picture: each pose drawn, in a window of the page that asked, from which one is taken."""

import xml.etree.ElementTree as ET

import pytest

from handtrack import load_model
from handtrack_app.engine.document_snapshots import pose_picture, pose_titles
from handtrack_app.protocol import snapshots
from tests.app.waiting import eventually


@pytest.mark.parametrize("model", [load_model(), load_model("body34")], ids=["hand", "body"])
def test_each_pose_is_drawn_within_its_picture(model):
    pictures = {pose.name: pose_picture(model, pose.name) for pose in pose_titles(model)}
    assert len(set(pictures.values())) >= len(pictures) - 1  # J is I, moved when signed
    for picture in pictures.values():
        ellipses = list(ET.fromstring(picture).iter("{http://www.w3.org/2000/svg}ellipse"))
        assert len(ellipses) == len(model.flesh["fine"].bone)
        for one in ellipses:
            x, y = map(float, one.attrib["transform"].split(")")[0].split("(")[1].split())
            assert 0 <= x <= 100 and 0 <= y <= 100


def test_a_pose_is_taken_from_the_pictures(bench, wire, page):
    page.press("Poses in pictures")

    def buttons():
        said = [m for _, m in list(wire.messages) if m["type"] == "GuiButtonMessage"]
        return {m["props"]["label"]: m["uuid"] for m in said}

    eventually(lambda: "Fist" in buttons() and "Z" in buttons(), "the window is open")
    wire.send({"type": "GuiUpdateMessage", "uuid": buttons()["Fist"], "updates": {"value": True}})
    eventually(lambda: bench.stage.pose is not None and bench.stage.pose.origin == "set", "taken")  # fmt: skip
    names = bench.state.names
    assert bench.stage.pose.values[names.index("index_pip_flex")] > 1.5
    assert bench.stage.pose.origin != snapshots.BEFORE
