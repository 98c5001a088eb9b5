"""The pose library by name and picture: each pose drawn, in a window of the page that asked, from which one is taken."""

from handtrack_app.protocol import snapshots
from tests.app.waiting import eventually


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
