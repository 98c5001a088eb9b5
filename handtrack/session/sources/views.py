"""What one camera of a session gives: images, masks (files or computed), depth, silhouettes."""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection, Iterable, Sequence
from copy import copy
from dataclasses import replace
from functools import cache, cached_property, lru_cache, partial
from pathlib import Path

import cv2
import numpy as np

from handtrack.arrays import (
    D2,
    D3,
    Array,
    Axes,
    Bytes,
    Floats,
    H,
    Ints,
    N,
    W,
    array_dataclass,
    evenly_spread,
)
from handtrack.capture.clouds.point_cloud import PointCloud
from handtrack.capture.images.frames import (
    COLOUR,
    DEPTH,
    IMAGE_SUFFIXES,
    MASK,
    DerivedFrames,
    FrameSource,
    ImageFiles,
)
from handtrack.capture.images.raw_frames import MosaicFiles
from handtrack.capture.images.video import VideoFile
from handtrack.capture.masks.mask_correction import UNKNOWN_LEVEL, Roi, inside_roi
from handtrack.capture.masks.seeded import HandSeeds, Seeded, seeds_of_joints
from handtrack.capture.masks.segmentation import MaskMethod, segmenter
from handtrack.errors import HandtrackError, not_enough_memory
from handtrack.geometry.camera import Camera, scaled_by
from handtrack.geometry.lens import remap_source
from handtrack.geometry.rotation import rotation_matrix
from handtrack.geometry.source_lens import SourceLens
from handtrack.model.articulated import keypoint_names
from handtrack.observation.observation import (
    UNKNOWN,
    ImageKeypoints,
    ImageView,
    Observation,
    Silhouette,
    undistort_image,
    undistort_silhouette,
)
from handtrack.parallel import LRUCache
from handtrack.session.layout import (
    SESSION_FILE,
    absence,
    existing_files,
    is_pattern,
    matching_files,
)
from handtrack.session.session_file import CameraSettings, missing_counterpart
from handtrack.session.sources.camera_times import CameraTimes
from handtrack.session.sources.corrections import CorrectedMasks
from handtrack.session.sources.keypoint_files import KeypointFiles
from handtrack.session.sources.video_audits import read_audit
from handtrack.tracking.frame.constants import BODY_BY_HAND, FRAMES_AHEAD
from handtrack.tracking.search.keypoint_start import triangulated

MaskChoice = tuple[str | MaskMethod | None, Roi | None]
"""files, a method or none, and a region of interest"""
_Masks = Callable[[Array[H, W, *Axes], int], Bytes[H, W] | None]
"""an image, or depth, and the camera's own frame → the mask; None where the hand is not expected anywhere"""
_ABOUT = {
    "images": ("bayer", "demosaic", "white_level"),
    "masks": ("mask_unknown",),
    "depth": ("depth_scale_m",),
    "keypoints": ("keypoint_layout",),
}
"""settings that say how others' files are to be read"""
_KINDS = {"images": COLOUR, "masks": MASK, "depth": DEPTH}
_BYTES_KEPT = 100_000_000  # of one camera: the usual 25 images of up to 4 MB
_BRIDGED = 3
"""frames without joints up to so many before or behind one with them: a tenth of a second at usual rates"""


def scaled_camera(camera: Camera, settings: CameraSettings, folder: Path) -> Camera:
    """Return a camera for the size that session.toml says its images have. Raises HandtrackError unless that is the
    calibration's, scaled.
    """
    size = settings.image_size
    if size is None or tuple(size) == camera.size:
        return camera
    if min(size) < 1 or scaled_by(camera.size, size) is None:
        raise HandtrackError(
            f"{folder / SESSION_FILE}, camera '{settings.name}': image_size = {list(size)} is not the calibration's "
            f"{camera.size[0]} x {camera.size[1]} scaled by one factor. Images that were cut need a calibration of their "
            "own: subtract the corner from its principal point, and set its size."
        )
    return camera.scaled(size)


