"""LiveRecording: what running cameras show and the poses found in it, written as a session folder."""

from __future__ import annotations

import queue
import shlex
import shutil
import threading
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2

from handtrack.capture.calibration.rig_file import read_rig
from handtrack.capture.clouds.cloud_filters import HandRegion
from handtrack.capture.images.live_feed import (
    LiveCamera,
    LiveFeed,
    LiveFrame,
    LiveImages,
    open_device,
)
from handtrack.capture.masks.seeded import Seeded
from handtrack.capture.masks.segmentation import SkinYCrCb
from handtrack.errors import HandtrackError, unknown_name
from handtrack.files.atomic import replace_text
from handtrack.geometry.camera import CameraRig
from handtrack.model.model_file import write_scale
from handtrack.observation.observation import Observation
from handtrack.session.first_pose import FirstPose, write_first_pose
from handtrack.session.layout import (
    CALIBRATION_FILE,
    HAND_FILE,
    INIT_FILE,
    POSES_FILE,
    SESSION_FILE,
)
from handtrack.session.run import TrackingRun
from handtrack.session.session import Session, session_rig
from handtrack.session.session_file import (
    CameraSettings,
    HandSettings,
    RecordingSettings,
    SessionFile,
    read_session_file,
    write_session_file,
)
from handtrack.session.sources.camera_times import COLUMNS, CameraTimes, FrameTimes
from handtrack.session.sources.views import View
from handtrack.session.tables import write_result
from handtrack.tracking.frame.result import FrameResult
from handtrack.tracking.frame.settings import TrackerSettings

LIVE_SETTINGS: dict[str, object] = {"model.fit_size": False}
"""in place of the usual ones: a search for lost fingers takes as long as many frames, and motion has gone on by then"""
_USUAL_FPS = 30.0


class LiveSession(Session):
    """Frames that do not exist yet are waited for: asking for the next one makes it, of the newest images.

    Masks are computed as for the folder's recording (and learned from it, where a method learns); depth, clouds but
    stereo ones, keypoints and truth are the recording's own and are left away.
    """

    def __init__(
        self, folder: Path, file: SessionFile, rig: CameraRig, feed: LiveFeed, note: str
    ) -> None:
        """Use `open_live`."""
        self.live, self._note = feed, note
        super().__init__(folder, file, rig)
        self.truth = None

    @property
    def known_frames(self) -> range:
        """The frames made so far; the oldest are forgotten."""
        return self._feed.known

    @property
    def frame_count(self) -> int:  # type: ignore[override]
        """One more than the last frame made so far."""
        return self._feed.known.stop

    @property
    def frame_range(self) -> range:
        """The frames whose images are still there: where a hand may be looked for."""
        return self._feed.with_images

    def time_s(self, frame: int) -> float:
        """Return when a frame was taken, since the cameras were started [s]."""
        known = self._feed.time_s(frame)
        return super().time_s(frame) if known is None else known

    def observation(
        self,
        frame: int,
        silhouettes: bool = True,
        cloud: bool = True,
        hand: HandRegion | None = None,
    ) -> Observation:
        """Return what is seen of a frame, after waiting for it; see Session.observation."""
        self._feed.reach(frame)
        return super().observation(frame, silhouettes, cloud, hand)

    def prepare(self, frame: int, silhouettes: bool, cloud: bool) -> None:
        self._feed.reach(frame)
        super().prepare(frame, silhouettes, cloud)

    def check_init(self, frames: range | None = None) -> None:
        """A live session's first pose is of no frame."""

    @property
    def warnings(self) -> list[str]:
        """What is to be known of the masks, and which cameras are gone."""
        return [*filter(None, [self._note]), *super().warnings]

    @property
    def _feed(self) -> LiveFeed:
        assert self.live is not None
        return self.live

    def _views(self) -> tuple[View, ...]:
        feed = self._feed
        live = {camera.name: LiveImages(feed, camera) for camera in feed.cameras}
        cameras = self.file.cameras
        return tuple(View(self.folder, c, self.rig[c.name], live=live[c.name]) for c in cameras)

    def _read_times(self) -> tuple[FrameTimes, Mapping[str, CameraTimes]]:
        return FrameTimes(self.file.session.fps or _USUAL_FPS), {}


