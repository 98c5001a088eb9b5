"""LiveRecording: what running cameras show and the poses found in it, written as a session folder."""

from __future__ import annotations

import queue
import shutil
import threading
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2

from handtrack.capture.live.live_feed import LiveFrame
from handtrack.errors import HandtrackError
from handtrack.files.atomic import replace_text
from handtrack.model.model_file import write_scale
from handtrack.session.first_pose.first_pose import FirstPose, write_first_pose
from handtrack.session.formats.tables import write_result
from handtrack.session.formats.timestamps import COLUMNS
from handtrack.session.layout import (
    CALIBRATION_FILE,
    HAND_FILE,
    INIT_FILE,
    POSES_FILE,
    SESSION_FILE,
)
from handtrack.session.live.live_session import LIVE_SETTINGS, LiveSession
from handtrack.session.run import TrackingRun
from handtrack.session.session_file import write_session_file
from handtrack.tracking.frame.result import FrameResult
from handtrack.tracking.frame.settings import TrackerSettings

_WAITING = 90  # frames that wait to be encoded, before who makes frames waits as well
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
        return f"{self.count} frames{poses} are in {self.folder}; open it with: handtrack open {self.folder}.{self._odd()}"

    def _odd(self) -> str:
        some = (
            f" {self.left_out} frames were left out: a camera showed nothing."
            if self.left_out
            else ""
        )
        return f"{some} {self.problem}".rstrip()

    def _write(self, run: TrackingRun) -> None:
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
        tracking = _nested(
            {
                name: value
                for name, value in run.settings.flat().items()
                if value not in (usual.get(name), LIVE_SETTINGS.get(name, usual.get(name)))
            }
        )
        whole = replace(file, session=recording, cameras=cameras, hand=hand, tracking=tracking)
        write_session_file(self.folder / SESSION_FILE, whole)
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
        if not writer.isOpened():
            return False
        writer.write(image)
        self._counts[name] += 1
        return True


def _video_name(index: int) -> str:
    return f"camera{index}.avi"


def _nested(settings: Mapping[str, object]) -> dict[str, Any]:
    """Return dotted settings as the tables of session.toml."""
    tables: dict[str, Any] = {}
    for name, value in settings.items():
        *path, key = name.split(".")
        table = tables
        for part in path:
            table = table.setdefault(part, {})
        table[key] = value
    return tables
