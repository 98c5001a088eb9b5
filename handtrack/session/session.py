"""A session: a folder with recordings, calibration and settings, opened and checked."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import replace
from functools import cached_property
from hashlib import sha256
from pathlib import Path
from typing import Any, TypeVar

from handtrack.arrays import D3, Array, Bytes, C, Floats, H, W
from handtrack.capture.calibration.rig_file import read_rig, rig_json
from handtrack.capture.clouds.cloud_filters import CloudFilters, FilterReport, HandRegion
from handtrack.capture.clouds.point_cloud import PointCloud
from handtrack.capture.images.frames import files_by_frame, frames_of
from handtrack.capture.images.live_feed import LiveFeed
from handtrack.capture.images.video import VideoFile
from handtrack.errors import HandtrackError, unknown_name
from handtrack.geometry.camera import CameraRig
from handtrack.model.articulated import HandScale
from handtrack.model.model_file import MODELS, load_model, read_scale
from handtrack.observation.agreement import weighed
from handtrack.observation.observation import ImageView, Observation
from handtrack.observation.truth import Truth
from handtrack.parallel import LRUCache
from handtrack.session.first_pose import FirstPose, read_first_pose
from handtrack.session.layout import (
    CALIBRATION_FILE,
    INIT_FILE,
    SESSION_FILE,
    TRACKS_FOLDER,
    TRUTH_FILE,
    check_written,
    inside,
    matching_files,
)
from handtrack.session.session_file import (
    CloudSettings,
    SessionFile,
    dotted,
    is_definition,
    read_session_file,
)
from handtrack.session.session_state import CameraCorrection, readable
from handtrack.session.sources.camera_times import CameraTimes, FrameTimes, session_times
from handtrack.session.sources.clouds import CloudSource, cloud_source
from handtrack.session.sources.corrections import SessionPins
from handtrack.session.sources.views import (
    LEAST_KEPT,
    Kept,
    MaskChoice,
    View,
    kept,
    most_clouds,
    most_observations,
    most_whole_clouds,
    scaled_camera,
    whole,
)
from handtrack.session.truth import read_truth
from handtrack.store.store import Store
from handtrack.tracking.frame.methods import METHODS
from handtrack.tracking.frame.settings import TrackerSettings

_T = TypeVar("_T")
_NAMED = 3  # of what is absent
_ROOM_M = 0.05
"""by which a hand may be elsewhere than it was expected first, until a frame's cloud is measured again"""