def open_live(
    folder: Path | str, devices: Mapping[str, str], tolerance_s: float, rate: float = 1.0
) -> LiveSession:
    """Return a session of running cameras, with the settings and the calibration of a folder.

    The folder may be a session, or hold a calibration.toml only.

    Parameters
    ----------
    devices
        By camera; none: the cameras of the session are the devices 0, 1, 2 … in their order.
    tolerance_s
        How far apart the images of one frame may be.
    rate
        How many times faster than their pace video files are played.

    Raises
    ------
    HandtrackError
    """
    folder = Path(folder)
    file, rig = _settings(folder)
    names = tuple(camera.name for camera in file.cameras)
    for name in devices:
        if name not in names:
            raise unknown_name("camera", name, names, f"--camera {name}={devices[name]}")
    chosen = dict(devices) or {name: str(i) for i, name in enumerate(names)}
    twice = [name for name, device in chosen.items() if list(chosen.values()).count(device) > 1]
    if twice:
        raise HandtrackError(
            f"--camera: '{chosen[twice[0]]}' is given to the cameras {' and '.join(twice)}; expected one device a camera."
        )
    others = [c.name for c in file.cameras if c.name in chosen and _has_other_masks(c)]
    file = replace(
        file, cameras=tuple(_as_live(c, folder) for c in file.cameras if c.name in chosen)
    )
    clouds = (
        file.clouds
    )  # those made of pairs of cameras that are here; others are the recording's own
    if (
        clouds is None
        or not clouds.stereo
        or not {n for p in clouds.stereo for n in p} <= {*chosen}
    ):
        file = replace(file, clouds=None)
    rig = CameraRig(tuple(rig[camera.name] for camera in file.cameras))
    cameras: list[LiveCamera] = []
    try:
        for name in (camera.name for camera in file.cameras):
            where = f"camera '{name}' ({chosen[name]})"
            device = open_device(chosen[name], rig[name].size, where, rate, file.session.fps)
            cameras.append(LiveCamera(name, device, rig[name].size, where))
        rates = [camera.fps for camera in cameras if camera.fps > 0]
        recording = replace(file.session, fps=min(rates, default=file.session.fps or _USUAL_FPS))
        feed = LiveFeed(cameras, tolerance_s)
        session = LiveSession(folder, replace(file, session=recording), rig, feed, _note(others))
    except HandtrackError:
        for camera in cameras:
            camera.stop()
        raise
    feed.start()
    return session


def _settings(folder: Path) -> tuple[SessionFile, CameraRig]:
    """Return what a folder says of cameras and hand; of a calibration alone, the usual settings."""
    if not (folder / CALIBRATION_FILE).is_file():
        raise HandtrackError(
            f"{folder}: no {CALIBRATION_FILE} there; a live source needs calibrated cameras. Expected a session folder, or "
            "a folder with a calibration, as `handtrack calibrate` writes it."
        )
    if (folder / SESSION_FILE).is_file():
        file = read_session_file(folder / SESSION_FILE)
        return file, session_rig(folder, file)
    rig = read_rig(folder / CALIBRATION_FILE, 1.0)
    cameras = tuple(CameraSettings(name, masks=SkinYCrCb()) for name in rig.names)
    recording = RecordingSettings(folder.resolve().name, None)
    return SessionFile(recording, HandSettings(), cameras), rig


