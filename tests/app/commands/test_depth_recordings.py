"""The recipes of docs/how-to/depth_and_stereo.md do what they say, on recordings made by others' libraries."""

from pathlib import Path

import numpy as np
import pytest

from handtrack.session.session import Session
from tests.app.command_line import CommandLine
from tests.conftest import REPOSITORY
from tests.test_docs import blocks

PAGE = REPOSITORY / "docs" / "how-to" / "depth_and_stereo.md"
SIZE = (64, 48)


def realsense_bag(path: Path) -> None:
    """Write three depth images of 500, 501, 502 units, of which one frame between the last two was dropped."""
    from rosbags.rosbag1 import Writer  # pyright: ignore[reportMissingImports]
    from rosbags.typesys import Stores, get_typestore  # pyright: ignore[reportMissingImports]

    store = get_typestore(Stores.ROS1_NOETIC)
    types = store.types
    info, image = types["sensor_msgs/msg/CameraInfo"], types["sensor_msgs/msg/Image"]
    region, header, stamp = (
        types[name]
        for name in (
            "sensor_msgs/msg/RegionOfInterest",
            "std_msgs/msg/Header",
            "builtin_interfaces/msg/Time",
        )
    )
    about = header(0, stamp(0, 0), "depth")
    width, height = SIZE
    with Writer(path) as bag:
        place = "/device_0/sensor_0/Depth_0"
        infos = bag.add_connection(f"{place}/info/camera_info", info.__msgtype__, typestore=store)
        images = bag.add_connection(f"{place}/image/data", image.__msgtype__, typestore=store)
        matrix = np.array([60.0, 0, 31.5, 0, 60.0, 23.5, 0, 0, 1])
        lens = info(
            about,
            height,
            width,
            "plumb_bob",
            np.zeros(5),
            matrix,
            np.eye(3).ravel(),
            np.zeros(12),
            0,
            0,
            region(0, 0, 0, 0, False),
        )
        bag.write(infos, 0, store.serialize_ros1(lens, info.__msgtype__))
        for i, frame in enumerate((0, 1, 3)):
            pixels = np.full((height, width), 500 + i, "<u2")
            message = image(
                about, height, width, "mono16", 0, 2 * width, pixels.view(np.uint8).ravel()
            )
            bag.write(
                images, 10**9 + frame * 33_333_333, store.serialize_ros1(message, image.__msgtype__)
            )


def test_a_realsense_recording_becomes_a_session(
    handtrack: CommandLine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("rosbags")
    monkeypatch.chdir(tmp_path)
    realsense_bag(tmp_path / "recording.bag")
    (recipe,) = blocks(PAGE, "python")
    exec(compile(recipe, str(PAGE), "exec"), {})
    (command,) = (
        line for body in blocks(PAGE, "sh") for line in body.splitlines() if " new " in line
    )
    ended = handtrack(*command.split()[1:])
    assert ended.code == 0, ended.err
    session = Session.open(tmp_path / "my_hand")
    depths = [session.view("depth").depth_m(frame) for frame in range(4)]
    assert [None if d is None else float(d[0, 0]) for d in depths] == pytest.approx(
        [0.5, 0.501, None, 0.502]
    )
    assert len(session.measured_cloud(0)) > 1000