class Session:
    """An opened session folder. Reading frames is safe from several threads."""

    live: LiveFeed | None = None
    """the cameras of a live session; None of a recording"""

    def __init__(self, folder: Path, file: SessionFile, rig: CameraRig) -> None:
        """Use `Session.open`."""
        self.folder = folder
        self.file = file
        self.calibrated = rig
        """the session's cameras, in the order of session.toml, as calibration.toml has them."""
        self.rig = rig
        """the same, corrected by `corrections`."""
        self.corrections: Mapping[str, CameraCorrection] = {}
        """what of the cameras was corrected, by name."""
        self._lags = {camera.name: camera.lag_s for camera in file.cameras}
        self.settings = self._read_settings()
        """of the tracker: the usual ones, and what [tracking] sets."""
        self._line, self._camera_times = self._read_times()
        self.views = self._views()
        self.cloud_files = self._find_clouds()
        """point cloud files by frame."""
        self.cloud_filters = self._filters(self.settings.tracker.seed)
        """how the hand's points are told from the others, by [clouds]."""
        self._clouds: CloudSource | None
        self._measured: LRUCache[int, PointCloud | None]
        self._parts: LRUCache[int, tuple[HandRegion, PointCloud]]
        self._observations: LRUCache[tuple[int, bool, bool], Kept]
        self._measure_anew()
        self.truth: Truth | None = self._optional(TRUTH_FILE, read_truth)
        """ground truth, None without truth.npz."""
        self.init: FirstPose | None = self._optional(
            INIT_FILE, lambda path: read_first_pose(path, self._parameter_names())
        )
        """first pose, None without init.json."""
        self.check_init(self.known_frames)
        self.pins = SessionPins(folder, rig, has_file=self.live is None)
        """where a person pointed at joints and segments"""

    @classmethod
    def open(cls, folder: Path | str) -> Session:
        """Return the session of a folder, with settings, calibration, first pose and truth checked.

        Raises HandtrackError for whatever cannot be used as it is; what is merely odd is in
        `warnings` and `doctor()`.
        """
        folder = Path(folder)
        if not folder.is_dir():
            kind = "is a file" if folder.exists() else "does not exist"
            raise HandtrackError(
                f"{folder} {kind}; expected a session folder, with a {SESSION_FILE} in it."
            )
        if not (folder / SESSION_FILE).is_file():
            raise HandtrackError(
                f"{folder}: no {SESSION_FILE} in this folder, so it is no session. `handtrack "
                "new` makes one from videos and a calibration."
            )
        check_written(folder)
        file = read_session_file(folder / SESSION_FILE)
        cameras = Store(folder / TRACKS_FOLDER).state("camera/")
        session = cls(folder, file, session_rig(folder, file))
        return session.with_cameras(readable(cameras).camera)

    def __copy__(self) -> Session:
        changed = object.__new__(type(self))
        changed.__dict__.update(self.__dict__)
        return changed

    def __reduce__(self) -> tuple[Callable[..., Session], tuple[Any, ...]]:
        """Pickle what was asked for, not what was read: another process opens the files again."""
        if self.live is not None:
            raise HandtrackError(
                f"{self.folder}: running cameras cannot be given to another process."
            )
        cameras = tuple(replace(c, lag_s=self._lags[c.name]) for c in self.file.cameras)
        file = replace(self.file, cameras=cameras)
        person = self.__dict__.get("prior_person")
        seed = self.cloud_filters.seed
        return _reopened, (self.folder, file, self.calibrated, self.corrections, person, seed)

    @property
    def name(self) -> str:
        return self.file.session.name

    @property
    def camera_names(self) -> tuple[str, ...]:
        return self.rig.names

    @property
    def fps(self) -> float:
        """Frames a second, from session.toml or the median of its timestamps."""
        return self._line.fps

    @cached_property
    def frame_count(self) -> int:
        """Frames run from 0 to the last that any camera or cloud has. The first use counts those of videos by decoding."""
        counts = [view.frame_count for view in self.views]
        return max(len(frames_of(self.cloud_files)), *counts)

    @property
    def frame_range(self) -> range:
        """Every frame of the session."""
        return range(self.frame_count)

    @property
    def known_frames(self) -> range:
        """Every frame as far as is known without decoding: what videos announce, until their frames were counted."""
        counts = [view.known_count for view in self.views]
        return range(max(len(frames_of(self.cloud_files)), *counts))

    @property
    def videos(self) -> list[VideoFile]:
        """The views' videos."""
        sources = (source for view in self.views for source in view.sources)
        return [source for source in sources if isinstance(source, VideoFile)]

    @property
    def is_counted(self) -> bool:
        """Whether `frame_count` is known."""
        return all(video.audit is not None for video in self.videos)

    def check_frames(self) -> None:
        """Raise HandtrackError where there is no frame at all."""
        if not self.known_frames:
            words = (
                f"{self.folder}: no frames at all; no camera has images, masks, depth or joints."
            )
            raise HandtrackError(" ".join([words, *self.absent[:_NAMED]]))

    def check_init(self, frames: range | None = None) -> None:
        """Raise HandtrackError where init.json is about none of these frames, all of the session's unless given."""
        frames = self.frame_range if frames is None else frames
        if self.init is not None and frames and self.init.frame not in frames:
            raise HandtrackError(
                f"{self.folder / INIT_FILE}: frame = {self.init.frame}, but {frames_words(frames)}."
            )

    @property
    def hand_model(self) -> str | Path:
        """A model's name, or the path of a definition inside the folder."""
        model = self.file.hand.model
        if is_definition(model):
            return self._hand_file("model", model)
        return model

    @property
    def hand_scale(self) -> float | str | Path:
        """A factor, the text "fit", or the path of a saved hand inside the folder."""
        scale = self.file.hand.scale
        if isinstance(scale, str) and scale != "fit":
            return self._hand_file("scale", scale)
        return scale

    @cached_property
    def prior_person(self) -> HandScale | None:
        """What a person's file says beforehand of a hand that is fitted to the recording. Raises HandtrackError."""
        person = self.file.hand.person
        return None if person is None else read_scale(self._hand_file("person", person))

    @property
    def absent(self) -> list[str]:
        """What session.toml names and is not there, and what is there instead, in sentences."""
        return [text for view in self.views for text in view.absent.values()]

    @property
    def warnings(self) -> list[str]:
        """Oddities met so far, in plain sentences; `doctor` looks for more."""
        clouds = [] if self._clouds is None else self._clouds.warnings
        applied = self._applied_corrections
        dropped = [
            f"camera '{name}': its correction does not apply, for its calibration has changed since."
            for name in self.corrections
            if name not in applied
        ]
        return [*(text for v in self.views for text in v.warnings), *clouds, *dropped]

    def view(self, camera: str) -> View:
        """Return a camera's view. Raises HandtrackError naming the known cameras."""
        for view in self.views:
            if view.name == camera:
                return view
        raise unknown_name("camera", camera, self.camera_names, str(self.folder / SESSION_FILE))

    def time_s(self, frame: int) -> float:
        """Return the time of a frame [s]: frame / fps, or the time stamp of the first camera that has any."""
        return self._line.time_of(frame)

    def image(self, camera: str, frame: int) -> Array[H, W, D3] | None:
        """Return an image uint8 BGR as it was taken, None where missing."""
        return self.view(camera).image(frame)

    def mask(self, camera: str, frame: int) -> Bytes[H, W] | None:
        """Return a mask uint8 in the image as it was taken, read or computed; None where missing."""
        return self.view(camera).mask(frame)

    @property
    def has_clouds(self) -> bool:
        """Whether session.toml names a source of point clouds."""
        return self._clouds is not None

    def measured_cloud(self, frame: int) -> PointCloud | None:
        """Return the frame's cloud before any filter; None where none was taken."""
        if self._clouds is None:
            return None
        read = self._clouds.read
        return self._measured.value(frame, lambda: read(frame), most_whole_clouds)

    def cloud(
        self, frame: int, hand: HandRegion | None = None
    ) -> tuple[PointCloud | None, tuple[FilterReport, ...]]:
        """Return the hand's points of a frame, and what each filter did.

        Not kept.

        Parameters
        ----------
        hand
            Of the frame before, for the crop.
        """
        measured = self.measured_cloud(frame)
        if measured is None or self._clouds is None:
            return None, ()
        return self.cloud_filters.apply(measured, hand, self._clouds.camera_centres)

    def _cloud_near(self, frame: int, hand: HandRegion) -> PointCloud | None:
        """Return the hand's points of a frame, cropped to a hand. What they are chosen from is kept, as long as the hand is about
        where it was expected first: the same frame is asked for many times."""
        assert self._clouds is not None
        filters, centres = self.cloud_filters, self._clouds.camera_centres
        known = self._parts.get(frame)
        if known is None or not known[0].is_about(hand, _ROOM_M):
            measured = self.measured_cloud(frame)
            if measured is None:
                return None
            known = hand, filters.around(measured, hand, _ROOM_M, centres)
            # running cameras count their frames anew when they begin again
            most = most_clouds(known[1]) if self.live is None else LEAST_KEPT
            self._parts.put(frame, known, most)
        return filters.of_part(known[1], hand, centres)

    @property
    def cloud_camera_centres(self) -> Floats[C, D3] | None:
        """Centres world [m] of the cameras that measured the clouds; None without clouds."""
        return None if self._clouds is None else self._clouds.camera_centres

    def with_person(self, file: Path) -> Session:
        """Return this session of a person whose file the fit of their hand begins with. Raises HandtrackError."""
        changed = copy(self)
        changed.file = replace(self.file, hand=replace(self.file.hand, scale="fit", person=None))
        changed.prior_person = read_scale(file)
        return changed

    def with_clouds(self, clouds: CloudSettings | None) -> Session:
        """Return this session with other settings of [clouds]; session.toml stays as it is, and what was read is shared.

        Raises HandtrackError when they cannot be used.
        """
        return self._measuring(clouds, self.cloud_filters.seed)

    def as_tracked_by(self, settings: TrackerSettings) -> Session:
        """Return this session as these settings look at it: clouds as the method has them where [clouds] says nothing, and
        with the seed of what is random, which of their points stay.
        """
        clouds, seed = self.file.clouds, settings.tracker.seed
        if clouds is not None:
            clouds = replace(clouds, by_method=METHODS[settings.method].clouds)
        same = clouds == self.file.clouds and seed == self.cloud_filters.seed
        return self if same else self._measuring(clouds, seed)

    def _measuring(self, clouds: CloudSettings | None, seed: int) -> Session:
        changed, known = copy(self), self.file.clouds
        changed.file = replace(self.file, clouds=clouds)
        if clouds is None or known is None or clouds.sources != known.sources:
            changed._measure_anew()
        changed.cloud_filters = changed._filters(seed)
        changed._parts, changed._observations = LRUCache(), LRUCache()
        return changed

    def _measure_anew(self) -> None:
        """Read clouds and observations by what has changed, and nothing that was kept."""
        self._clouds = cloud_source(self.file, self.cloud_files, self.views, self.rig)
        self._measured, self._parts, self._observations = LRUCache(), LRUCache(), LRUCache()

    def with_masks(self, wanted: Mapping[str, MaskChoice]) -> Session:
        """Return this session with other masks of some cameras, by name; session.toml stays as it is, and images are shared.

        Raises HandtrackError when they cannot be used.
        """
        changed = copy(self)
        changed.views = tuple(
            view.with_masks(*wanted[view.name]) if view.name in wanted else view
            for view in self.views
        )
        changed.file = replace(self.file, cameras=tuple(view.settings for view in changed.views))
        changed._measure_anew()
        return changed

    def with_cameras(self, corrections: Mapping[str, CameraCorrection]) -> Session:
        """Return this session with its cameras' errors corrected, by name, and no others; its files stay as they are. An error against
        a calibration that is another by now is left out, with a warning.
        """
        if corrections == self.corrections:
            return self
        changed = copy(self)
        changed.corrections = dict(corrections)
        errors = {name: one.error for name, one in changed._applied_corrections.items()}
        cameras = self.calibrated
        changed.rig = CameraRig(
            tuple(errors[c.name].corrected(c) if c.name in errors else c for c in cameras)
        )
        lags = dict(self._lags)
        for name, error in errors.items():
            lags[name] = (lags[name] or 0.0) + error.late_frames / self.fps
        cameras = tuple(replace(c, lag_s=lags[c.name]) for c in self.file.cameras)
        changed.file = replace(self.file, cameras=cameras)
        changed._line, changed._camera_times = changed._read_times()
        changed.views = tuple(
            view.with_camera(changed.rig[name], changed._camera_times.get(name), lags[name])
            for view in self.views
            for name in [view.name]
        )
        changed._measure_anew()
        changed.pins = self.pins.with_cameras(changed.rig)
        changed.__dict__.pop("frame_count", None)
        return changed

    @property
    def corrected(self) -> dict[str, str]:
        """By how much cameras are corrected, in words, by their names."""
        return {name: one.error.figures for name, one in self._applied_corrections.items()}

    @property
    def corrected_words(self) -> list[str]:
        """The same in sentences."""
        return [
            f"camera '{name}' counts as corrected, as was decided in the workbench: {figures}."
            for name, figures in self.corrected.items()
        ]

    def calibration_digest(self, camera: str) -> str:
        """Return a digest of a camera as calibration.toml and `lag_s` have it."""
        text = f"{rig_json(CameraRig((self.calibrated[camera],)))} {self._lags[camera]}"
        return sha256(text.encode()).hexdigest()[:16]

    @property
    def _applied_corrections(self) -> dict[str, CameraCorrection]:
        """The corrections that are of the calibration that their camera has."""
        return {
            name: one
            for name, one in self.corrections.items()
            if name in self.calibrated and one.calibration == self.calibration_digest(name)
        }

    def forget_observations(self) -> None:
        """Forget what was seen: masks were corrected, which may cut clouds, too."""
        for one in (self._measured, self._parts, self._observations):
            one.clear()

    def _views(self) -> tuple[View, ...]:
        by_time = self._camera_times
        return tuple(
            View(self.folder, c, self.rig[c.name], by_time.get(c.name)) for c in self.file.cameras
        )

    def _filters(self, seed: int) -> CloudFilters:
        clouds = self.file.clouds
        return replace(CloudFilters() if clouds is None else clouds.filters, seed=seed)

    def observation(
        self,
        frame: int,
        silhouettes: bool = True,
        cloud: bool = True,
        hand: HandRegion | None = None,
    ) -> Observation:
        """Return what was seen of one frame.

        Missing views are absent; an empty mask is seen emptiness.

        Parameters
        ----------
        silhouettes, cloud
            What is wanted; the other is neither read nor computed.
        hand
            Crops the cloud, see `cloud`.

        Raises
        ------
        HandtrackError
            Outside the session's frames.
        """
        if frame not in self.known_frames and frame not in self.frame_range:
            raise HandtrackError(
                f"{self.folder}: no frame {frame}; {frames_words(self.frame_range)}."
            )
        cloud = cloud and self.has_clouds
        if self.cloud_filters.crop_m is None or not cloud:
            hand = None
        seen = self._kept(frame, silhouettes, cloud and hand is None)
        if hand is not None:
            seen = self._with_cloud(seen, self._cloud_near(frame, hand))
        pins = self.pins.observed(frame)
        return replace(seen, pins=pins) if pins else seen

    def prepare(self, frame: int, silhouettes: bool, cloud: bool) -> None:
        """Read and keep what `observation` needs of a frame wherever the hand is; a cloud that is known around a hand is enough."""
        self._kept(frame, silhouettes, False)
        if cloud and self._parts.get(frame) is None:
            self.measured_cloud(frame)

    def images(self, frame: int) -> tuple[ImageView, ...]:
        """Return a frame's images without their lenses' distortion; missing ones are absent. Not kept."""
        return tuple(v for view in self.views if (v := view.undistorted(frame)) is not None)

    def _kept(self, frame: int, silhouettes: bool, cloud: bool) -> Observation:
        """Return an observation without a crop, and keep it; of running cameras the latest, since frames count anew when they begin again."""
        key = (frame, silhouettes, cloud)

        most = most_observations if self.live is None else lambda _: LEAST_KEPT
        return whole(self._observations.value(key, lambda: kept(self._observe(*key)), most))

    def _observe(self, frame: int, silhouettes: bool, cloud: bool) -> Observation:
        if cloud:
            return self._with_cloud(self._kept(frame, silhouettes, False), self.cloud(frame)[0])
        views = self.views if silhouettes else ()
        seen = tuple(s for view in views if (s := view.silhouette(frame)) is not None)
        frames_later = {
            v.name: v.times.frames_later(frame) for v in self.views if v.times is not None
        }
        return Observation(frame, self.time_s(frame), weighed(seen), frames_later=frames_later)

    def _with_cloud(self, seen: Observation, cloud: PointCloud | None) -> Observation:
        assert self._clouds is not None
        return replace(
            seen,
            cloud=cloud,
            cloud_views=self._clouds.views,
            cloud_cameras=self._clouds.names,
        )

    def _find_clouds(self) -> dict[int, Path]:
        pattern = None if self.file.clouds is None else self.file.clouds.files
        if pattern is None:
            return {}
        where = f"{self.folder / SESSION_FILE}, [clouds], files"
        files = matching_files(self.folder, pattern, where)
        wrong = [path.name for path in files if path.suffix.lower() not in (".ply", ".npz")]
        if wrong:
            raise HandtrackError(f"{where}: '{wrong[0]}' is neither .ply nor .npz.")
        return files_by_frame(files)

    def _read_settings(self) -> TrackerSettings:
        try:
            return TrackerSettings().with_values(dotted(self.file.tracking))
        except HandtrackError as error:
            raise HandtrackError(f"{self.folder / SESSION_FILE}, [tracking]: {error}") from None

    def _read_times(self) -> tuple[FrameTimes, Mapping[str, CameraTimes]]:
        return session_times(self.folder, self.file.session, self.file.cameras)

    def _parameter_names(self) -> tuple[str, ...] | None:
        """Return the names that init.json may use; None when the model is a file, which is not read here."""
        hand = self.file.hand
        if hand.model not in MODELS:
            return None
        return load_model(hand.model, forearm=hand.forearm is not False).parameter_names

    def _optional(self, name: str, read: Callable[[Path], _T]) -> _T | None:
        path = inside(self.folder, name, str(self.folder))
        return read(path) if path.exists() else None

    def _hand_file(self, key: str, setting: str) -> Path:
        where = f"{self.folder / SESSION_FILE}, [hand], {key}"
        return matching_files(self.folder, setting, where)[0]


def _reopened(
    folder: Path,
    file: SessionFile,
    rig: CameraRig,
    corrections: Mapping[str, CameraCorrection],
    person: HandScale | None,
    seed: int,
) -> Session:
    session = Session(folder, file, rig).with_cameras(corrections)
    session.cloud_filters = session._filters(seed)
    if person is not None:
        session.prior_person = person
    return session


def frames_words(frames: range) -> str:
    """Return which frames a session has, in words."""
    return f"the session has {f'the frames 0 to {frames[-1]}' if frames else 'no frames'}"


def session_rig(folder: Path, file: SessionFile) -> CameraRig:
    """Return the calibration of a session's cameras, in their order and for their images' size. Raises HandtrackError for
    one that has none.
    """
    everything = read_rig(inside(folder, CALIBRATION_FILE, str(folder)), file.session.world_unit_m)
    for camera in file.cameras:
        if camera.name not in everything:
            raise HandtrackError(
                f"{folder / SESSION_FILE}: camera '{camera.name}' has no calibration in "
                f"{CALIBRATION_FILE}; cameras there: {', '.join(everything.names)}."
            )
    return CameraRig(tuple(scaled_camera(everything[c.name], c, folder) for c in file.cameras))
