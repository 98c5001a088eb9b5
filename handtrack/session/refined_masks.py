"""Masks made again once the pose is known: seeded by the outline of what was tracked."""

from __future__ import annotations

import glob
import json
from collections.abc import Sequence
from contextlib import suppress
from functools import cached_property, lru_cache
from pathlib import Path

import cv2
import numpy as np

from handtrack.arrays import D2, Bytes, Floats, H, W, pixel_grid
from handtrack.capture.masks.mask_correction import UNKNOWN_LEVEL
from handtrack.capture.masks.seeded import (
    HandSeeds,
    Seeded,
    SeededMasks,
    seeds_of_outline,
)
from handtrack.errors import HandtrackError
from handtrack.files.atomic import replace_text, replacing
from handtrack.geometry.camera import Camera
from handtrack.geometry.lens import remap_source
from handtrack.model.ellipsoids import model_mask
from handtrack.observation.agreement import outline_errors_px
from handtrack.observation.observation import Silhouette, undistort_silhouette
from handtrack.session.detection import camera_changes, views_with_images
from handtrack.session.layout import MASKS_FOLDER, inside
from handtrack.session.session import Session
from handtrack.session.session_file import CameraSettings
from handtrack.session.sources.views import View
from handtrack.tracking.frame.result import Status, TrackResult, model_of

_SURFACE_ERROR_M = 0.004
"""how far a person's outline is from the model's in the right pose: one and a half of `outline_sigma_mm`, and clothes of skin"""
_MARK = "made_by_handtrack.json"
_KNUCKLES = ("index_mcp", "middle_mcp", "ring_mcp", "little_mcp")


