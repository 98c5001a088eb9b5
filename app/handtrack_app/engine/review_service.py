"""Reviewing: frames are accepted and let go, the course of joint parameters is shown."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial

import numpy as np

from handtrack.diagnostics.metrics import BENT_JOINTS
from handtrack.errors import HandtrackError
from handtrack.session.doctor.check_hand import inconsistency_of_cameras
from handtrack.session.run import TrackingRun
from handtrack.session.session_state import decide
from handtrack.tracking.frame.result import FrameResult
from handtrack_app.engine import edits
from handtrack_app.engine.camera_pictures import CameraPictures, shrunk
from handtrack_app.engine.document import Moment
from handtrack_app.engine.document_snapshots import pose_snapshot
from handtrack_app.engine.service import Service
from handtrack_app.protocol import (
    CloseSnapshot,
    Command,
    Curve,
    CurvesSnapshot,
    Notice,
)


class ReviewService(Service):
    """Accepted frames, and curves."""

    names: tuple[str, ...] = ()
    """of the parameters whose course is shown"""

    @Command(edits=True)
    def accept(self, spans: tuple[tuple[int, int], ...], on: bool = True) -> None:
        """Accept frames, spans of first to last, as they are: neither tracking nor refining changes them; or let them go."""
        frames = {f for first, last in spans for f in range(first, last + 1)}
        values = edits.accepted(self.document, frames, on)
        named = f"Frame {min(frames, default=0)}" if len(frames) == 1 else f"{len(frames)} frames"
        if self.store.do(f"{named} {'accepted' if on else 'released'}", values):
            self.publish(pose_snapshot(self.document))
            self.opened.show_timeline()

    @Command(edits=True, tunes=True)
    def correct_cameras(self, cameras: tuple[str, ...], on: bool = True) -> None:
        """Use cameras as the estimate of the whole recording found them, from now on; or as they were calibrated."""
        document = self.document
        edit = (
            edits.corrected_cameras(document, cameras)
            if on
            else decide(camera=dict.fromkeys(cameras))
        )
        if on and any(document.camera_errors[name].error.is_of_time_alone for name in cameras):
            other = inconsistency_of_cameras(document.run, document.some_results())
            if other:
                raise HandtrackError(
                    f"Nothing is corrected: the joint estimate found time offsets alone, but {other}"
                )
        named = f"{'' if len(cameras) == 1 else 's'} {', '.join(cameras)}"
        words = f"Correction of camera{named}{'' if on else ' removed'}"
        self.store.do(words, edit)
        document.show(document.frame)
        known = document.session.corrected
        figures = [f"{name} by {known[name]}" for name in cameras if on and name in known]
        done = f"Corrected: {'; '.join(figures)}" if on else "The calibration counts again"
        again = f"{done}. Frames tracked so far stay; track again to use it."
        self.publish(Notice("done", f"Camera{named}", again))

    @Command(view=True, latest=())
    def want_close(self, frames: tuple[int, ...]) -> None:
        """Show small pictures of these frames, where they are tracked."""
        document, maker = self.document, self.opened.painter.maker
        results = [document.results[frame] for frame in frames if frame in document.results]
        make = partial(close_pictures, maker, document.run, results)
        self.opened.render_thread.ask("close", make)

    @Command(view=True, latest=())
    def want_curves(self, names: tuple[str, ...]) -> None:
        """Show the course of these joint parameters over the recording."""
        self.names = names
        self.publish_curves()

    def publish_curves(self) -> None:
        """Show the course of the joint parameters that are looked at."""
        document = self.document
        known, rows = document.model.parameter_names, document.rows
        count, curves = len(rows.frames), list[Curve]()
        hand = [(f - rows.frames.start, pose) for f, pose in document.by_hand.items()]
        for name in self.names if rows.values.shape[1] == len(known) else ():
            if name not in known:
                continue
            at = known.index(name)
            values, std = rows.values[:, at].copy(), rows.std[:, at].copy()
            truth = np.zeros(0)
            if (joint := name.removesuffix("_flex")) in BENT_JOINTS and joint != name:
                truth = values + rows.bent[:, BENT_JOINTS.index(joint)]
                truth = truth if np.isfinite(truth).any() else np.zeros(0)
            for row, pose in hand:
                if 0 <= row < count:
                    values[row], std[row] = pose[at], np.nan
            curves.append(Curve(name, values, std, truth))
        self.publish(CurvesSnapshot(tuple(curves)))


def close_pictures(
    maker: CameraPictures, run: TrackingRun, results: Iterable[FrameResult]
) -> CloseSnapshot:
    """Return small pictures of tracked frames: of the camera that a low confidence names, else of the first. On the render thread only."""
    names, pictures = run.session.rig.names, {}
    for result in results:
        camera = "" if result.reason is None else result.reason.camera
        moment = Moment(result.frame, run, run.model.bones_within_limits(result.parameters))
        close = maker.painted(moment, camera if camera in names else names[0], "close")
        pictures[result.frame] = shrunk(close)
    return CloseSnapshot(pictures)
