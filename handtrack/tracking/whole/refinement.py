"""What was found that all frames of a recording share, as it is written and told."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

import msgspec
import numpy as np

from handtrack.arrays import D3, Floats
from handtrack.geometry.camera import Camera
from handtrack.geometry.rotation import rotation_matrix, rotation_vector
from handtrack.model.articulated import HandScale
from handtrack.tracking.size.cameras import (
    BIAS,
    NUMBERS,
    SHIFTED,
    TURNED,
    WIDER,
    ZOOMED,
    CameraChanges,
)
from handtrack.tracking.size.estimate import WholeEstimate

_SURE = 3.0
"""standard deviations by which a camera must be off to be named: of which camera it is, too"""
_WORDS = (
    ("rotation {0:.2f}° (± {1:.2f})", "turned by {0:.1f}°", 0.3),
    ("position {0:.1f} mm (± {1:.1f})", "shifted by {0:.0f} mm", 3.0),
    ("focal length {0:+.2f} % (± {1:.2f})", "of a focal length {0:+.1f} % off", 0.7),
    ("time {0:.2f} frames {2} (± {1:.2f})", "{0:.1f} frames {2}", 0.25),
)
"""figures, words, and the least that is worth them: more than a usual calibration and pictures of one moment are off by"""


@dataclass(frozen=True)
class CameraError:
    """By how much a camera is off its calibration, as the hand in all frames says, and standard deviations."""

    name: str
    turn_deg: tuple[float, float, float]
    """a rotation vector in world axes by which it is turned about its centre"""
    shift_mm: tuple[float, float, float]
    """of its centre, world axes"""
    zoom_percent: float
    """of its focal length"""
    late_frames: float
    """its picture of a frame shows what was so many frames before"""
    std: tuple[float, ...]
    """of these eight and the next, in their units"""
    wider_mm: float = 0.0
    """its masks are wider than the hand by so much, all along the outline"""
    detector_bias_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """by which it seems to be turned further, for a detector sees all joints to one side"""

    def corrected(self, camera: Camera, by_joints: bool = False) -> Camera:
        """Return the camera, as it was calibrated, as it must have been to see what it saw, or what a detector saw in its images."""
        values = np.zeros((1, NUMBERS))
        values[0, TURNED] = -np.deg2rad(self.turn_deg)
        values[0, BIAS] = -np.deg2rad(self.detector_bias_deg)
        values[0, ZOOMED] = 0.01 * self.zoom_percent
        turned = CameraChanges((camera,), values, (0,)).corrected(by_joints)[0]
        centre = camera.centre + 1e-3 * np.array(self.shift_mm)
        return replace(turned, translation=-turned.rotation @ centre)

    def after(self, earlier: CameraError) -> CameraError:
        """Return the error against the calibration, where this one was found with `earlier` corrected."""
        turns = [rotation_matrix(np.deg2rad(one.turn_deg)) for one in (self, earlier)]
        zoom = (1 + 0.01 * self.zoom_percent) * (1 + 0.01 * earlier.zoom_percent)
        return replace(
            self,
            turn_deg=_three(np.rad2deg(rotation_vector(turns[0] @ turns[1]))),
            shift_mm=_three(np.add(self.shift_mm, earlier.shift_mm)),
            zoom_percent=round(100 * (zoom - 1), 4),
            late_frames=round(self.late_frames + earlier.late_frames, 4),
            std=tuple(now or then for now, then in zip(self.std, earlier.std, strict=True)),
        )

    @property
    def is_of_time_alone(self) -> bool:
        """Whether nothing of the calibration was estimated, so that another cause may look like a time offset."""
        return not any(self.std[:7])

    @property
    def figures(self) -> str:
        """What was estimated, with standard deviations."""
        return self._listed([(size, std, figure) for size, std, (figure, _, _) in self._off if std])

    @property
    def words(self) -> str:
        """What is surely off, in words; empty where nothing is."""
        off = self._listed(
            [
                (size, std, words)
                for size, std, (_, words, least) in self._off
                if abs(size) > max(_SURE * std, least)
            ]
        )
        return f"camera '{self.name}' is {off}" if off else ""

    @property
    def _off(self) -> list[tuple[float, float, tuple[str, str, float]]]:
        """How much each of _WORDS is off, and its standard deviation."""
        turn, shift = np.linalg.norm(self.turn_deg), np.linalg.norm(self.shift_mm)
        sizes = float(turn), float(shift), self.zoom_percent, abs(self.late_frames)
        std = max(self.std[:3]), max(self.std[3:6]), *self.std[6:8]
        return list(zip(sizes, std, _WORDS, strict=True))

    def _listed(self, parts: Sequence[tuple[float, float, str]]) -> str:
        side = "late" if self.late_frames > 0 else "early"
        return ", ".join(words.format(size, std, side) for size, std, words in parts)


@dataclass(frozen=True)
class Refinement:
    """How the whole recording was refined: the reason of its end, its sweeps, and what the cameras are off by."""

    why: str
    sweeps: int
    cameras: tuple[CameraError, ...] = ()
    scale: HandScale | None = None
    """the person, where something of them was found too"""

    @classmethod
    def of(cls, found: WholeEstimate, by_cameras: WholeEstimate | None = None) -> Refinement:
        """Return what an estimate found; by_cameras: the one that corrected the cameras, if it was another."""
        corrected_by = by_cameras or found
        changes, reported = corrected_by.cameras, np.eye(NUMBERS)
        if not changes.masked:
            reported[TURNED, BIAS] = np.eye(3)
            reported[BIAS, BIAS] = 0.0
        changes = replace(changes, values=changes.values @ reported.T)
        std, own = np.zeros_like(changes.values), reported[:, changes.free]
        each = own.shape[1]
        for c, first in enumerate(range(0, changes.count, each)):
            at = slice(first, first + each)
            known = corrected_by.shared_covariance[at, at]
            std[c] = np.sqrt(np.diag(own @ known @ own.T))
        units = np.array([180.0 / np.pi] * 3 + [1e3] * 3 + [100.0, 1.0, 1e3])
        cameras = []
        for camera, corrected, values, spread, late in zip(
            changes.cameras, changes.corrected(), changes.values, std, changes.late, strict=True
        ):
            turn = -units[TURNED] * values[TURNED]
            shift = units[SHIFTED] * (corrected.centre - camera.centre)
            cameras.append(
                CameraError(
                    camera.name, _three(turn), _three(shift), float(units[ZOOMED] * values[ZOOMED]),
                    -float(late), tuple((units * spread[:BIAS.start]).round(4).tolist()), float(units[WIDER] * values[WIDER]),
                    _three(-units[TURNED] * values[BIAS]),
                )
            )  # fmt: skip
        return cls(found.why, found.sweeps, tuple(cameras), found.scale)

    @classmethod
    def read(cls, text: str) -> Refinement:
        """Return what `text` holds. Raises ValueError for anything else."""
        return msgspec.convert(json.loads(text), cls)

    def corrected(self, camera: Camera) -> Camera:
        """Return a camera of the rig as the whole recording says it was; as it is where nothing was corrected."""
        found = next((one for one in self.cameras if one.name == camera.name), None)
        return camera if found is None else found.corrected(camera)

    @property
    def text(self) -> str:
        """The same as JSON."""
        return json.dumps(asdict(self), sort_keys=True)

    @property
    def words(self) -> list[str]:
        """What a person should know of it, in sentences; none where all is well."""
        off = [camera.words for camera in self.cameras if camera.words]
        if not off:
            return []
        return [
            f"{'; '.join(off)}, as the hand in all frames says: poses are corrected for it, the calibration stays as it is. *Apply "
            "correction* in the workbench (tab Review) uses it from now on; `handtrack calibrate` makes the calibration anew, and "
            "`lag_s` in session.toml sets a camera's time offset."
        ]


def _three(values: Sequence[float] | Floats[D3]) -> tuple[float, float, float]:
    x, y, z = (round(float(value), 4) for value in values)
    return x, y, z