def _as_live(camera: CameraSettings, folder: Path) -> CameraSettings:
    """Return a camera's settings with its images only, and how masks are computed of them."""
    if camera.bayer is not None:
        raise HandtrackError(
            f"{folder / SESSION_FILE}, camera '{camera.name}': raw mosaics (bayer) cannot be taken live; expected a camera "
            "that gives colour images."
        )
    masks = SkinYCrCb() if _has_other_masks(camera) else camera.masks
    return replace(
        camera,
        masks=masks,
        mask_unknown=None,
        depth=None,
        depth_scale_m=None,
        keypoints=None,
        keypoint_layout=None,
        fps=None,
        lag_s=None,
    )


def _has_other_masks(camera: CameraSettings) -> bool:
    """Return whether masks are files of a recording, or computed of depth or joints: a live camera has images only."""
    masks = camera.masks
    if masks is None or isinstance(masks, str):
        return masks is not None
    return masks.needs != "images" or isinstance(masks, Seeded)


def _note(names: list[str]) -> str:
    """Return what becomes of cameras whose masks cannot be taken live; empty without any."""
    if not names:
        return ""
    return (
        f"The masks of {', '.join(names)} are files of the recording, or made of depth images. Live, they are computed by "
        'the colour of skin; choose how with masks = { method = "skin_ycrcb", ... } in session.toml.'
    )


# ---- What running cameras show and the poses found in it, written as a session folder


_WAITING = 90  # frames that wait to be encoded, before who makes frames waits as well
_LEAST_FREE = 1 << 26  # bytes of disk: when it is full, OpenCV says nothing
_TIMES_FILE = "timestamps.csv"


