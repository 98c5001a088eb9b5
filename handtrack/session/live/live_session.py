"""A session whose images come from cameras that are running: settings and calibration of a folder, frames of a feed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from handtrack.capture.calibration.rig_file import read_rig
from handtrack.capture.clouds.cloud_filters import HandDistance
from handtrack.capture.live.live_feed import LiveCamera, LiveFeed, LiveImages, open_device
from handtrack.capture.masks.seeded import Seeded
from handtrack.capture.masks.segmentation import SkinYCrCb
from handtrack.errors import HandtrackError, unknown_name
from handtrack.geometry.camera import CameraRig
from handtrack.observation.observation import Observation
from handtrack.session.formats.timestamps import FrameTimes
from handtrack.session.layout import CALIBRATION_FILE, SESSION_FILE
from handtrack.session.session import Session, session_rig
from handtrack.session.session_file import (
    CameraSettings,
    HandSettings,
    RecordingSettings,
    SessionFile,
    read_session_file,
)
from handtrack.session.sources.camera_times import CameraTimes
from handtrack.session.sources.views import View

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
        hand_distance: HandDistance | None = None,
    ) -> Observation:
        """Return what is seen of a frame, after waiting for it; see Session.observation."""
        self._feed.reach(frame)
        return super().observation(frame, silhouettes, cloud, hand_distance)

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