class MaskRefinement:
    """Masks of a session's images, by the poses of a track, written as files."""

    def __init__(self, session: Session, track: TrackResult, cameras: Sequence[str] = ()) -> None:
        """cameras: all that have images, unless named. Raises HandtrackError where there is nothing to look at, the track is no
        hand's, or files of others would be written over.
        """
        self.session = session
        self._made: list[Path] = []
        self._model = model_of(track, "the track")
        if self._model.kind != "hand":
            raise HandtrackError(
                f"the track is of the model {track.model}; masks are made of hands only."
            )
        self._track = track
        joints = [str(name) for name in track.joint_names]
        self._wrist = joints.index("wrist")
        self._knuckles = [joints.index(name) for name in _KNUCKLES]
        self.views = views_with_images(session, cameras)
        for view in self.views:
            folder = self._folder(view)
            if folder.is_dir() and any(folder.iterdir()) and not (folder / _MARK).exists():
                raise HandtrackError(
                    f"{folder} holds files that `handtrack masks` did not write, so it is left as it is. Move them away."
                )

    @cached_property
    def rows(self) -> dict[int, int]:
        """Frames that were tracked and not lost, and their rows in the track."""
        seen = enumerate(zip(self._track.frame, self._track.status, strict=True))
        return {int(frame): i for i, (frame, status) in seen if status != Status.LOST}

    def learn(self, view: View) -> SeededMasks:
        """Return what makes the masks of a camera."""
        method = view.settings.masks
        chosen = method if isinstance(method, Seeded) else Seeded()
        images = view.images
        assert images is not None
        return chosen.learned(
            len(view.session_frames(images.frames)),
            view.image,
            lambda frame: self.seeds(view, frame),
            images.where,
            view.settings.roi,
        )

    def seeds(self, view: View, frame: int) -> HandSeeds | None:
        """Return where the pose of a session's frame lets the hand be expected; None where it was not tracked."""
        row = self.rows.get(frame)
        if row is None:
            return None
        camera = view.camera
        joints = self._track.joint_positions[row]
        places = camera.project(joints[[self._wrist, *self._knuckles]])
        depth = float(camera.to_camera(joints[self._wrist])[2])
        if depth <= 0 or not np.isfinite(places).all():
            return None
        spread = np.trace(self._track.joint_covariance[row], axis1=1, axis2=2)
        off_m = float(np.hypot(_SURFACE_ERROR_M, np.sqrt(np.median(spread))))
        return seeds_of_outline(
            self.outline(view, row),
            off_m,
            float(camera.pixels_per_m(depth)),
            places[0],
            places[1:].mean(axis=0),
        )

    def outline(self, view: View, row: int) -> Bytes[H, W]:
        """Return 255 where the camera, with its lens, sees the model in a row of the track."""
        bones = self._model.bones(self._model.solver_params(self._track.parameters[row]))
        camera, ellipsoids = view.camera, self._model.ellipsoids["fine"].posed(bones)
        drawn = 255 * model_mask(camera, ellipsoids).astype(np.uint8)
        if not camera.is_distorted:
            return drawn
        return cv2.remap(drawn, _source(camera), None, cv2.INTER_NEAREST)  # type: ignore[return-value, call-overload]

    def write(self, view: View, masks: SeededMasks, frame: int) -> tuple[float, float] | None:
        """Write a frame's mask; return the share known and the overlap with the model where it is. None without image or pose."""
        seeds = self.seeds(view, frame)
        image = view.image(frame) if seeds is not None else None
        if seeds is None or image is None:
            return None
        mask = masks.mask(image, seeds)
        folder = self._folder(view)
        self._keep(folder / f"{frame:06d}.png", cv2.imencode(".png", mask)[1].tobytes())
        hand = self.outline(view, self.rows[frame]) > 0
        known = (mask != UNKNOWN_LEVEL) & ~seeds.behind(mask.shape)
        hand &= ~seeds.behind(mask.shape)
        both, either = (mask == 255) & hand & known, ((mask == 255) | hand) & known
        share = (hand & known).sum() / max(hand.sum(), 1)
        return float(share), float(both.sum() / max(either.sum(), 1))

    def _keep(self, path: Path, content: bytes) -> None:
        """Write a mask; where it cannot be, those that are new go again, and the file is named."""
        mark, is_new = path.parent / _MARK, not path.exists()
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            if not mark.exists():
                replace_text(mark, json.dumps({"writer": "handtrack masks"}) + "\n")
                self._made.append(mark)
            with replacing(path) as part:
                part.write_bytes(content)
        except OSError as error:
            self._take_back()
            raise HandtrackError(
                f"{error.filename or path}: the mask cannot be written ({error.strerror}). Those that were made before it are removed "
                "again; the session is as it was. Make room, and give the command again."
            ) from None
        if is_new:
            self._made.append(path)

    def _take_back(self) -> None:
        folders = {path.parent for path in self._made} | {self._folder(v) for v in self.views}
        for path in self._made:
            path.unlink(missing_ok=True)
        for folder in (*folders, self.session.folder / MASKS_FOLDER):
            with suppress(OSError):  # others' files are in it, or it never was
                folder.rmdir()

    def outline_errors_px(self, frames: Sequence[int]) -> dict[str, float]:
        """Return by camera how far outlines of the masks written are off as the others tell [px]; the median over frames."""
        off: dict[str, list[float]] = {view.name: [] for view in self.views}
        for frame in frames:
            seen = [s for view in self.views if (s := self._written(view, frame)) is not None]
            for silhouette, px in zip(seen, outline_errors_px(seen), strict=True):
                off[silhouette.camera.name].append(float(px))
        return {name: float(np.median(found)) if found else 0.0 for name, found in off.items()}

    def changes(self) -> dict[str, object]:
        """Return what session.toml is to say for these masks to be used, by dotted names."""

        def wanted(camera: CameraSettings) -> dict[str, object]:
            pattern = f"{MASKS_FOLDER}/{glob.escape(camera.name)}/*.png"
            return {"masks": pattern, "mask_unknown": UNKNOWN_LEVEL}

        return camera_changes(self.session, [view.name for view in self.views], wanted)

    def _written(self, view: View, frame: int) -> Silhouette | None:
        mask = cv2.imread(str(self._folder(view) / f"{frame:06d}.png"), cv2.IMREAD_GRAYSCALE)
        if mask is None:
            return None
        levels = np.asarray(mask, np.uint8)
        return undistort_silhouette(view.camera, levels, view.settings.roi, UNKNOWN_LEVEL)

    def _folder(self, view: View) -> Path:
        return inside(self.session.folder, f"{MASKS_FOLDER}/{view.name}", str(self.session.folder))


@lru_cache(maxsize=16)
def _source(camera: Camera) -> Floats[H, W, D2]:
    """Return the place in the undistorted image that each pixel shows."""
    return remap_source(camera.undistort_points(pixel_grid(camera.size)))
