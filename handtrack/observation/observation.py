"""Observation: all that was seen of one frame, as frozen data (silhouettes, images, keypoints, a cloud)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import field
from pathlib import Path
from typing import Any

import numpy as np

from handtrack.arrays import (
    D2,
    D3,
    Array,
    Axes,
    Bytes,
    F,
    Floats,
    H,
    Ints,
    J,
    K,
    W,
    array_dataclass,
    check_shape,
)
from handtrack.capture.clouds.point_cloud import PointCloud
from handtrack.errors import HandtrackError, unknown_name
from handtrack.geometry.camera import Camera
from handtrack.observation.lens_maps import Roi, lens_maps
from handtrack.observation.pins import ImagePins

CloudView = tuple[Camera, ...] | Floats[K, D3]
"""cameras that must all see a point for it to be measured, or their centres (K, 3), world [m], where it is not known what their images show"""
CLOUD_NAME = ""
"""a cloud's name among those of cameras"""
UNKNOWN = np.float32(-1.0)
"""in a silhouette's mask: hand or background, nobody knows; the lowest of its values, and the only one below 0"""

_BYTE = 255.0
_BYTES_FROM = 128.0
"""a mask whose highest value is from here on holds bytes; between 1 and this it could be labels as well"""
_ROUNDING = 1e-5
"""by which resampling in float32 may leave [0, 1]"""


def coverage_of(mask: Array[H, W], size: tuple[int, int], who: str) -> Array[H, W]:
    """Return how much of each pixel the hand covers, float32 in [0, 1], UNKNOWN where nobody can
    tell.

    Parameters
    ----------
    mask
        Booleans; numbers 0 to 1; or 0 to 255, which is told by the highest of them. NaN and −1 mean
        unknown.
    size
        Width, height [px] that it must have.
    who
        Names it in errors.

    Raises
    ------
    HandtrackError
        For another shape, and for numbers that may mean anything: labels, distances, a picture.
    """
    mask = np.asarray(mask)
    width, height = size
    if mask.shape != (height, width):
        raise HandtrackError(
            f"{who}: it has the shape {mask.shape}, expected {(height, width)}, rows × columns of the camera's image. "
            f"{_advice(mask, size)}"
        )
    if mask.dtype == bool:
        return mask.astype(np.float32)
    if mask.dtype.kind not in "uif":
        raise HandtrackError(f"{who}: it holds {mask.dtype}; expected booleans or numbers.")
    low, high = (float(mask.min()), float(mask.max())) if mask.size else (0.0, 0.0)
    values = mask.astype(np.float32, copy=False)
    if np.isnan(low):
        values = np.where(np.isnan(values), UNKNOWN, values)
        low, high = float(values.min()), float(values.max())
    if high > 1.0 + _ROUNDING:
        if not _BYTES_FROM <= high <= _BYTE:
            raise HandtrackError(
                f"{who}: its highest value is {high:g}; expected booleans, 0 to 1, or 0 to 255. Labels are no mask: give "
                "`labels == hand`."
            )
        values = (
            np.where(values < 0, values, values / np.float32(_BYTE))
            if low < 0
            else values / np.float32(_BYTE)
        )
    if low < 0 and not ((values >= 0) | (np.abs(values - UNKNOWN) < _ROUNDING)).all():
        raise HandtrackError(
            f"{who}: its lowest value is {low:g}; expected 0 for background, or −1 (or NaN) where nobody can tell."
        )
    return np.minimum(values, np.float32(1.0)) if high > 1.0 else values


def _advice(mask: Array, size: tuple[int, int]) -> str:
    if mask.ndim == 3:
        return "Give one channel: `mask[..., 0]`."
    if mask.shape == size:
        return "Rows and columns are exchanged: give `mask.T`."
    return "Scale the camera to the mask: `camera.scaled((width, height))`."


