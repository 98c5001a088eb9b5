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
class ViewError:
    """One view of one camera."""

    frame: int
    source: str
    rms_px: float
    max_px: float
    alone: bool
    """for the lens alone, not shared with other cameras"""


@dataclass(frozen=True)
class CameraReport:
    """One camera's lens and how well its views fit."""

    name: str
    images: int
    found: int
    used: int
    rms_px: float
    """of all corners after the joint refinement"""
    rms_alone_px: float
    """of its lens fitted alone: much smaller than the former means cameras disagree"""
    coverage: float
    """share of the image's cells in which there is a corner"""
    lens: dict[str, float]
    lens_std: dict[str, float]
    """standard deviations; 0 where held fixed"""
    skew_px: float
    """skew that would fit; it is held at 0"""
    skew_std_px: float
    views: tuple[ViewError, ...]


@dataclass(frozen=True)
class PairReport:
    """Two cameras."""

    names: tuple[str, str]
    baseline_m: float
    angle_deg: float
    """between their viewing directions"""
    common_views: int


@dataclass(frozen=True)
class CalibrationReport:
    """All of it."""

    board: str
    sigma_px: float
    """robust standard deviation of one coordinate of a corner"""
    cameras: tuple[CameraReport, ...]
    pairs: tuple[PairReport, ...]
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
            worst = sorted(camera.views, key=lambda view: -view.rms_px)[:_WORST]
            shown = ", ".join(f"{_short(view)} {view.rms_px:.2f}" for view in worst)
            lines.append(
                f"{camera.name:15s} {camera.images:6d} {camera.found:6d} {camera.used:5d}  {camera.rms_px:7.3f} "
                f"{camera.rms_alone_px:7.3f}  {100 * camera.coverage:6.0f} %  {shown}"
            )
        for camera in self.cameras:
            numbers = [
                f"{name} {camera.lens[name]:.5g}"
                + (f" ±{camera.lens_std[name]:.2g}" if camera.lens_std[name] else " fixed")
                for name in LENS
            ]
            lines += [
                "",
                f"{camera.name}: " + "  ".join(numbers[:4]),
                "   " + "  ".join(numbers[4:]),
            ]
            lines.append(
                f"   skew that would fit: {camera.skew_px:.2f} ±{camera.skew_std_px:.2f} px (held at 0)"
            )
        if self.pairs:
            lines += ["", "pair                            baseline mm   angle °   common views"]
            lines += [
                f"{' – '.join(pair.names):30s}  {1e3 * pair.baseline_m:11.2f} {pair.angle_deg:9.2f} {pair.common_views:14d}"
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
) -> CameraReport:
    """Return the report of one camera; left: residuals of each view, shared ones first."""
    views = (*used.shared, *used.alone)
    pixels = np.concatenate([view.pixels for view in views])
    cell = np.floor(pixels / np.array(camera.size) * _GRID).astype(int)
    covered = {tuple(c) for c in cell if (c >= 0).all() and (c < _GRID).all()}
    skew, skew_std = refined.skew[index]
    return CameraReport(
        name=camera.name,
        images=given.tried,
        found=len(given.shared) + len(given.alone),
        used=len(views),
        rms_px=_rms(np.concatenate(left)),
        rms_alone_px=rms_alone_px,
        coverage=len(covered) / (_GRID[0] * _GRID[1]),
        lens=dict(zip(LENS, map(float, refined.state.lens[index]))),
        lens_std=dict(zip(LENS, map(float, refined.lens_std[index]))),
        skew_px=float(skew),
        skew_std_px=float(skew_std),
        views=tuple(
            ViewError(
                view.frame,
                view.source,
                _rms(off),
                float(np.linalg.norm(off, axis=1).max()),
                i >= len(used.shared),
            )
            for i, (view, off) in enumerate(zip(views, left, strict=True))
        ),
    )


def pair_reports(
    rig: CameraRig, used: Sequence[CameraViews], disagreement: dict[tuple[str, str], float]
) -> tuple[PairReport, ...]:
    """Return all pairs that share a view, or that placed a camera."""
    found = []
    for (a, b), (seen_a, seen_b) in zip(combinations(rig, 2), combinations(used, 2), strict=True):
        common = len(common_frames(seen_a, seen_b))
        if common or {(a.name, b.name), (b.name, a.name)} & set(disagreement):
            turn = rotation_vector(b.rotation @ a.rotation.T)
            found.append(
                PairReport(
                    (a.name, b.name),
                    float(np.linalg.norm(a.centre - b.centre)),
                    float(np.rad2deg(np.linalg.norm(turn))),
                    common,
                )
            )
    return tuple(found)


def _rms(off: Floats) -> float:
    return float(np.sqrt((off**2).sum(axis=1).mean()))


def _short(view: ViewError) -> str:
    name = view.source.replace("\\", "/").rsplit("/", 1)[-1] if view.source else ""
    return name if name and ", frame" not in name else f"frame {view.frame}"


def _doubts(camera: CameraReport) -> list[str]:
    who = f"camera '{camera.name}'"
    found = []
    if camera.rms_px > max(3 * camera.rms_alone_px, 1.0):
        found.append(
            f"{who} fits by {camera.rms_alone_px:.2f} px alone but by {camera.rms_px:.2f} px together with "
            "the others: frames may not be synchronised, or a camera moved between views."
        )
        return found  # what else the numbers say follows from that
    if camera.rms_px > 1.0:
        found.append(
            f"{who} misses corners by {camera.rms_px:.2f} px (below 0.5 is usual): blurred or moving "
            "boards, a board that is not flat, or a lens that needs more than k1 k2 p1 p2 k3."
        )
    if camera.used < 10:
        found.append(f"{who} has {camera.used} views; 15 or more, in different tilts, are better.")
    if camera.coverage < 0.5:
        found.append(
            f"{who}: corners cover {100 * camera.coverage:.0f} % of the image; its distortion is a guess elsewhere."
        )
    sure = camera.lens_std["fx"] / camera.lens["fx"]
    if sure > 0.01:
        found.append(
            f"{who}: its focal length is known to {100 * sure:.1f} % only; tilt the board more (30° to 45°)."
        )
    if abs(camera.skew_px) > max(4 * camera.skew_std_px, 1.0):
        found.append(
            f"{who}: a skew of {camera.skew_px:.2f} px would fit better, but skew is not modelled (OpenCV "
            "ignores it, and so would everything after). A warped board or print scaled unevenly looks the same."
        )
    return found
