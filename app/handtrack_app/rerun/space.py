"""What stands in space of a tracked frame, for rerun: cameras, skeleton, flesh and cloud; and where the viewer opens."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from handtrack.arrays import D2, D3, D4, Axes, B, Bytes, E, Floats, N
from handtrack.diagnostics.review import Stretch
from handtrack.geometry.camera import Camera
from handtrack.geometry.rotation import quaternion_wxyz
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.kinematics import BonePoses
from handtrack.tracking.frame.reason import Reason
from handtrack.tracking.frame.result import FrameResult, Status

if TYPE_CHECKING:
    from rerun import RecordingStream
    from rerun.blueprint import TimePanel

_MOST_POINTS = 20_000  # of a cloud, evenly spread: enough to see it by
_LONG_MM = 80.0  # a camera's picture stands so far before it
_SHOWN = 20  # stretches of the queue


@dataclass(frozen=True, eq=False)
class SpaceEntry:
    """A hand in space, world [m]."""

    bones: Floats[B, D2, D3]
    """where each begins and ends"""
    centre: Floats[E, D3]
    half_sizes: Floats[E, D3]
    quaternion_xyzw: Floats[E, D4]
    """of the flesh's ellipsoids"""
    cloud: Floats[N, D3] = field(default_factory=lambda: np.zeros((0, 3)))
    residuals: Mapping[str, tuple[Floats[N, D3], Floats[N]]] = field(default_factory=dict)
    """places (N, 3) and signed values (N,), full at −1 and 1, by kind"""

    @classmethod
    def of(
        cls,
        model: ArticulatedModel,
        bones: BonePoses,
        cloud: Floats[N, D3] | None,
        residuals: Mapping[str, tuple[Floats[N, D3], Floats[N]]],
    ) -> SpaceEntry:
        """Return a posed model, what a cloud had of it, and what is left between them."""
        along = bones.rotation[:, :, 1] * model.skeleton.length[:, None]
        flesh = model.flesh["fine"].posed(bones)
        points = np.zeros((0, 3)) if cloud is None else cloud[:: max(len(cloud) // _MOST_POINTS, 1)]
        return cls(
            np.stack([bones.position, bones.position + along], axis=1), flesh.centre, flesh.radii,
            quaternion_wxyz(flesh.rotation)[:, [1, 2, 3, 0]], points, residuals,
        )  # fmt: skip


@dataclass(frozen=True)
class JudgedFrame:
    """How far a frame can be trusted; without its arrays, for there may be many."""

    frame: int
    status: Status
    reason: Reason | None
    p_off_25mm: float

    @classmethod
    def of(cls, result: FrameResult) -> JudgedFrame:
        """Return what a result says."""
        return cls(result.frame, result.status, result.reason, result.p_off_25mm)


def log_cameras(recording: RecordingStream, cameras: Sequence[Camera]) -> None:
    """Record where cameras stand, once for all frames."""
    import rerun as rr

    for camera in cameras:
        place = rr.Transform3D(translation=camera.centre, mat3x3=camera.rotation.T)
        recording.log(f"world/cameras/{camera.name}", place, static=True)
        eye = rr.Pinhole(
            image_from_camera=camera.matrix, resolution=camera.size, image_plane_distance=_LONG_MM / 1e3
        )  # fmt: skip
        recording.log(f"world/cameras/{camera.name}", eye, static=True)


def log_space(recording: RecordingStream, entry: SpaceEntry) -> None:
    """Record a hand in space, at the time that is set."""
    import rerun as rr

    recording.log("world/skeleton", rr.LineStrips3D(entry.bones, radii=0.0008, colors=[40, 90, 200]))  # fmt: skip
    flesh = rr.Ellipsoids3D(
        centers=entry.centre, half_sizes=entry.half_sizes, quaternions=entry.quaternion_xyzw,
        colors=[230, 180, 150], fill_mode="solid",
    )  # fmt: skip
    recording.log("world/flesh", flesh)
    if len(entry.cloud):
        cloud = rr.Points3D(entry.cloud, radii=0.0006, colors=[0, 158, 115])
        recording.log("world/cloud", cloud)
    for kind, (points, values) in entry.residuals.items():
        found = rr.Points3D(points, radii=0.0012, colors=signed_colours(values))
        recording.log(f"world/residual_{kind}", found)


def signed_colours(residual: Floats[*Axes]) -> Bytes[*Axes]:
    """Return colours, RGB last: red where the hand was seen and not predicted (+1), blue the other way, white at 0."""
    value = np.clip(np.nan_to_num(residual), -1.0, 1.0)
    fade = np.rint(255 * (1 - np.abs(value))).astype(np.uint8)
    full = np.full_like(fade, 255)
    red, blue = np.where(value >= 0, full, fade), np.where(value <= 0, full, fade)
    return np.stack([red, fade, blue], axis=-1)


def queue_text(queue: Sequence[Stretch]) -> str:
    """Return what is worth a look as Markdown, the worst first."""
    if not queue:
        return "No frame is lost or of low confidence."
    rows = [f"| {s.first}–{s.last} | {s.worst} | {s.words} |" for s in queue[:_SHOWN]]
    return "\n".join(["| frames | worst | why |", "|---|---|---|", *rows])


def worst_first(queue: Sequence[Stretch]) -> TimePanel:
    """Return a time panel that opens on the worst frame: rerun takes no time to begin at, but a selection to play in."""
    import rerun.blueprint as rrb
    from rerun.blueprint.components import AbsoluteTimeRange
    from rerun.encodings import TimeInt

    if not queue:
        return rrb.TimePanel(timeline="frame")
    at = TimeInt(seq=queue[0].worst)
    return rrb.TimePanel(
        timeline="frame", time_selection=AbsoluteTimeRange(at, at),
        loop_mode="selection", play_state="playing",
    )  # fmt: skip
