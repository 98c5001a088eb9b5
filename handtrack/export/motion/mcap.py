"""MCAP: joint states, the robot's description and where its root is, as ROS 2 messages."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np

from handtrack.arrays import Floats, N
from handtrack.export.motion.xml_models import urdf_text
from handtrack.export.table import ResultsTable
from handtrack.files.atomic import replacing
from handtrack.geometry.rotation import quaternion_wxyz


def _schema(fields: str, *messages: str) -> str:
    """Return a message's fields, and the messages that they hold, as ROS 2 writes them."""
    return f"{'=' * 80}\nMSG: ".join((fields, *messages))


_HEADER = (
    "std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n",
    "builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n",
)
_XYZ = "float64 x\nfloat64 y\nfloat64 z\n"
_QUATERNION = f"geometry_msgs/Quaternion\n{_XYZ}float64 w\n"
_STATE = _schema(
    "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n",
    *_HEADER,
)
_POSE = _schema(
    "std_msgs/Header header\ngeometry_msgs/Pose pose\n",
    *_HEADER,
    "geometry_msgs/Pose\ngeometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n",
    f"geometry_msgs/Point\n{_XYZ}",
    _QUATERNION,
)
_TEXT = "string data\n"
_TRANSFORMS = _schema(
    "geometry_msgs/TransformStamped[] transforms\n",
    "geometry_msgs/TransformStamped\nstd_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n",
    *_HEADER,
    "geometry_msgs/Transform\ngeometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n",
    f"geometry_msgs/Vector3\n{_XYZ}",
    _QUATERNION,
)
_LATCHED = (
    "- history: 1\n  depth: 1\n  reliability: 1\n  durability: 1\n  deadline: {sec: 2147483647, nsec: 4294967295}\n"
    "  lifespan: {sec: 2147483647, nsec: 4294967295}\n  liveliness: 1\n"
    "  liveliness_lease_duration: {sec: 2147483647, nsec: 4294967295}\n  avoid_ros_namespace_conventions: false\n"
)
"""rosbag2's word for a topic whose last message late listeners get, too (transient local)"""
_NS = 1_000_000_000


def write(path: Path, table: ResultsTable) -> None:
    """Write `/joint_states` (sensor_msgs/JointState, the joints of `--to urdf`) and `/root_pose` (geometry_msgs/PoseStamped, of its
    base link in the frame `world`) for every frame, at its time since the recording's start, and the latter as `/tf`, too, by which
    viewers place the robot that `/robot_description` holds (the URDF's text, once). Lost frames have no messages.
    """
    from mcap.writer import Writer  # pyright: ignore[reportMissingImports]

    track = table.track
    names = track.parameter_names[6:]
    turns = quaternion_wxyz(track.T_world_bone[:, 0, :3, :3])
    with replacing(path) as part, part.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2", library="handtrack")
        description, state, pose, tf = (
            writer.register_channel(
                topic,
                "cdr",
                writer.register_schema(name, "ros2msg", text.encode()),
                {"offered_qos_profiles": _LATCHED} if topic == "/robot_description" else {},
            )
            for topic, name, text in (
                ("/robot_description", "std_msgs/msg/String", _TEXT),
                ("/joint_states", "sensor_msgs/msg/JointState", _STATE),
                ("/root_pose", "geometry_msgs/msg/PoseStamped", _POSE),
                ("/tf", "tf2_msgs/msg/TFMessage", _TRANSFORMS),
            )
        )
        begun = round(track.time_s[0] * _NS)
        writer.add_message(description, begun, _cdr(urdf_text(table.model)), begun)
        base = table.model.skeleton.bone_names[0]
        for i in np.flatnonzero(~table.is_lost):
            stamp = round(track.time_s[i] * _NS)
            header = _header(stamp, "world")
            placed = ("d", *track.T_world_bone[i, 0, :3, 3], *np.roll(turns[i], -1))
            for channel, message in (
                (state, _joint_state(stamp, names, track.parameters[i, 6:])),
                (pose, _cdr(*header, placed)),
                (tf, _cdr(("I", 1), *header, base, placed)),
            ):
                writer.add_message(channel, stamp, message, stamp, sequence=int(track.frame[i]))
        writer.finish()


def _cdr(*parts: str | tuple[Any, ...]) -> bytes:
    """Return texts, and numbers after their kind, as CDR, little-endian (OMG DDS-XTypes, plain CDR): each number stands at a multiple
    of its own size.
    """
    body = bytearray()
    for part in parts:
        data = part.encode() + b"\0" if isinstance(part, str) else b""
        kind, *values = ("I", len(data)) if isinstance(part, str) else part
        body += bytes(-len(body) % struct.calcsize(kind))
        body += struct.pack(f"<{len(values)}{kind}", *values) + data
    return b"\0\1\0\0" + bytes(body)


def _header(stamp: int, frame: str) -> tuple[Any, ...]:
    return ("i", stamp // _NS), ("I", stamp % _NS), frame


def _joint_state(stamp: int, names: tuple[str, ...], position: Floats[N]) -> bytes:
    turns = [("d", *position)] if len(position) else []
    counts = ("I", len(names)), ("I", len(position)), ("I", 0)
    return _cdr(*_header(stamp, ""), counts[0], *names, counts[1], *turns, counts[2], counts[2])