class View:
    """One camera with its sources.

    Opening checks that files exist and the first ones fit the calibration.
    """

    def __init__(
        self,
        folder: Path,
        settings: CameraSettings,
        camera: Camera,
        times: CameraTimes | None = None,
        live: FrameSource | None = None,
    ) -> None:
        """times: where frames of equal number are not of equal time. live: gives the images in place of the recording, which
        then only teaches the mask method.
        """
        self.times = times
        """how the camera's own frames are joined to the session's; None: by their numbers"""
        self.settings = settings
        self.camera = camera
        self._folder = folder
        self._where = f"{folder / SESSION_FILE}, camera '{settings.name}'"
        self.corrections = CorrectedMasks(folder, settings.name, camera.size, live is None)
        """of the masks, by the camera's own frames"""
        self._learning = threading.Lock()
        self._check_roi()
        self._lens, self._view = self._lens_and_view()
        self.absent: dict[str, str] = {}
        """by a setting that names files of which there is none: what is there instead, in words"""
        recorded = self._source("images")
        self.images = recorded if live is None else live
        self._taught_by = recorded
        self._said_unknown = settings.mask_unknown
        self._is_live = live is not None
        self._computed = LRUCache[int, CroppedMask | None]()
        self._lessons: dict[str, LRUCache[int, Array | None]] | None = None
        """what methods learned from, images or depth, where several are tried"""
        self.mask_files = self._mask_files()
        self.depth = self._source("depth")
        self.keypoint_files = self._keypoint_files()
        if live is None:
            self.settings = _without(settings, self.absent)
        for source in self.sources:
            source.size  # noqa: B018  reads one image, which checks its size

    def with_masks(self, masks: str | MaskMethod | None, roi: Roi | None) -> View:
        """Return the view with masks by another method or of other files, and another region of interest.

        What was read, and corrections, are shared. Raises HandtrackError for what cannot be.
        """
        known, changed = self.settings, copy(self)
        unknown = self._said_unknown if isinstance(masks, str) else None
        changed.settings = replace(known, masks=masks, roi=roi, mask_unknown=unknown)
        wrong = missing_counterpart(changed.settings)
        if wrong is not None:
            raise HandtrackError(f"{self._where}: {wrong}")
        if isinstance(masks, str):
            matching_files(self._folder, masks, f"{self._where}, masks")
        changed._check_roi()
        changed._learning, changed._computed = threading.Lock(), LRUCache()
        changed.__dict__.pop("_learned", None)
        changed._lessons = {} if self._lessons is None else self._lessons
        if masks != known.masks:
            changed.mask_files = changed._mask_files()
        return changed

    def with_camera(self, camera: Camera, times: CameraTimes | None, lag_s: float | None) -> View:
        """Return the view by another calibration and time offset; what was read, and corrections, are shared."""
        changed = copy(self)
        changed.camera, changed.times, changed._computed = camera, times, LRUCache()
        changed.settings = replace(self.settings, lag_s=lag_s)
        changed.keypoint_files = changed._keypoint_files()
        return changed

    @property
    def name(self) -> str:
        return self.settings.name

    def own_frame(self, frame: int) -> int | None:
        """Return the camera's own frame that shows a session's frame; None where none does."""
        return frame if self.times is None else self.times.own_frame(frame)

    def session_frames(self, own: range) -> range:
        """Return the session's frames from 0 to the one that shows the last of the camera's own."""
        return own if self.times is None else self.times.frames(own)

    def read(self, source: FrameSource, frame: int) -> Array | None:
        """Return what one of `sources` shows at a session's frame; None where that is missing."""
        own = self.own_frame(frame)
        try:
            return None if own is None else source.read(own)
        except MemoryError as error:
            raise not_enough_memory(f"Frame {frame} of camera '{self.name}'", error) from None

    @property
    def sources(self) -> tuple[FrameSource, ...]:
        """Images, masks and depth by the camera's own frames, as far as there are any."""
        return tuple(s for s in (self.images, self.mask_files, self.depth) if s is not None)

    @property
    def has_masks(self) -> bool:
        """Whether silhouettes can be observed here at all."""
        return self.settings.masks is not None

    @property
    def frame_count(self) -> int:
        """One more than the last frame of any source."""
        return self._count(source.frames for source in self.sources)

    @property
    def known_count(self) -> int:
        """The same as far as is known without decoding videos."""
        return self._count(source.known_frames for source in self.sources)

    @property
    def warnings(self) -> list[str]:
        joints = () if self.keypoint_files is None else self.keypoint_files.warnings
        times = "" if self.times is None else self.times.note
        joined = [f"camera '{self.name}': {times}"] if times else []
        missing = [
            f"{text} This camera's {key} count as missing." for key, text in self.absent.items()
        ]
        sources = (text for source in self.sources for text in source.warnings)
        return [*missing, *joined, *sources, *joints]

    def image(self, frame: int) -> Array[H, W, D3] | None:
        """Return the frame's image uint8 BGR, None where missing."""
        return None if self.images is None else self.read(self.images, frame)

    def mask(self, frame: int) -> Bytes[H, W] | None:
        """Return the frame's mask uint8, read or computed, and corrected; None where missing. See `unknown_at`."""
        own = self.own_frame(frame)
        mask, unknown = self.uncorrected_mask(frame), self.unknown_at(frame)
        return mask if own is None or unknown is None else self.corrections.over(own, mask, unknown)

    def uncorrected_mask(self, frame: int) -> Bytes[H, W] | None:
        """Return the frame's mask uint8, read or computed, as it is without any correction; None where missing."""
        if self.mask_files is not None:
            return self.read(self.mask_files, frame)
        if self._is_live:  # frames count anew when it begins again
            return self._segmented(frame)

        def cropped() -> CroppedMask | None:
            mask = self._segmented(frame)
            return None if mask is None else CroppedMask.of(mask)

        kept = self._computed.value(frame, cropped, most_masks)
        return None if kept is None else kept.whole

    def _segmented(self, frame: int) -> Bytes[H, W] | None:
        """Return the mask that the method computes."""
        source, own = self._segmented_source, self.own_frame(frame)
        image = None if source is None else self.read(source, frame)
        if image is None or own is None:
            return None
        with self._learning:
            masks = self._learned
        return masks(image, own)

    @property
    def unknown(self) -> int | None:
        """The value in masks of pixels that may be hand or background, nobody knows; None where there are none."""
        if isinstance(self.settings.masks, Seeded):
            return UNKNOWN_LEVEL
        return self.settings.mask_unknown

    def unknown_at(self, frame: int) -> int | None:
        """Return the same for a frame's mask: a correction may say that nobody knows where the camera's masks never do."""
        own = self.own_frame(frame)
        is_corrected = own is not None and self.corrections.content(own) is not None
        return UNKNOWN_LEVEL if self.unknown is None and is_corrected else self.unknown

    def depth_m(self, frame: int) -> Array[H, W] | None:
        """Return the frame's depth float64 [m], 0 where not measured; None where missing."""
        image = None if self.depth is None else self.read(self.depth, frame)
        return None if image is None else image * np.float64(self.settings.depth_scale_m or 1.0)

    def hand_pixels(self, frame: int) -> Bytes[H, W] | None:
        """Return where the hand may be uint8, by mask and region of interest; None: all.

        A camera that has masks, but none of this frame, says nothing of it: also None.
        """
        mask = self.mask(frame) if self.has_masks else None
        if self.settings.roi is None:
            return mask
        width, height = self.camera.size
        all_of_it = np.full((height, width), 255, np.uint8)
        return inside_roi(all_of_it if mask is None else mask, self.settings.roi)

    def silhouette(self, frame: int) -> Silhouette | None:
        """Return the frame's silhouette in the undistorted image; None where there is no mask."""
        mask = self.mask(frame)
        if mask is None:
            return None
        return undistort_silhouette(self.camera, mask, self.settings.roi, self.unknown_at(frame))

    def undistorted(self, frame: int) -> ImageView | None:
        """Return the frame's image without the lens's distortion; None where missing."""
        image = self.image(frame)
        return None if image is None else undistort_image(self.camera, image)

    def keypoints(self, frame: int, sigma_px: float) -> tuple[ImageKeypoints, ...]:
        """Return the frame's 2D joints in the undistorted image, as exact as sigma_px; none where none were found."""
        own = self.own_frame(frame)
        files = self.keypoint_files
        return () if files is None or own is None else files.read(own, sigma_px)

    def _count(self, frames: Iterable[range]) -> int:
        joints = range(0) if self.keypoint_files is None else self.keypoint_files.frames
        return max(len(self.session_frames(own)) for own in (joints, *frames))

    def _mask_files(self) -> FrameSource | None:
        return self._source("masks")

    @property
    def _segmented_source(self) -> FrameSource | None:
        method = self.settings.masks
        if method is None or isinstance(method, str):
            return None
        return self.images if method.needs == "images" else self.depth

    @cached_property
    def _learned(self) -> _Masks:
        method, source = self.settings.masks, self._segmented_source
        assert method is not None
        assert not isinstance(method, str)
        if self._taught_by is not None and source is self.images:
            source = self._taught_by
        assert source is not None
        if self._lessons is not None:
            memory, whole = self._lessons.setdefault(method.needs, LRUCache()), source

            def read(frame: int) -> Array | None:
                return memory.value(frame, lambda: whole.read(frame), _most_images)

            source = DerivedFrames(whole, read)
        try:
            if isinstance(method, Seeded):
                return self._learned_by_joints(method, source)
            unit_m = self.settings.depth_scale_m or 1.0
            masks = segmenter(method, source, self.settings.roi, unit_m)
            return lambda image, _own_frame: masks(image)
        except HandtrackError as error:
            raise HandtrackError(f"{self._where}: {error}") from None

    def _learned_by_joints(self, method: Seeded, source: FrameSource) -> _Masks:
        if self.keypoint_files is None:
            raise HandtrackError(
                "mask method seeded starts from joints in the images, but the camera has no `keypoints`. "
                "`handtrack detect SESSION --write` finds them."
            )
        seeds_at = partial(_seeds_of_frame, self.keypoint_files)
        count, roi = len(source.frames), self.settings.roi
        masks = method.learned(count, source.read, seeds_at, source.where, roi)

        def mask(image: Array, own_frame: int) -> Bytes | None:
            seeds = seeds_at(own_frame)
            return None if seeds is None else masks.mask(image, seeds)

        return mask

    @property
    def _taken_size(self) -> tuple[int, int]:
        """Width, height [px] of the images as they were taken."""
        return self.camera.size if self._lens is None else self._lens.size

    def _lens_and_view(self) -> tuple[SourceLens | None, Camera]:
        """Return the lens of the images, where it is another than the camera's, and the view of it that the camera is."""
        settings = self.settings.lens
        rotation = rotation_matrix(np.array([0.0] * 3 if settings is None else settings.rotation))
        view = replace(self.camera, rotation=rotation)
        if settings is None:
            return None, view
        if self.camera.is_distorted:
            raise HandtrackError(
                f"{self._where}: `lens` says that the camera is a pinhole view, but the calibration gives it distortions. Make "
                "the session again with `handtrack new`."
            )
        try:
            return settings.source, view
        except HandtrackError as error:
            raise HandtrackError(f"{self._where}: {error}") from None

    def _check_roi(self) -> None:
        if self.settings.roi is None:
            return
        x, y, width, height = self.settings.roi
        if x + width > self.camera.size[0] or y + height > self.camera.size[1]:
            raise HandtrackError(
                f"{self._where}: roi = {[x, y, width, height]} reaches outside the image of "
                f"{self.camera.size[0]} x {self.camera.size[1]}; expected [x, y, w, h] inside it."
            )

    def _keypoint_files(self) -> KeypointFiles | None:
        files, layout = self._files_of("keypoints"), self.settings.keypoint_layout
        return KeypointFiles(files, layout or "body_25", self.camera) if files else None

    def _source(self, key: str) -> FrameSource | None:
        """Return what a setting names files of: images, masks or depth; None where it names none, or none are there."""
        files = self._files_of(key)
        source = self._recording(key, files) if files else None
        if source is not None and self._lens is not None:
            source = _straightened(source, self._lens, self._view)
        return source

    def _files_of(self, key: str) -> list[Path]:
        """Return the files that a setting names."""
        setting, where = getattr(self.settings, key), f"{self._where}, {key}"
        if not isinstance(setting, str):
            return []
        files = existing_files(self._folder, setting, where)
        if not files:
            self.absent[key] = f"{where}: {absence(self._folder, setting)}."
        return files

    def _recording(self, key: str, files: list[Path]) -> FrameSource:
        folder, where, setting = self._folder, f"{self._where}, {key}", getattr(self.settings, key)
        if is_pattern(setting) or Path(setting).suffix.lower() in IMAGE_SUFFIXES:
            if not any(path.suffix.lower() in IMAGE_SUFFIXES for path in files):
                raise HandtrackError(
                    f'{where}: "{setting}" matches {files[0].name}, which is no image; expected one of '
                    f"{', '.join(IMAGE_SUFFIXES)}. A video is named without *, ? or [."
                )
            return self._files(files, key, str(folder / setting))
        if key != "images":
            raise HandtrackError(
                f'{where}: "{setting}" is no image file; expected a pattern such as "{key}/*.png".'
            )
        if self.settings.bayer is not None:
            raise HandtrackError(
                f'{where}: "{setting}" is a video, but bayer = "{self.settings.bayer}" says that the images are raw '
                'mosaics; expected numbered files without loss, such as "cam0/*.png". A video\'s compression mixes the '
                "colours of a mosaic: unpack it to files, or leave `bayer` away if it is in colour."
            )
        path = files[0]
        return VideoFile(path, self._taken_size, f"{where}, {path}", read_audit(folder, path))

    def _files(self, files: list[Path], key: str, where: str) -> FrameSource:
        pattern = self.settings.bayer
        if key != "images" or pattern is None:
            return ImageFiles(files, _KINDS[key], self._taken_size, where)
        level, method = self.settings.white_level, self.settings.demosaic
        return MosaicFiles(files, pattern.upper(), level, method, self._taken_size, where)


