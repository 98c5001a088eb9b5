"""What a calibration is worth, in numbers and plain words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import combinations
from typing import Any

import numpy as np

from handtrack.arrays import D2, Floats, N
from handtrack.capture.calibration.board_views import CameraViews
from handtrack.capture.calibration.bundle_adjustment import LENS, Refined
from handtrack.capture.calibration.rig_graph import common_frames
from handtrack.geometry.camera import Camera, CameraRig
from handtrack.geometry.rotation import rotation_vector

_GRID = (8, 6)  # cells of the image in which corners are counted
_WORST = 3


@dataclass(frozen=True)
class CalibrationReport:
    """All of it, as it is written in JSON."""

    board: str
    sigma_px: float
    """robust standard deviation of one coordinate of a corner"""
    cameras: tuple[dict[str, Any], ...]
    """see `camera_report`"""
    pairs: tuple[dict[str, Any], ...]
    """see `pair_reports`"""
    warnings: tuple[str, ...]
    contradictions: tuple[str, ...] = ()
    """pairs of cameras whose common views contradict one another: the rig is not to be used"""

    def as_dict(self) -> dict[str, Any]:
        """Return plain numbers, lists and texts, for JSON."""
        return {**asdict(self), "warnings": [*self.warnings, *self.doubts]}

    @property
    def doubts(self) -> tuple[str, ...]:
        """What the numbers themselves say against the calibration."""
        found: list[str] = []
        for camera in self.cameras:
            found += _doubts(camera)
        return tuple(found)

    def text(self) -> str:
        """Return the report as lines for a terminal."""
        lines = [
            f"board {self.board}; corners scatter by {self.sigma_px:.3f} px in each direction",
            "",
        ]
        lines.append("camera          images  found  used   rms px   alone   covered  worst views")
        for camera in self.cameras:
            worst = sorted(camera["views"], key=lambda view: -view["rms_px"])[:_WORST]
            shown = ", ".join(f"{_short(view)} {view['rms_px']:.2f}" for view in worst)
            lines.append(
                f"{camera['name']:15s} {camera['images']:6d} {camera['found']:6d} {camera['used']:5d}  {camera['rms_px']:7.3f} "
                f"{camera['rms_alone_px']:7.3f}  {100 * camera['coverage']:6.0f} %  {shown}"
            )
        for camera in self.cameras:
            numbers = [
                f"{name} {value:.5g}" + (f" ±{std:.2g}" if std else " fixed")
                for (name, value), std in zip(camera["lens"].items(), camera["lens_std"].values())
            ]
            lines += [
                "",
                f"{camera['name']}: " + "  ".join(numbers[:4]),
                "   " + "  ".join(numbers[4:]),
                f"   skew that would fit: {camera['skew_px']:.2f} ±{camera['skew_std_px']:.2f} px (held at 0)",
            ]
        if self.pairs:
            lines += ["", "pair                            baseline mm   angle °   common views"]
            lines += [
                f"{' – '.join(pair['names']):30s}  {1e3 * pair['baseline_m']:11.2f} {pair['angle_deg']:9.2f} {pair['common_views']:14d}"
                for pair in self.pairs
            ]
        notes = (*self.contradictions, *self.warnings, *self.doubts)
        return "\n".join([*lines, *(["", *(f"note: {note}" for note in notes)] if notes else [])])


def camera_report(
    camera: Camera,
    given: CameraViews,
    used: CameraViews,
    left: Sequence[Floats[N, D2]],
    rms_alone_px: float,
    refined: Refined,
    index: int,
) -> dict[str, Any]:
    """Return one camera's lens and how well its views fit; left: residuals of each view, shared ones first.

    `rms_px` is of all corners after the joint refinement, `rms_alone_px` of its lens fitted alone: much smaller means that cameras
    disagree. `coverage` is the share of the image's cells in which there is a corner. Of `lens_std`, 0 is held fixed; `skew_px` would
    fit, but is held at 0. A view that is `alone` is for the lens, not shared with other cameras.
    """
    views = (*used.shared, *used.alone)
    pixels = np.concatenate([view.pixels for view in views])
    cell = np.floor(pixels / np.array(camera.size) * _GRID).astype(int)
    covered = {tuple(c) for c in cell if (c >= 0).all() and (c < _GRID).all()}
    skew, skew_std = refined.skew[index].tolist()
    return {
        "name": camera.name,
        "images": given.tried,
        "found": len(given.shared) + len(given.alone),
        "used": len(views),
        "rms_px": _rms(np.concatenate(left)),
        "rms_alone_px": rms_alone_px,
        "coverage": len(covered) / (_GRID[0] * _GRID[1]),
        "lens": dict(zip(LENS, refined.state.lens[index].tolist())),
        "lens_std": dict(zip(LENS, refined.lens_std[index].tolist())),
        "skew_px": skew,
        "skew_std_px": skew_std,
        "views": [
            {
                "frame": view.frame,
                "source": view.source,
                "rms_px": _rms(off),
                "max_px": float(np.linalg.norm(off, axis=1).max()),
                "alone": i >= len(used.shared),
            }
            for i, (view, off) in enumerate(zip(views, left, strict=True))
        ],
    }


def pair_reports(
    rig: CameraRig, used: Sequence[CameraViews], disagreement: dict[tuple[str, str], float]
) -> tuple[dict[str, Any], ...]:
    """Return all pairs that share a view, or that placed a camera: their distance, and the angle between their directions."""
    found = []
    for (a, b), (seen_a, seen_b) in zip(combinations(rig, 2), combinations(used, 2), strict=True):
        common = len(common_frames(seen_a, seen_b))
        if common or {(a.name, b.name), (b.name, a.name)} & set(disagreement):
            turn = rotation_vector(b.rotation @ a.rotation.T)
            found.append(
                {
                    "names": (a.name, b.name),
                    "baseline_m": float(np.linalg.norm(a.centre - b.centre)),
                    "angle_deg": float(np.rad2deg(np.linalg.norm(turn))),
                    "common_views": common,
                }
            )
    return tuple(found)


def _rms(off: Floats) -> float:
    return float(np.sqrt((off**2).sum(axis=1).mean()))


def _short(view: dict[str, Any]) -> str:
    name = view["source"].replace("\\", "/").rsplit("/", 1)[-1]
    return name if name and ", frame" not in name else f"frame {view['frame']}"


def _doubts(camera: dict[str, Any]) -> list[str]:
    who = f"camera '{camera['name']}'"
    found = []
    if camera["rms_px"] > max(3 * camera["rms_alone_px"], 1.0):
        found.append(
            f"{who} fits by {camera['rms_alone_px']:.2f} px alone but by {camera['rms_px']:.2f} px together with "
            "the others: frames may not be synchronised, or a camera moved between views."
        )
        return found  # what else the numbers say follows from that
    if camera["rms_px"] > 1.0:
        found.append(
            f"{who} misses corners by {camera['rms_px']:.2f} px (below 0.5 is usual): blurred or moving "
            "boards, a board that is not flat, or a lens that needs more than k1 k2 p1 p2 k3."
        )
    if camera["used"] < 10:
        found.append(
            f"{who} has {camera['used']} views; 15 or more, in different tilts, are better."
        )
    if camera["coverage"] < 0.5:
        found.append(
            f"{who}: corners cover {100 * camera['coverage']:.0f} % of the image; its distortion is a guess elsewhere."
        )
    sure = camera["lens_std"]["fx"] / camera["lens"]["fx"]
    if sure > 0.01:
        found.append(
            f"{who}: its focal length is known to {100 * sure:.1f} % only; tilt the board more (30° to 45°)."
        )
    if abs(camera["skew_px"]) > max(4 * camera["skew_std_px"], 1.0):
        found.append(
            f"{who}: a skew of {camera['skew_px']:.2f} px would fit better, but skew is not modelled (OpenCV "
            "ignores it, and so would everything after). A warped board or print scaled unevenly looks the same."
        )
    return found
