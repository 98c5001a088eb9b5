"""MCAP: joint states and the root's pose as ROS 2 messages."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from handtrack.arrays import D3, D4, Floats, N
from handtrack.export.table import ResultsTable
from handtrack.files.atomic import replacing
from handtrack.geometry.rotation import quaternion_wxyz

_HEADER = """std_msgs/Header header
{fields}
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
_STATE = _HEADER.format(
    fields="string[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort"
)
_POSE = (
    _HEADER.format(fields="geometry_msgs/Pose pose")
    + "=" * 80
    + "\nMSG: geometry_msgs/Pose\ngeometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n"
    + "=" * 80
    + "\nMSG: geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z\n"
    + "=" * 80
    + "\nMSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w\n"
)
_NS = 1_000_000_000


def write(path: Path, table: ResultsTable) -> list[Path]:
    """Write `/joint_states` (sensor_msgs/JointState, the joints of `--to urdf`) and `/root_pose` (geometry_msgs/PoseStamped, of its
    base link in the frame `world`) for every frame, at its time since the recording's start. Lost frames have no messages.
    """
    from mcap.writer import Writer  # pyright: ignore[reportMissingImports]

    track = table.track
    names = track.parameter_names[6:]
    turns = quaternion_wxyz(track.T_world_bone[:, 0, :3, :3])
    with replacing(path) as part, part.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2", library="handtrack")
        state, pose = (
            writer.register_channel(
                topic, "cdr", writer.register_schema(name, "ros2msg", text.encode())
            )
            for topic, name, text in (
                ("/joint_states", "sensor_msgs/msg/JointState", _STATE),
                ("/root_pose", "geometry_msgs/msg/PoseStamped", _POSE),
            )
        )
        for i in np.flatnonzero(~table.is_lost):
            stamp = round(track.time_s[i] * _NS)
            for channel, message in (
                (state, _joint_state(stamp, names, track.parameters[i, 6:])),
                (pose, _pose(stamp, track.T_world_bone[i, 0, :3, 3], turns[i])),
            ):
                writer.add_message(channel, stamp, message, stamp, sequence=int(track.frame[i]))
        writer.finish()
    return [path]


class _Message:
    """CDR, little-endian (OMG DDS-XTypes, plain CDR): each number stands at a multiple of its own size."""

    def __init__(self, stamp: int, frame: str) -> None:
        self._body = bytearray()
        self.pack("i", stamp // _NS)
        self.pack("I", stamp % _NS)
        self.text(frame)

    def pack(self, kind: str, *values: float | np.floating) -> None:
        self._body += bytes(-len(self._body) % struct.calcsize(kind))
        self._body += struct.pack(f"<{len(values)}{kind}", *values)

    def text(self, value: str) -> None:
        data = value.encode() + b"\0"
        self.pack("I", len(data))
        self._body += data

    @property
    def bytes(self) -> bytes:
        return b"\0\1\0\0" + bytes(self._body)


def _joint_state(stamp: int, names: tuple[str, ...], position: Floats[N]) -> bytes:
    message = _Message(stamp, "")
    message.pack("I", len(names))
    for name in names:
        message.text(name)
    message.pack("I", len(position))
    if len(position):
        message.pack("d", *position)
    message.pack("I", 0)
    message.pack("I", 0)
    return message.bytes


def _pose(stamp: int, place: Floats[D3], wxyz: Floats[D4]) -> bytes:
    message = _Message(stamp, "world")
    message.pack("d", *place, *np.roll(wxyz, -1))
    return message.bytes