@array_dataclass
class Silhouette:
    """Where one camera saw the hand, in the pixels of its undistorted image.

    `Silhouette(camera, mask)` is enough: a mask of the camera's real image, of booleans, 0 to 1, or 0 to 255. Where the lens
    distorts, mask and camera are undistorted. Raises HandtrackError for another size, or numbers that are no mask.
    """

    camera: Camera
    """without distortion; its size is the mask's."""
    mask: Array[H, W]
    """float32 in [0, 1]: how much of each undistorted pixel the hand covers; UNKNOWN where nobody can tell, which counts as
    little as what was not observed."""
    valid: Ints[H, D2] = field(default_factory=lambda: np.zeros((0, 2), np.int32))
    """int32: per row the half-open column span that was really observed; equal ends where none. Left out: all that the
    camera saw."""
    off_px: float = 0.0
    """how far the outline is off, beyond what outlines usually are, as the other cameras tell: it weighs less by that"""

    def __post_init__(self) -> None:
        """Read the mask's numbers, and undistort it where the lens distorts."""
        check_kind(self.camera, Camera, "camera of a Silhouette", "Silhouette(camera, mask)")
        if isinstance(self.mask, str | Path):
            raise HandtrackError(
                f"mask of camera '{self.camera.name}': a file name, {self.mask!s}; expected the image. Read it first: "
                "cv2.imread(name, cv2.IMREAD_GRAYSCALE)."
            )
        mask = coverage_of(self.mask, self.camera.size, f"mask of camera '{self.camera.name}'")
        object.__setattr__(self, "mask", mask)
        if len(self.valid) and not self.camera.is_distorted:
            return
        maps, unknown = lens_maps(self.camera, None), mask == UNKNOWN
        mask = maps.straightened(np.maximum(mask, np.float32(0.0)))
        if unknown.any():
            mask[maps.straightened(unknown.astype(np.float32)) > 0] = UNKNOWN
        object.__setattr__(self, "mask", mask)
        object.__setattr__(self, "camera", maps.camera)
        if not len(self.valid):
            object.__setattr__(self, "valid", maps.valid)

    @property
    def fills_image(self) -> bool:
        """Whether more than half of the image is hand: a mask that is inverted, or white all over, outlines no hand."""
        return float((self.mask > 0.5).mean()) > 0.5

    @property
    def known(self) -> Array[H, W]:
        """Whether each pixel was observed, and is known to be hand or background."""
        column = np.arange(self.mask.shape[1])
        seen = (column >= self.valid[:, :1]) & (column < self.valid[:, 1:])
        return seen & (self.mask >= 0)

    def at(self, points: Floats[*Axes, D3]) -> tuple[Array[*Axes], Array[*Axes], Array[*Axes]]:
        """Return whether the mask covers points, whether that is known there, or nobody knows of what was observed."""
        pixel = np.rint(np.nan_to_num(self.camera.project(points), nan=-1.0)).astype(int)
        height, width = self.mask.shape
        row, column = np.clip(pixel[..., 1], 0, height - 1), np.clip(pixel[..., 0], 0, width - 1)
        begin, end = np.moveaxis(self.valid[row], -1, 0)
        known = (pixel[..., 1] == row) & (begin <= pixel[..., 0]) & (pixel[..., 0] < end)
        covered = self.mask[row, column]
        return covered > 0.5, known & (covered >= 0), known & (covered < 0)

    @property
    def outline_px(self) -> float:
        """How long the outline is where it was observed [px]: Crofton, by crossings of rows and columns."""
        hand, known = self.mask > 0.5, self.known
        down = (hand[1:] != hand[:-1]) & known[1:] & known[:-1]
        across = (hand[:, 1:] != hand[:, :-1]) & known[:, 1:] & known[:, :-1]
        return 0.25 * np.pi * float(down.sum() + across.sum())


@array_dataclass
class ImageView:
    """What one camera saw, undistorted."""

    camera: Camera
    """without distortion; its size is the image's."""
    pixels: Array[H, W, D3]
    """uint8, BGR; beyond the real image its border goes on"""


@array_dataclass
class Keypoints:
    """Points of the hand in space, by joint name."""

    names: tuple[str, ...]
    positions: Floats[J, D3]
    """world [m], NaN where unknown."""
    sigma_m: float

    def __post_init__(self) -> None:
        """Take lists for arrays. Raises HandtrackError where they do not fit together."""
        _check_points(self, "positions", 3, np.asarray(self.sigma_m))

    @property
    def count(self) -> int:
        """How many are known."""
        return int(np.isfinite(self.positions).all(axis=1).sum())