def _without(settings: CameraSettings, absent: Collection[str]) -> CameraSettings:
    """Return a camera's settings without those whose files are absent, and what is said of these."""
    masks = settings.masks
    gone = {name for key in absent for name in (key, *_ABOUT[key])}
    if masks is not None and not isinstance(masks, str):
        needs = {masks.needs, "keypoints"} if isinstance(masks, Seeded) else {masks.needs}
        gone |= {"masks"} if needs & set(absent) else set()
    return replace(settings, **dict.fromkeys(gone))


def _straightened(taken: FrameSource, lens: SourceLens, view: Camera) -> DerivedFrames:
    """Return images as a pinhole view of their lens shows them. taken: as the lens took them."""

    @cache
    def source() -> Floats[H, W, D2]:
        """The place in the taken image that each of the view's pixels shows."""
        return remap_source(lens.source(view))

    def read(frame: int) -> Array[H, W, *Axes] | None:
        image = taken.read(frame)
        return None if image is None else cv2.remap(image, source(), None, cv2.INTER_LINEAR)  # type: ignore[call-overload]

    return DerivedFrames(taken, read, view.size)


def _most_images(image: Array[H, W, *Axes] | None) -> int:
    return max(_BYTES_KEPT // (1 if image is None else image.nbytes), 1)


def _seeds_of_frame(files: KeypointFiles, own_frame: int) -> HandSeeds | None:
    """Return the seeds of a camera's own frame; None where the hand was not found, nor shortly before and after."""
    joints = files.as_taken(own_frame) or _bridged(files, own_frame)
    return seeds_of_joints(joints, files.camera.size)


def _bridged(files: KeypointFiles, own_frame: int) -> dict[str, Floats[D2]]:
    """Return a frame's joints on a straight way through a short gap; none where it is longer."""
    ends = []
    for way in (-1, 1):
        near = [own_frame + way * step for step in range(1, _BRIDGED + 1)]
        found = [(n, joints) for n in near if (joints := files.as_taken(n))]
        if not found:
            return {}
        ends.append(found[0])
    (first, before), (last, after) = ends
    share = (own_frame - first) / (last - first)
    return {
        n: np.asarray((1 - share) * before[n] + share * after[n])
        for n in before.keys() & after.keys()
    }


# ---- Observations and masks as they are kept in memory, small enough for a long recording, and how many of them


LEAST_KEPT = 2 * (FRAMES_AHEAD + 4)
"""observations that are kept however large: those that a search may have solved anew, with a cloud and without"""
_OBSERVATION_BYTES_KEPT = 400_000_000
"""of all observations: the estimate of all frames reads each about five times"""
_MASK_BYTES_KEPT = 50_000_000
"""of one camera's computed masks, which clouds and the page read beside observations"""
_POINTS_KEPT = 9_000_000
"""of what clouds have around hands, 240 MB: the estimate of all frames reads each about six times"""
_WHOLE_POINTS_KEPT = 1_000_000
"""of all clouds before filtering"""


@array_dataclass
class CroppedMask:
    """A mask without the background around its hand: a tenth or less of its size."""

    size: tuple[int, int]
    """height, width"""
    corner: tuple[int, int]
    """row, column of the part"""
    part: Array[H, W]
    unknown: Bytes[N] | None
    """a bit for each pixel of the mask, whether it is UNKNOWN; None where none is"""

    @classmethod
    def of(cls, mask: Array[H, W]) -> CroppedMask:
        """Cut a mask to the smallest rectangle with all that is above 0."""
        x, y, width, height = cv2.boundingRect((mask > 0).view(np.uint8))
        unknown = mask < 0
        bits = np.packbits(unknown) if unknown.any() else None
        return cls(mask.shape, (y, x), mask[y : y + height, x : x + width].copy(), bits)

    @property
    def whole(self) -> Array[H, W]:
        """The mask, in memory of its own."""
        mask, (y, x) = np.zeros(self.size, self.part.dtype), self.corner
        mask[y : y + self.part.shape[0], x : x + self.part.shape[1]] = self.part
        if self.unknown is not None:
            bits = np.unpackbits(self.unknown, count=mask.size).view(bool)
            mask[bits.reshape(self.size)] = UNKNOWN
        return mask

    @property
    def nbytes(self) -> int:
        """How much memory it takes."""
        return self.part.nbytes + (0 if self.unknown is None else self.unknown.nbytes)


def most_masks(mask: CroppedMask | None) -> int:
    """Return how many masks like one are kept."""
    return _MASK_BYTES_KEPT // max(mask.nbytes if mask else 0, 1000)


def most_clouds(cloud: PointCloud) -> int:
    """Return how many parts of clouds like one, around a hand, are kept."""
    return _POINTS_KEPT // max(len(cloud), 100)


def most_whole_clouds(cloud: PointCloud | None) -> int:
    """Return how many clouds like one, before filtering, are kept."""
    return max(_WHOLE_POINTS_KEPT // max(len(cloud or ()), 1000), 2)


Kept = tuple[Observation, list[tuple[Camera, CroppedMask, Ints[H, D2], float]]]
"""an observation but its silhouettes, and of each of these camera, mask, `valid` and `off_px`"""


def kept(seen: Observation) -> Kept:
    """Return an observation with masks cut to their hands: undistorting and weighing them takes longer than reading them did."""
    cut = [(s.camera, CroppedMask.of(s.mask), s.valid, s.off_px) for s in seen.silhouettes]
    return replace(seen, silhouettes=()), cut


def whole(seen: Kept) -> Observation:
    """Return an observation that was kept, its masks in memory of their own."""
    others, cut = seen
    silhouettes = (
        Silhouette(camera, mask.whole, valid, off_px) for camera, mask, valid, off_px in cut
    )
    return replace(others, silhouettes=tuple(silhouettes))


def most_observations(seen: Kept) -> int:
    """Return how many observations like one are kept."""
    others, cut = seen
    cloud = 0 if others.cloud is None else others.cloud.points.nbytes
    size = cloud + sum(mask.nbytes for _, mask, *_ in cut)
    return max(_OBSERVATION_BYTES_KEPT // max(size, 1000), LEAST_KEPT)


# ---- How far a detector's joints are off in a recording, as its cameras disagree


# looked at, spread over those with joints: 32 x 21 points tell a median to some per cent
_JOINT_FRAMES = 32
_MORE_JOINT_FRAMES = 512  # where the files of many say that there is nobody
_FEWEST_JOINTS = 100  # points; fewer say nothing
_DEFINITION_M = 0.002
"""how far a point of the hand that a detector, or a person, means moves in the bone's frame as the hand moves: bone lengths that persons mark
vary by 3 to 8 % of 30 to 90 mm at palm, thumb and index of 76 frames of one recording; of a body the same share of its size"""


@lru_cache(maxsize=8)
def joint_sigma_px(views: tuple[View, ...]) -> float | None:
    """Return the standard deviation of detected joints in each direction [px]; None where two cameras do not see enough.

    Triangulation takes three of a point's 2 V numbers in V cameras; what it leaves of them, squared and in units of the error, is
    χ² with 2 V − 3 freedoms. The median of that is compared, since some points are simply elsewhere. Each camera's median
    residual is taken out first: it is an error of the calibration, not of the detector. What cameras agree on is no better than a point
    of a hand is defined.
    """
    files = {view: view.keypoint_files for view in views if view.keypoint_files is not None}
    last = max((view.session_frames(of.frames).stop for view, of in files.items()), default=0)
    shared = [
        frame
        for frame in range(last)
        if sum(view.own_frame(frame) in of.files for view, of in files.items()) > 1
    ]
    found: list[tuple[dict[str, Floats[D2]], float]] = []
    for most in (_JOINT_FRAMES, _MORE_JOINT_FRAMES):
        found = [
            point
            for row in evenly_spread(len(shared), most)
            for point in _triangulation_residuals(
                [joints for view in files for joints in view.keypoints(shared[row], 1.0)]
            )
        ]
        if len(found) >= _FEWEST_JOINTS:
            break
    if len(found) < _FEWEST_JOINTS:
        return None
    constant = {
        name: np.median([off[name] for off, _ in found if name in off], axis=0)
        for name in {name for off, _ in found for name in off}
    }
    squares, pixels_per_m = np.median(
        [(_variance([off[name] - constant[name] for name in off]), scale) for off, scale in found],
        axis=0,
    )
    hands = set(keypoint_names())
    of_hand = all(hands >= set(of.layout.points) for of in files.values())
    least_m = _DEFINITION_M * (1.0 if of_hand else BODY_BY_HAND)
    return float(np.sqrt(squares + (least_m * pixels_per_m) ** 2))


def _triangulation_residuals(
    seen: Sequence[ImageKeypoints],
) -> list[tuple[dict[str, Floats[D2]], float]]:
    """Return each point's residuals after triangulation [px], by camera, and how many pixels a metre is there; of points that two
    cameras see.
    """
    found: list[tuple[dict[str, Floats[D2]], float]] = []
    names = tuple(dict.fromkeys(name for one in seen for name in one.names))
    for name, point in zip(names, triangulated(seen, names), strict=True):
        off: dict[str, Floats[D2]] = {}
        scale = []
        for one in seen:
            row = one.names.index(name) if name in one.names else -1
            missed = one.camera.project(point) - one.pixels[row] if row >= 0 else np.array([np.nan])
            if np.isfinite(missed).all():
                off[one.camera.name] = missed
                scale.append(float(one.camera.pixels_per_m(one.camera.to_camera(point)[2])))
        if len(off) > 1:
            found.append((off, float(np.median(scale))))
    return found


def _variance(off: Sequence[Floats[D2]]) -> float:
    """Return the variance [px²] in each direction of which a point's residuals are the median."""
    freedoms = 2 * len(off) - 3
    return float(np.square(off).sum()) / (freedoms * (1 - 2 / (9 * freedoms)) ** 3)
