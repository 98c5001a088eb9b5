"""Which of a camera's own frames shows the moment of a session's frame: a camera may be late, have a rate of its own, or miss frames."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from handtrack.arrays import array_dataclass
from handtrack.session.formats.timestamps import FrameTimes, read_timestamps
from handtrack.session.layout import SESSION_FILE, matching_files
from handtrack.session.session_file import CameraSettings, RecordingSettings

_HALF = 0.501  # of a frame's duration: half, and what rounding adds
_OFF_GRID = 0.05  # of a frame: half of what the doctor's estimate resolves
_LOOKED_AT = 500  # frames by which it is told how far joined frames lie apart


@array_dataclass
class CameraTimes:
    """A camera's frames against a session's, joined by time."""

    line: FrameTimes
    """of the session's frames"""
    own: FrameTimes
    """of the camera's, by the session's clock"""

    def own_frame(self, frame: int) -> int | None:
        """Return the camera's frame nearest to a session's frame; None where none lies within half a frame of it."""
        time_s = self.line.time_of(frame)
        own = self.own.nearest(time_s)
        off = abs(self.own.time_of(own) - time_s)
        return own if own >= 0 and off <= _HALF / self.line.fps else None

    def frames_later(self, frame: int) -> float:
        """Return how many of the session's frames later the camera's image was taken; 0 where it has none."""
        own = self.own_frame(frame)
        return (
            0.0
            if own is None
            else (self.own.time_of(own) - self.line.time_of(frame)) * self.line.fps
        )

    @property
    def note(self) -> str:
        """That the frames that are joined do not show the same moments, in a sentence; empty where they do."""
        joined = [f for f in range(_LOOKED_AT) if self.own_frame(f) is not None]
        off = float(np.mean([abs(self.frames_later(f)) for f in joined])) if joined else 0.0
        if off < _OFF_GRID:
            return ""
        return (
            f"its frames lie {off:.2g} of a frame ({1e3 * off / self.line.fps:.2g} ms) from the session's on average, by `lag_s`, "
            "`fps` or time stamps. The nearest whole frame is taken, and the hand is predicted "
            "at that frame's own time. A first pose leaves this out."
        )

    def frames(self, own: range) -> range:
        """Return the session's frames from 0 to the one that shows the last of the camera's."""
        return range(self.line.nearest(self.own.time_of(own.stop - 1)) + 1) if own else own


def session_times(
    folder: Path, recording: RecordingSettings, cameras: Sequence[CameraSettings]
) -> tuple[FrameTimes, dict[str, CameraTimes]]:
    """Return the times of a session's frames that session.toml and the file it names say, and how those of cameras whose frames are
    not simply numbered like them belong to them.

    The session's frames are those of the first camera with time stamps; without any, they come `fps` times a second. A
    camera without time stamps begins with the session. Raises HandtrackError.
    """
    stamps: dict[str, FrameTimes] = {}
    if recording.timestamps is not None:
        where = f"{folder / SESSION_FILE}, [session], timestamps"
        path = matching_files(folder, recording.timestamps, where)[0]
        stamps = read_timestamps(path, {c.name: c.fps or recording.fps for c in cameras})
    first = next((camera for camera in cameras if camera.name in stamps), None)
    if first is None:
        assert recording.fps is not None
        line = FrameTimes(recording.fps)
    else:
        line = stamps[first.name].later(-(first.lag_s or 0.0))
    joined: dict[str, CameraTimes] = {}
    for camera in cameras:
        own, lag_s = stamps.get(camera.name), camera.lag_s or 0.0
        if own is None and camera.fps is not None:
            own = FrameTimes(camera.fps).later(line.time_of(0))
        if camera is not first and (own is not None or lag_s):
            joined[camera.name] = CameraTimes(line, (own or line).later(-lag_s))
    return line, joined