class LiveRecording:
    """Takes frames in order and encodes them on a thread of its own; `close` makes the folder complete.

    A video has no holes: a frame in which a connected camera shows nothing is left out, of poses, too, and counted. The
    video of a camera that goes ends there. Safe from several threads.
    """

    def __init__(self, folder: Path, session: LiveSession) -> None:
        """Make the folder. Raises HandtrackError where something is there already, or it cannot be written."""
        self.folder, self._session = folder, session
        self.left_out = 0
        """frames that were not recorded, a camera having shown nothing"""
        self.problem = ""
        """why frames cannot be written any more"""
        self._rows: dict[int, int] = {}  # frame of the feed → of the recording
        self._times: list[float] = []
        self._results: dict[int, FrameResult] = {}
        self._is_closed = False
        self._writers: dict[str, cv2.VideoWriter] = {}
        self._counts: dict[str, int] = {}
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if any(folder.iterdir()):
                raise HandtrackError(
                    f"{folder} is not empty; nothing was recorded. Name a new folder with --record."
                )
            shutil.copyfile(session.folder / CALIBRATION_FILE, folder / CALIBRATION_FILE)
        except OSError as error:
            raise HandtrackError(
                f"{folder}: cannot be recorded to ({error.strerror}). Name another folder with --record."
            ) from None
        self._adding = threading.Lock()
        self._frames: queue.Queue[LiveFrame | None] = queue.Queue(_WAITING)
        self._thread = threading.Thread(target=self._work, name="recording", daemon=True)
        self._thread.start()

    @property
    def count(self) -> int:
        """Frames recorded so far."""
        return len(self._rows)

    def add(self, frame: LiveFrame) -> None:
        """Record a frame of the feed; waits where encoding cannot follow."""
        with self._adding:
            if self._is_closed or self.problem:
                return
            if not frame.images or any(name not in frame.images for name in frame.connected):
                self.left_out += 1
                return
            self._rows[frame.number] = len(self._rows)
            self._times.append(frame.time_s)
            self._frames.put(frame)

    def note(self, result: FrameResult) -> None:
        """Keep the pose of a frame, if it is recorded."""
        row = self._rows.get(result.frame)
        if row is not None:
            time_s = result.time_s - self._times[0]
            self._results[row] = replace(result, frame=row, time_s=time_s)

    def close(self, run: TrackingRun) -> str:
        """Complete the folder; return what is in it, in words. run: model and settings that the poses were found with."""
        with self._adding:
            self._is_closed = True
            self._frames.put(None)
        self._thread.join()
        for writer in self._writers.values():
            writer.release()
        if not self._rows:
            shutil.rmtree(self.folder, ignore_errors=True)
            return f"Nothing was recorded: no frame came.{self._odd()}"
        try:
            self._write(run)
        except OSError as error:
            raise HandtrackError(
                f"{self.folder}: the recording is not complete ({error.strerror}); its videos are there."
            ) from None
        poses = f" with {len(self._results)} poses" if self._results else ""
        return f"{self.count} frames{poses} are in {self.folder}; open it with: handtrack open {shlex.quote(str(self.folder))}.{self._odd()}"

    def _odd(self) -> str:
        some = (
            f" {self.left_out} frames were left out: a camera showed nothing."
            if self.left_out
            else ""
        )
        return f"{some} {self.problem}".rstrip()

    def _write(self, run: TrackingRun) -> None:
        from handtrack.files.toml_edit import changed_toml  # slow to import

        session, file = self._session, self._session.file
        cameras = tuple(
            replace(camera, images=_video_name(i) if camera.name in self._writers else None)
            for i, camera in enumerate(file.cameras)
        )
        cameras = tuple(c if c.images else replace(c, masks=None) for c in cameras)
        times = self._times_file()
        recording = replace(
            file.session, name=self.folder.name, timestamps=_TIMES_FILE if times else None
        )
        if times:
            replace_text(self.folder / _TIMES_FILE, times)
        model = session.hand_model
        if isinstance(model, Path):
            shutil.copyfile(model, self.folder / model.name)
        write_scale(self.folder / HAND_FILE, run.scale)
        hand = replace(file.hand, scale=HAND_FILE, model=getattr(model, "name", model))
        usual = TrackerSettings().flat()
        tracking = {
            f"tracking.{name}": value
            for name, value in run.settings.flat().items()
            if value not in (usual.get(name), LIVE_SETTINGS.get(name, usual.get(name)))
        }
        whole = replace(file, session=recording, cameras=cameras, hand=hand, tracking={})
        path = self.folder / SESSION_FILE
        write_session_file(path, whole)
        replace_text(path, changed_toml(path.read_text(encoding="utf-8"), tracking))
        good = next((r for _, r in sorted(self._results.items()) if r.fits), None)
        if good is not None:
            named = run.model.named(good.parameters)
            write_first_pose(self.folder / INIT_FILE, FirstPose(good.frame, named))
        if self._results:
            (self.folder / POSES_FILE).parent.mkdir(exist_ok=True)
            write_result(self.folder / POSES_FILE, run.result(self._results.values()))

    def _times_file(self) -> str:
        """Return the table of times, empty where there are too few."""
        if len(self._times) < 2:
            return ""
        lines = [",".join(COLUMNS)]
        for name, count in self._counts.items():
            for frame, time_s in enumerate(self._times[:count]):
                lines.append(f"{name},{frame},{time_s - self._times[0]:.6f}")
        return "\n".join(lines) + "\n"

    # ---- on the recording's thread

    def _work(self) -> None:
        while (frame := self._frames.get()) is not None:
            for name, image in frame.images.items():
                if not self.problem and not self._encode(name, frame, image):
                    self.problem = f"The video of camera '{name}' cannot be written; is the disk full? Recording ended there."

    def _encode(self, name: str, frame: LiveFrame, image: Any) -> bool:
        writer = self._writers.get(name)
        if writer is None:
            if self._rows[frame.number] > 0:
                return True  # a camera is there from the first frame on, or not at all
            names = [camera.name for camera in self._session.file.cameras]
            path, size = self.folder / _video_name(names.index(name)), image.shape[1::-1]
            fps = self._session.fps
            writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), fps, size)
            self._writers[name] = writer
            self._counts[name] = 0
        if not writer.isOpened() or shutil.disk_usage(self.folder).free < _LEAST_FREE:
            return False
        writer.write(image)
        self._counts[name] += 1
        return True


def _video_name(index: int) -> str:
    return f"camera{index}.avi"
