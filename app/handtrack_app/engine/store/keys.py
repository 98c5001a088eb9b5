"""The values of a session's state, by their keys: what an action of the workbench may change."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from handtrack.store.history import Value
from handtrack.store.spans import Span
from handtrack.store.store import ACCEPTED, SPANS

POSE, SETTING, LIMITS = "pose", "setting", "limits"
"""kinds with a name behind a slash: `pose/12` {parameters, found} or, where undo went back to a pose that was only seen,
{parameters, carried}, or to which pins led {parameters, pinned}, or settings {parameters, refitted}; `setting/cloud.weight`;
`limits/index_mcp_flex` [low, high] [rad]"""
MASKS, CORRECTION = "masks", "correction"
"""likewise: `masks/cam0` {masks, roi} as session.toml has them; `correction/cam0/12` {png, carried} of the camera's own frame"""
PINS = "pins"
"""likewise: `pins/12` {pins} of a frame"""
SIZE, CLOUDS, FOREARM, START = "size", "clouds", "forearm", "start"
"""the hand's size {overall, parts, pending}; the table [clouds] {table}; whether the model has a forearm; where tracking
begins without a first pose {frame, parameters}. `accepted`: half-open pairs of frames"""


def pose(frame: int) -> str:
    """Return the key of a frame's pose."""
    return f"{POSE}/{frame}"


def setting(name: str) -> str:
    """Return the key of a setting."""
    return f"{SETTING}/{name}"


def limits(name: str) -> str:
    """Return the key of a joint parameter's limits."""
    return f"{LIMITS}/{name}"


def masks(camera: str) -> str:
    """Return the key of a camera's masks."""
    return f"{MASKS}/{camera}"


def correction(camera: str, own_frame: int) -> str:
    """Return the key of the correction of a frame of a camera."""
    return f"{CORRECTION}/{camera}/{own_frame}"


def pins(frame: int) -> str:
    """Return the key of a frame's pins."""
    return f"{PINS}/{frame}"


def accepted(frames: Iterable[int]) -> dict[str, Value]:
    """Return that these frames are accepted, and no others."""
    runs: list[list[int]] = []
    for frame in sorted(frames):
        if runs and runs[-1][1] == frame:
            runs[-1][1] = frame + 1
        else:
            runs.append([frame, frame + 1])
    return {ACCEPTED: runs or None}


def accepted_frames(runs: Value) -> frozenset[int]:
    """Return the frames that are accepted."""
    return frozenset(frame for first, stop in runs or () for frame in range(first, stop))


def spans(laid: Sequence[Span]) -> dict[str, Value]:
    """Return the current track, composed of spans of takes, the uppermost last."""
    return {SPANS: [[span.take, span.first, span.stop] for span in laid]}


def parts(key: str) -> tuple[str, str]:
    """Return the kind of a key and its name, empty for kinds without one."""
    kind, _, name = key.partition("/")
    return kind, name
