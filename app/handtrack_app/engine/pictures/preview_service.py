"""The render thread: makes beside the worker what is only shown: clouds, surfaces, pictures of them."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator, Sized

import numpy as np

from handtrack.arrays import D2, Floats, N
from handtrack.diagnostics.residual_image import joint_pairs, joints_picture
from handtrack.errors import HandtrackError
from handtrack.model.kinematics import BonePoses
from handtrack.session.posed_frames import solver_params_of
from handtrack_app.engine.document import Document
from handtrack_app.engine.pictures.camera_pictures import CameraPictures, contact_sheet
from handtrack_app.protocol.calls import Mailbox
from handtrack_app.protocol.snapshots import Notice, PictureSnapshot, Snapshot

log = logging.getLogger(__name__)
Make = Callable[[], Snapshot | None]


class RenderThread:
    """Makes snapshots one after the other; of each kind only the newest order counts."""

    def __init__(self, publish: Callable[[Snapshot], None]) -> None:
        self._publish = publish
        self._mail: Mailbox[tuple[str, Make]] = Mailbox(lambda order: order[0])
        self._stopping = threading.Event()
        self._said: Notice | None = None
        self._thread = threading.Thread(target=self._work, name="render", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def stop(self, timeout: float = 5.0) -> None:
        """End the thread, after what it is making."""
        self._stopping.set()
        if self._thread.is_alive():
            self._thread.join(timeout)

    def ask(self, kind: str, make: Make) -> None:
        """Have something made and published; a waiting order of this kind is dropped."""
        self._mail.put((kind, make))

    def wait_for(self, kind: str, make: Make) -> Snapshot | None:
        """Have something made, and wait for it; None where it cannot be."""
        made, done = list[Snapshot | None](), threading.Event()

        def make_and_tell() -> None:
            try:
                made.append(make())
            finally:
                done.set()

        self.ask(f"{kind}, waited for", make_and_tell)
        while not done.wait(0.1):
            if self._stopping.is_set():
                return None
        return made[0] if made else None

    def _work(self) -> None:
        while not self._stopping.is_set():
            order = self._mail.take(0.2)
            if order is not None:
                self._serve(*order)

    def _serve(self, kind: str, make: Make) -> None:
        try:
            snapshot = make()
        except HandtrackError as error:
            self._say(Notice("error", "That cannot be shown", str(error)))
        except Exception as error:  # the page must go on, and the user must know
            log.exception("could not make %s", kind)
            self._say(Notice.of_mistake(error))
        else:
            if snapshot is not None:
                self._publish(snapshot)

    def _say(self, notice: Notice) -> None:
        if notice != self._said:  # the next frame would say the same
            self._said = notice
            self._publish(notice)


# ---- Paints what the page wants to see of the cameras at the frame shown, once no command waits


_PAINT_EVERY_S = 0.08  # at most this often: the hand itself comes first
_HURRIED_PAINT_S = (
    0.25  # and while tracking runs, which a picture takes its time from (`bench as_if_live`)
)


class Painter:
    """Lives on the worker's thread."""

    def __init__(
        self, document: Document, publish: Callable[[Snapshot], None], waiting: Sized
    ) -> None:
        """waiting: the commands that wait; painting gives way to them."""
        self._document, self._publish, self._waiting = document, publish, waiting
        self._maker = CameraPictures(document.run.session)
        self._thumbnails, self._paint = True, "plain"
        self._screens: tuple[tuple[str, str], ...] = ()
        self._painted = 0.0
        self.is_stale = False
        """there is something to paint"""
        self.hurried = False
        """tracking runs"""

    def want(self, thumbnails: bool, paint: str, screens: tuple[tuple[str, str], ...]) -> None:
        """Paint these pictures from now on."""
        self._thumbnails, self._paint, self._screens = thumbnails, paint, screens
        self.is_stale = True

    @property
    def rest_s(self) -> float:
        """How long the worker may wait for a command before there is something to paint."""
        if not self.is_stale:
            return 0.1
        every_s = _HURRIED_PAINT_S if self.hurried else _PAINT_EVERY_S
        return max(self._painted + every_s - time.monotonic(), 0.0)

    def paint(self) -> None:
        """Paint what the page wants; a command that comes meanwhile goes first, and painting begins anew."""
        self.is_stale, self._painted = False, time.monotonic()
        for picture in self._pictures():
            if picture is not None:
                self._publish(picture)
            elif len(self._waiting):
                self.is_stale = True
                return

    def painted(self) -> PictureSnapshot | None:
        """Return all that the page wants of the frame shown, in one; None where it wants none. Commands wait meanwhile."""
        self.is_stale, self._painted = False, time.monotonic()
        whole = None
        for picture in self._pictures():
            whole = picture or whole
        return whole

    def _pictures(self) -> Iterator[PictureSnapshot | None]:
        """Yield the large pictures, and all of them at last; None in between, where painting may end."""
        document, maker = self._document, self._maker
        session, frame = document.run.session, document.frame
        bones = document.model.bones(solver_params_of(document.model, document.seen))
        flesh = document.model.flesh["fine"].posed(bones)
        skeleton = document.model.skeleton
        aside = skeleton.bone("forearm") if document.model.has_forearm else None
        large = {}
        for camera, paint in self._screens:
            if camera not in session.rig.names or paint == "mask":
                continue  # masks may take long: they are made on the render thread
            silhouette, joints = None, None
            if paint == "residual":
                seen = session.observation(frame, cloud=False)
                silhouette = next((s for s in seen.silhouettes if s.camera.name == camera), None)
                joints = self._joints(camera, frame, bones)
            screen = maker.screen(camera, frame, paint, flesh, silhouette, aside)
            large[camera, paint] = screen if joints is None else joints_picture(screen, joints)
        if large:
            yield PictureSnapshot(frame, screens=large, version=document.version)
        small = {}
        for name in session.rig.names if self._thumbnails else ():
            yield None
            small[name] = maker.thumbnail(name, frame, self._paint, flesh)
        if small:
            sheet = contact_sheet({f"{name}  {frame}": image for name, image in small.items()})
            yield PictureSnapshot(frame, small, sheet, large, document.version)

    def _joints(self, camera: str, frame: int, bones: BonePoses) -> Floats[N, D2, D2]:
        """Return where a detector saw a camera's joints and where the model has them [px], of those that both have."""
        document = self._document
        model, sigma_px = document.model, document.run.settings.keypoints.detected_px
        seen = document.run.session.view(camera).keypoints(frame, sigma_px)
        places = model.joint_positions(bones)
        pairs = [joint_pairs(joints, model.joint_names, places) for joints in seen]
        return np.concatenate([np.zeros((0, 2, 2)), *pairs])