@array_dataclass
class ImageKeypoints:
    """Points of the hand in one camera's image, by joint name. Where the lens distorts, pixels and camera are undistorted."""

    camera: Camera
    """without distortion."""
    names: tuple[str, ...]
    pixels: Floats[J, D2]
    """[px], NaN where unknown."""
    sigma_px: Floats[J] | float
    """[px] standard deviation of each point in each direction; one number given stands for all"""

    def __post_init__(self) -> None:
        """Take lists for arrays, and undistort. Raises HandtrackError where they do not fit together."""
        how = "ImageKeypoints(camera, names, pixels, sigma_px)"
        check_kind(self.camera, Camera, "camera of ImageKeypoints", how)
        sigma = np.asarray(self.sigma_px, float)
        _check_points(self, "pixels", 2, sigma)
        object.__setattr__(self, "sigma_px", np.broadcast_to(sigma, len(self.names)))
        if self.camera.is_distorted:
            object.__setattr__(self, "pixels", self.camera.undistort_points(self.pixels))
            object.__setattr__(self, "camera", lens_maps(self.camera, None).camera)


@array_dataclass
class Observation:
    """One frame of a session. A view that is missing is simply absent."""

    frame: int
    time_s: float
    silhouettes: tuple[Silhouette, ...] = ()
    keypoints: tuple[Keypoints | ImageKeypoints, ...] = ()
    cloud: PointCloud | None = None
    cloud_views: tuple[CloudView, ...] = ()
    """what can have seen the cloud's points"""
    cloud_cameras: tuple[str, ...] = ()
    """those that measured the cloud: it has the mean of their times"""
    images: tuple[ImageView, ...] = ()
    """only where edges or intensity are looked at"""
    pins: tuple[ImagePins, ...] = ()
    """where a person said that joints and segments lie"""
    frames_later: Mapping[str, float] = field(default_factory=dict)
    """by camera, how many frames later than this one its image was taken, as far as is known"""
    terms: tuple[Any, ...] = ()
    """the caller's own costs of bone poses (`terms.term.ObservationTerm`), which count as they are"""
    priors: tuple[Any, ...] = ()
    """the caller's own costs of joint parameters (`terms.term.ParameterTerm`)"""

    def __post_init__(self) -> None:
        """Take lists, and one for several. Raises HandtrackError for what is of another kind."""
        check_kind(self.frame, (int, np.integer), "frame of an Observation", "a frame's number")
        seconds, where = "a finite number of seconds", f"time_s of frame {self.frame}"
        check_kind(self.time_s, (int, float, np.number), where, seconds)
        if not np.isfinite(self.time_s):
            raise HandtrackError(f"{where}: {self.time_s}; expected {seconds}.")
        for name, (kinds, how) in _PARTS.items():
            value = getattr(self, name)
            several = tuple(value) if isinstance(value, list | tuple) else (value,)
            for one in several:
                check_kind(one, kinds, f"{name} of frame {self.frame}", how)
            object.__setattr__(self, name, several)
        if self.cloud is not None:
            how = "PointCloud(points), of shape (N, 3) [m]"
            check_kind(self.cloud, PointCloud, f"cloud of frame {self.frame}", how)

    @property
    def later(self) -> dict[str, float]:
        """`frames_later`, and the same of the cloud."""
        cloud = [self.frames_later.get(name, 0.0) for name in self.cloud_cameras]
        return {**self.frames_later, CLOUD_NAME: sum(cloud) / max(len(cloud), 1)}

    @property
    def image_keypoints(self) -> list[ImageKeypoints]:
        """The keypoints in images, without those in space."""
        return [one for one in self.keypoints if isinstance(one, ImageKeypoints)]

    @classmethod
    def sequence(
        cls, cameras: Iterable[Camera], masks: Mapping[str, Array[F, H, W]], fps: float = 30.0
    ) -> list[Observation]:
        """Return the observations of a recording's masks in memory.

        Parameters
        ----------
        cameras : those that took them, of a rig or a list
        masks : by camera's name, (F, H, W) uint8 or bool, 0 background, of the real images; as many frames of each
        fps : frames a second

        Raises
        ------
        HandtrackError for a name that is no camera's, for cameras of different numbers of frames, and for no rate.
        """
        check_kind(masks, Mapping, "masks", "those of each camera by its name: {'left': masks}")
        known = {camera.name: camera for camera in cameras}
        unknown = next((name for name in masks if name not in known), None)
        if unknown is not None:
            raise unknown_name("camera", unknown, tuple(known))
        counts = {name: len(frames) for name, frames in masks.items()}
        if len(set(counts.values())) > 1:
            told = ", ".join(f"{name} {count}" for name, count in counts.items())
            raise HandtrackError(f"masks of different numbers of frames: {told}; expected as many.")
        if not 0 < fps < np.inf:
            raise HandtrackError(f"fps = {fps}; expected a number of frames a second above 0.")
        return [
            cls(f, f / fps, tuple(Silhouette(known[name], of[f]) for name, of in masks.items()))
            for f in range(max(counts.values(), default=0))
        ]

    @property
    def is_empty(self) -> bool:
        """Whether nothing was seen of the frame; the caller's own terms do not count as seen."""
        seen = (self.silhouettes, self.keypoints, self.images, self.pins)
        return self.cloud is None and not any(seen)


