"""The pose library by name and picture: each pose drawn, in a window of the page that asked, from which one is taken."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from typing import Any

import pytest

from handtrack.model.model_file import load_model
from handtrack.model.pose_library import pose_names, pose_title
from handtrack_app.engine.pictures.pose_pictures import pose_picture, pose_titles
from handtrack_app.protocol import snapshots
from handtrack_app.workbench import Workbench
from tests.app.page.test_through import Browser
from tests.app.waiting import eventually
from tests.app.wire import WireClient


def test_letters_and_everyday_poses_have_names_that_an_outsider_understands() -> None:
    assert pose_title("lsf_a") == ("A", "French manual alphabet")
    titles = [pose.title for pose in pose_titles(load_model())]
    assert "A (French manual alphabet)" in titles and "Fist" in titles
    assert len(set(titles)) == len(pose_names())
    assert not any("_" in title for title in titles)
    assert [pose.title for pose in pose_titles(load_model("body34"))][:2] == ["Stand", "Reach"]


@pytest.mark.parametrize("model", [load_model(), load_model("body34")], ids=["hand", "body"])
def test_each_pose_is_drawn_within_its_picture(model: Any) -> None:
    pictures = {pose.name: pose_picture(model, pose.name) for pose in pose_titles(model)}
    assert len(set(pictures.values())) >= len(pictures) - 1  # J is I, moved when signed
    for picture in pictures.values():
        ellipses = list(ET.fromstring(picture).iter("{http://www.w3.org/2000/svg}ellipse"))
        assert len(ellipses) == len(model.flesh["fine"].bone)
        for one in ellipses:
            x, y = map(float, one.attrib["transform"].split(")")[0].split("(")[1].split())
            assert 0 <= x <= 100 and 0 <= y <= 100


def test_a_left_hand_s_pictures_are_mirrored() -> None:
    def thumb(side: str) -> float:
        picture = pose_picture(load_model(side=side), "open")
        orange = [e for e in ET.fromstring(picture)[0] if e.attrib["fill"] == "#e69f00"]
        return sum(float(e.attrib["transform"].split("(")[1].split()[0]) for e in orange) / len(orange)  # fmt: skip

    assert thumb("right") + thumb("left") == pytest.approx(100, abs=2)
    assert thumb("right") > 55, "to the right of who sees the palm"


def test_a_pose_is_taken_from_the_pictures(bench: Workbench) -> None:
    with WireClient(bench.url) as wire:
        page = Browser(bench, wire)
        page.press("Poses in pictures")

        def buttons() -> dict[str, str]:
            said = [m for _, m in list(wire.messages) if m["type"] == "GuiButtonMessage"]
            return {m["props"]["label"]: m["uuid"] for m in said}

        eventually(lambda: "Fist" in buttons() and "Z" in buttons(), "the window is open")
        wire.send(
            {"type": "GuiUpdateMessage", "uuid": buttons()["Fist"], "updates": {"value": True}}
        )
        eventually(lambda: bench.stage.pose is not None and bench.stage.pose.origin == "set", "taken")  # fmt: skip
        names = bench.state.names
        assert bench.stage.pose is not None
        assert bench.stage.pose.values[names.index("index_pip_flex")] > 1.5
        assert bench.stage.pose.origin != snapshots.BEFORE
