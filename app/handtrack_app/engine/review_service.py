"""Reviewing: frames are accepted and let go, a take is compared, the course of joint parameters is shown."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from handtrack.arrays import Floats, P
from handtrack.diagnostics.flexion import BENT_JOINTS
from handtrack.diagnostics.score import Score, score
from handtrack.errors import HandtrackError
from handtrack.session.doctor.check_tracked import inconsistency_of_cameras
from handtrack.session.run import TrackingRun
from handtrack.session.session_state import decide
from handtrack.tracking.frame.result import FrameResult
from handtrack_app.engine.document import Document
from handtrack_app.engine.document_snapshots import energy_parts, pose_snapshot, timeline_snapshot
from handtrack_app.engine.service import Service
from handtrack_app.engine.store import edits
from handtrack_app.protocol.calls import command
from handtrack_app.protocol.palette import COMPARED
from handtrack_app.protocol.snapshots import (
    ComparedSnapshot,
    Curve,
    CurvesSnapshot,
    Notice,
    ScoreSnapshot,
    Snapshot,
)


class ReviewService(Service):
    """Accepted frames, the take that is compared, and curves."""

    number: int | None = None
    """of the take that is compared"""
    names: tuple[str, ...] = ()
    """of the parameters whose course is shown"""

    @command(edits=True, words="accepting {frames}, or letting them go")
    def accept(self, spans: tuple[tuple[int, int], ...], on: bool = True) -> None:
        """Accept frames, spans of first to last, as they are: neither tracking nor refining changes them; or let them go."""
        frames = {f for first, last in spans for f in range(first, last + 1)}
        values = edits.accepted(self.document, frames, on)
        named = f"Frame {min(frames, default=0)}" if len(frames) == 1 else f"{len(frames)} frames"
        if self.store.do(f"{named} {'accepted' if on else 'let go'}", values):
            self.publish(pose_snapshot(self.document))
            self.opened.announce(timeline_snapshot(self.document))

    @command(edits=True, words="the correction of camera {camera}")
    def correct_camera(self, camera: str, on: bool = True) -> None:
        """Use a camera as the estimate of the whole recording found it, from now on; or as it was calibrated."""
        self.jobs.require_idle()
        document, found = self.document, self.document.camera_errors.get(camera)
        if on and found is not None and found.error.is_of_time_alone:
            other = inconsistency_of_cameras(document.run, document.some_results())
            if other:
                raise HandtrackError(
                    f"Camera '{camera}' is not corrected: the joint estimate found a time offset alone, but {other}"
                )
        edit = edits.corrected_camera(document, camera) if on else decide(camera={camera: None})
        words = f"Correction of camera {camera}"
        self.opened.see_cameras(lambda: self.store.do(words if on else f"{words} removed", edit))
        figures = self.document.run.session.corrected.get(camera, "")
        done = f"Corrected by {figures}" if on else "Its calibration counts again"
        again = f"{done}. Frames tracked so far stay; track again to use it."
        self.publish(Notice("done", f"Camera {camera}", again))

    @command(view=True, latest=())
    def want_curves(self, names: tuple[str, ...]) -> None:
        """Show the course of these joint parameters over the recording."""
        self.names = names
        self.tell_curves()

    @command(view=True, latest=())
    def compare_take(self, number: int | None) -> None:
        """Show how far a take lies from the track; None: none."""
        document = self.document
        take = None if number is None else document.takes.get(number)
        if number is not None and take is None:
            raise HandtrackError(f"Take {number} has no frames that could be compared.")
        if take is not None and take.parameter_names != document.model.parameter_names:
            raise HandtrackError(
                f"Take {number} is of another model than the one in force: their joints cannot be compared. Bring it back first, "
                "which brings its model."
            )
        self.number = number
        document.rows.compare(take)
        self.show()
        self.opened.announce(timeline_snapshot(document))

    def show(self) -> None:
        """Tell how the take that is compared has the frame shown."""
        document = self.document
        frame, take = document.frame, document.rows.compared
        result = None if take is None else take.get(frame)
        if result is None or len(result.T_world_bone) != len(document.model.skeleton.length):
            self.publish(ComparedSnapshot(frame, ""))
            return
        bones, length = result.T_world_bone, document.model.skeleton.length
        self.publish(
            ComparedSnapshot(
                frame, "compared", (), np.full(len(length), COMPARED), bones[:, :3, 3].copy(),
                bones[:, :3, :3].copy(), length,
            )
        )  # fmt: skip

    def tell_curves(self) -> None:
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
            curves.append(Curve(name, values, std, rows.other[:, at].copy(), truth))
        fps = float(document.run.session.fps)
        self.publish(CurvesSnapshot(rows.frames.start, fps, tuple(curves), self.number))


_RESTS_S = 0.2  # a frame's masks are made for the score once it is looked at for so long
_FIRST_S = (
    2.0  # and what it is computed by is loaded, which takes seconds, once nobody is in a hurry
)


@dataclass
class LiveScore:
    """Lives on the worker's thread."""

    document: Document
    publish: Callable[[Snapshot], None]
    since: float | None = None
    """when a pose was shown that has no score yet"""
    _frame: int | None = None
    """scored last: what was seen of it is at hand"""
    _fitted: tuple[FrameResult, TrackingRun, Score] | None = None
    """judged by the settings in force, as what is compared with it"""

    @property
    def is_due(self) -> bool:
        """Whether there is a pose to score, and it may be done now."""
        if self.since is None or self.document.run.session.live is not None:
            return False
        at_hand = self._frame == self.document.frame
        rests_s = _FIRST_S if self._frame is None else _RESTS_S
        return at_hand or time.monotonic() - self.since > rests_s

    def tell(self) -> None:
        """Score the pose shown, and the one that was fitted to its frame last."""
        document, self.since = self.document, None
        self._frame = frame = document.frame
        params = document.model.params_within_limits(document.seen)
        now, result = self._score(frame, params), document.results.get(frame)
        if result is None or len(result.parameters) != len(document.shown):
            self._fitted = None
        elif self._fitted is None or self._fitted[:2] != (result, document.run):
            then = self._score(frame, document.model.params_within_limits(result.parameters))
            self._fitted = result, document.run, then
        fitted = None if self._fitted is None else self._fitted[2]
        self.publish(
            ScoreSnapshot(
                frame, tuple(document.seen.tolist()), now.overlap, dict(energy_parts(now.energy)),
                None if fitted is None else fitted.overlap,
                None if fitted is None else sum(fitted.energy.values()),
            )
        )  # fmt: skip

    def _score(self, frame: int, params: Floats[P]) -> Score:
        model, run = self.document.model, self.document.run
        seen = run.observation(frame, model.bones(params))
        return score(model, run.settings, seen, params)