def view_centres(view: CloudView) -> Floats[K, D3]:
    """Return where the cameras of a view are, world [m]."""
    if isinstance(view, tuple):
        return np.array([camera.centre for camera in view])
    return np.atleast_2d(np.asarray(view, dtype=float))


_PARTS: dict[str, tuple[type | tuple[type, ...], str]] = {
    "silhouettes": (Silhouette, "Silhouette(camera, mask)"),
    "keypoints": (
        (Keypoints, ImageKeypoints),
        "Keypoints(names, positions, sigma_m) or ImageKeypoints(camera, names, pixels, sigma_px)",
    ),
    "images": (ImageView, "ImageView(camera, pixels)"),
    "pins": (ImagePins, "ImagePins"),
}
"""of what kind an observation's parts are, and how one is made"""


def check_kind(value: object, kinds: type | tuple[type, ...], where: str, how: str) -> None:
    """Raise HandtrackError unless a value is of one of the kinds. how: what to give, for the error."""
    if not isinstance(value, kinds):
        shape = getattr(value, "shape", None)
        found = type(value).__name__ + ("" if shape is None else f" of shape {shape}")
        raise HandtrackError(f"{where}: {found}; expected {how}.")


def _check_points(
    points: Keypoints | ImageKeypoints, field_name: str, width: int, sigma: Floats[*Axes]
) -> None:
    names = tuple(points.names)
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise HandtrackError(f"keypoints: '{twice}' is named twice; expected each joint once.")
    values = np.asarray(getattr(points, field_name), float)
    check_shape(values, (len(names), width), f"{field_name} of {len(names)} keypoints")
    if sigma.ndim:
        check_shape(sigma, (len(names),), f"sigma_px of {len(names)} keypoints")
    if not (sigma > 0.0).all():
        raise HandtrackError(
            f"keypoints: their standard deviation is {sigma.min()}; expected a number above 0."
        )
    object.__setattr__(points, "names", names)
    object.__setattr__(points, field_name, values)


def undistort_silhouette(
    camera: Camera, mask: Bytes[H, W], roi: Roi | None = None, unknown: int | None = None
) -> Silhouette:
    """Return the silhouette of a mask uint8, 0 background to 255 hand, of the real image.

    Each undistorted pixel holds its coverage, bilinearly interpolated. A row's valid span is the
    largest run of pixels that come from inside the image and the region of interest. Without
    distortion the mask passes unchanged.

    Parameters
    ----------
    unknown
        The mask's value where nobody can tell; nor can anybody of an undistorted pixel to which one
        of them adds.
    """
    coverage = mask.astype(np.float32) / np.float32(_BYTE)
    if unknown is not None:
        coverage[mask == unknown] = UNKNOWN
    return Silhouette(camera, coverage, lens_maps(camera, roi).valid)


def undistort_image(camera: Camera, pixels: Array[H, W, *Axes]) -> ImageView:
    """Return an image (H, W, 3) uint8 BGR as the camera without distortion would have taken it."""
    width, height = camera.size
    check_shape(pixels, (height, width, 3), f"image of camera '{camera.name}'")
    maps = lens_maps(camera, None)
    return ImageView(maps.camera, maps.straightened(pixels))
