"""ResidualRecorder: what each tracked frame left unexplained, painted for rerun beside the tracking.

Tracking hands over poses and numbers only. An own thread reads the silhouettes again, paints and logs them, and leaves
pictures out when it falls behind a live viewer; numbers are never left out.
"""

from __future__ import annotations

import logging
import threading
from collections import defaultdict
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from queue import SimpleQueue

import numpy as np

from handtrack.arrays import D2, D3, Array, Floats, N, P
from handtrack.diagnostics.residuals import (
    dots,
    image_residuals,
    predicted_image,
    residual_image,
    space_residuals,
)
from handtrack.model.kinematics import BonePoses
from handtrack.observation.observation import Observation
from handtrack.observation.truth import mean_error_mm
from handtrack.session.run import TrackingRun
from handtrack.terms.silhouettes.outline_overlap import outline_overlap
from handtrack.terms.silhouettes.silhouette_terms import ConicFieldTerm, CoverageTerm
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.frame_terms import frame_terms
from handtrack.tracking.frame.result import FrameResult
from handtrack.tracking.frame.terms.appearance_terms import Before
from handtrack_app.protocol.snapshots import Notice, RerunPage
from handtrack_app.rerun.stream import (
    DOTTED,
    Pictures,
    RerunViewer,
    grey,
    layout,
    log_pictures,
    log_result,
    log_scalars,
    log_space,
    recording_to,
    signed_colours,
    writable,
)

log = logging.getLogger(__name__)

_UNSEEN = 40  # grey where nothing was measured: white is a residual of 0
_BEHIND = 4  # frames waiting to be painted: the next goes without pictures
_FULL_SIGMAS = (
    3.0  # where a residual's colour is full: hardly any of a normal distribution is beyond
)


Step = tuple[Floats[P], float]
"""parameters that the solver accepted, and their cost"""


_Entry = tuple[TrackingRun, FrameResult, list[Step]]
"""a tracked frame that waits to be painted, and its iterations"""


class ResidualRecorder:
    """Records a run's frames for rerun: live, in a file, or both. Never makes tracking wait."""

    def __init__(
        self,
        run: TrackingRun,
        live: bool = False,
        path: Path | None = None,
        closely: int | None = None,
        report: Callable[[str], None] = lambda _: None,
    ) -> None:
        """Start. closely: a frame whose every iteration is recorded, if tracked as `watching` says. tell: gets the address of the live
        viewer's page once it is there.

        Raises HandtrackError when the file cannot be written.
        """
        self.without_pictures = 0
        """frames recorded without pictures, because painting was slower than tracking"""
        self._run = run
        self._closely = closely
        self._steps: list[Step] = []
        self._watched: tuple[_Entry, _Painter] | None = None
        self.problem = ""
        """why recording stopped, in words; empty while all is well"""
        self._waiting: SimpleQueue[_Entry | None] = SimpleQueue()
        """None: the end"""
        self._live, self._report = live, report
        assert path is not None or live, "neither a file nor a viewer"
        self._path = None if path is None else writable(path)
        self._viewer = RerunViewer() if live else None
        self._results: dict[int, FrameResult] = {}
        """of the frames that were recorded"""
        self._kinds: set[str] = set()
        """of pictures that the viewer has room for, besides the usual ones"""
        self._thread = threading.Thread(target=self._paint_all, name="residuals", daemon=True)
        self._thread.start()

    @property
    def url(self) -> str:
        """Where the live viewer's page is; empty without one."""
        return "" if self._viewer is None else self._viewer.page

    @property
    def is_behind(self) -> bool:
        """Whether more frames wait than can be painted soon."""
        return self._waiting.qsize() > _BEHIND

    def watching(self, control: Control) -> Control:
        """Return the control to track with, so that the frame `closely` can be recorded.

        The iterations recorded are those that made the result; nothing is solved twice.
        """
        if self._closely is None:
            return control

        def note(frame: int, count: int, params: Floats, cost: float) -> None:
            if frame == self._closely:
                self._steps.append((params.copy(), cost))

        return replace(control, on_iteration=note)

    def show(self, result: FrameResult, run: TrackingRun | None = None) -> None:
        """Hand in a tracked frame; returns at once. run: that it was tracked with, where that is another of the same session."""
        if self.problem:
            return
        steps: list[Step] = []
        if result.frame == self._closely:
            steps, self._steps = self._steps, steps
        self._waiting.put((run or self._run, result, steps))

    def go_on_with(self, run: TrackingRun) -> None:
        """Record what is handed in from now on as frames of another run of the same session."""
        self._run, self._steps = run, []

    def close(self, keep_viewer: bool = False) -> None:
        """Record what waits and end. keep_viewer: leave the live viewer running until closed again."""
        self._waiting.put(None)
        self._thread.join()
        if self._viewer is not None and not keep_viewer:
            self._viewer.stop()

    # ---- on the painting thread

    def _paint_all(self) -> None:
        try:
            cameras = self._run.session.rig.cameras
            with recording_to(self._path, self._viewer, cameras) as self._recording:
                if self._live:
                    self._report(self.url)
                for entry in iter(self._waiting.get, None):
                    self._record(*entry)
                self._record_watched()
        except Exception as error:  # tracking goes on without the recording
            log.exception("recording residuals stopped")
            self.problem = f"recording residuals stopped: {error}"
            self._waiting = SimpleQueue()

    def _record(self, run: TrackingRun, result: FrameResult, steps: list[Step]) -> None:
        named = run.model.named(result.parameters)
        log_result(self._recording, result, named, _error_mm(run, result))
        if self._live and self.is_behind and result.frame != self._closely:
            self.without_pictures += 1
        else:
            self._record_pictures(run, result, steps)
        self._results[result.frame] = result

    def _record_pictures(self, run: TrackingRun, result: FrameResult, steps: list[Step]) -> None:
        model, recording = run.model, self._recording
        params = model.transform.solver_params(result.parameters)
        painter = _Painter(run, result.frame, params, self._before(run, result.frame))
        pictures = painter.pictures(params)
        kinds = {kind for made in pictures.values() for kind in made if kind.startswith(DOTTED)}
        if not kinds <= self._kinds:
            self._kinds |= kinds
            recording.send_blueprint(layout(self._kinds))
        log_pictures(recording, "cameras", pictures)
        log_scalars(recording, "overlap", painter.overlap())
        log_space(recording, model, *painter.space())
        if steps:
            self._watched = (run, result, steps), painter

    def _before(self, run: TrackingRun, frame: int) -> Before | None:
        """Return the frame whose texture is carried into this one, and the first; None where none is, or none is looked at."""
        if run.settings.intensity.weight == 0:
            return None
        count = len(run.model.parameter_names)  # others are of another model
        known = {n: r for n, r in self._results.items() if len(r.parameters) == count}
        last = next((known[n] for n in (frame - 1, frame + 1) if n in known), None)
        if last is None:
            return None
        first = next(iter(known.values()))
        return replace(_solved(run, last), first=_solved(run, first))

    def _record_watched(self) -> None:
        """Record the iterations of the frame `closely`, of its last pass: each once, however often the frame was handed in."""
        if self._watched is None:
            return
        (run, result, steps), painter = self._watched
        model, recording = run.model, self._recording
        root = f"closely/frame_{result.frame}"
        recording.reset_time()
        for count, (params, cost) in enumerate(steps, start=1):
            recording.set_time("iteration", sequence=count)
            log_scalars(recording, f"{root}/energy", {"total": cost})
            named = model.named(model.joint_params(params))
            log_scalars(recording, f"{root}/parameters", named)
            log_pictures(recording, f"{root}/cameras", painter.pictures(params))


class _Painter:
    """Pictures of one frame at different poses: the observation and bands as the solver's last stage has them."""

    def __init__(self, run: TrackingRun, frame: int, params: Floats, before: Before | None) -> None:
        """params: (P,) the frame's pose, which fixes the bands and where the forearm is cut off."""
        self.params = params
        self._model = run.model
        use = run.settings.silhouettes.weight > 0
        self._observation = run.session.observation(
            frame, silhouettes=use, cloud=run.session.has_clouds
        )
        images = tuple(run.session.images(frame))
        self._images = {view.camera.name: view.pixels[..., ::-1] for view in images}
        if run.settings.uses_images:
            self._observation = replace(self._observation, images=images)
        cameras = [view.camera for view in (*self._observation.silhouettes, *images)]
        self._cameras = {c.name: c for c in cameras or run.session.rig.cameras}
        bones = run.model.bones(params)
        self._terms = frame_terms(
            run.model, run.settings, self._observation, bones, None, before=before
        )
        self._inside = -run.settings.traits.inside
        kinds = (CoverageTerm, ConicFieldTerm)
        self._last = self._terms.stage(bones)
        self._term = next((term for term in self._last if isinstance(term, kinds)), None)

    def pictures(self, params: Floats) -> Pictures:
        """Return what each camera saw and what a pose (P,) predicts there; black and white beyond what counts."""
        bones = self._model.bones(params)
        views: Pictures = defaultdict(dict)
        for (name, kind), parts in self._residuals(bones).items():
            pixels, sigmas = (np.concatenate(part) for part in zip(*parts, strict=True))
            drawn = dots(self._cameras[name].size, pixels, sigmas / _FULL_SIGMAS)
            colours = np.where(np.isnan(drawn)[..., None], _UNSEEN, signed_colours(drawn))
            views[name][DOTTED + kind] = colours.astype(np.uint8)
        for name, image in self._images.items():
            views[name]["image"] = image
        for i, silhouette in enumerate(self._observation.silhouettes):
            counts = _within(self._terms.prepared[i].mask.valid, silhouette.mask.shape[1])
            counts &= silhouette.mask >= 0
            mask = np.where(counts, silhouette.mask, 0.0)
            made = views[silhouette.camera.name]
            made["observed"] = grey(mask)
            if self._term is not None:
                field = predicted_image(self._term, i, bones)
                inside = self._inside if isinstance(self._term, ConicFieldTerm) else 1.0
                made["predicted"] = grey(-field)
                residual = np.where(counts, residual_image(field, inside * mask), 0.0)
                made["residual"] = signed_colours(residual)
        return views

    def _residuals(
        self, bones: BonePoses
    ) -> dict[tuple[str, str], list[tuple[Floats[N, D2], Floats[N]]]]:
        """Return pixels and signed residuals [sigmas] of clouds, edges and texture, by camera and kind."""
        results = defaultdict[tuple[str, str], list[tuple[Floats, Floats]]](list)
        for term in self._last:
            for kind, points, sigmas in space_residuals(term, bones):
                for name, camera in self._cameras.items():
                    results[name, kind].append((camera.project(points), sigmas))
            for kind, camera, pixels, sigmas in image_residuals(term, bones):
                results[camera.name, kind].append((pixels, sigmas))
        return results

    def overlap(self) -> dict[str, float]:
        """Return how far model and mask overlap in each camera."""
        observed, bones = self._terms.prepared, self._model.bones(self.params)
        if not observed:
            return {}
        shares = outline_overlap(observed, self._model.ellipsoids["fine"], bones).iou.tolist()
        names = [silhouette.camera.name for silhouette in self._observation.silhouettes]
        return dict(zip(names, shares, strict=True))

    def space(
        self,
    ) -> tuple[BonePoses, Floats[N, D3] | None, dict[str, tuple[Floats[N, D3], Floats[N]]]]:
        """Return the hand's bones, the cloud, and what is left between them by kind: places and signed values, full at −1 and 1."""
        cloud = self._observation.cloud
        bones = self._model.bones(self.params)
        residuals = {
            kind: (points, sigmas / _FULL_SIGMAS)
            for term in self._last
            for kind, points, sigmas in space_residuals(term, bones)
        }
        return bones, None if cloud is None else cloud.points, residuals


def _solved(run: TrackingRun, result: FrameResult) -> Before:
    """Return a tracked frame as texture is carried from it."""
    images = tuple(run.session.images(result.frame))
    observed = Observation(result.frame, result.time_s, images=images)
    return Before(observed, run.model.bones(run.model.transform.solver_params(result.parameters)))


def _error_mm(run: TrackingRun, result: FrameResult) -> float:
    truth = run.session.truth
    true = None if truth is None else truth.points_at(result.frame, run.model.joint_names)
    estimate = result.joint_positions if result.keypoints21 is None else result.keypoints21
    return mean_error_mm(estimate, true)


def _within(spans: Array, width: int) -> Array:
    """Return (H, W) True within the spans (H, 2) of each row."""
    columns = np.arange(width)
    return (columns >= spans[:, :1]) & (columns < spans[:, 1:])


class LiveRecorder:
    """One recording in one viewer, of frames of whatever settings, once it is switched on."""

    def __init__(self, publish: Callable[[Notice | RerunPage], None], is_on: bool) -> None:
        self.is_on = is_on
        """whether tracked frames are recorded as they come"""
        self._publish = publish
        self._recorder: ResidualRecorder | None = None

    @property
    def is_behind(self) -> bool:
        """Whether frames wait to be painted."""
        return self._recorder is not None and self._recorder.is_behind

    def open(self) -> None:
        """Record from now on, and say where the viewer is; in another one where recording stopped."""
        self.is_on = True
        if self._recorder is not None and self._recorder.problem:
            self.close()
        if self._recorder is not None:
            self._publish(RerunPage(self._recorder.url))

    def show(self, run: TrackingRun, result: FrameResult) -> None:
        """Show one tracked frame, if it is on. Called on the tracking thread; returns at once."""
        if not self.is_on:
            return
        recorder = self._recorder
        if recorder is None:
            report = lambda url: self._publish(RerunPage(url))  # noqa: E731
            self._recorder = recorder = ResidualRecorder(run, live=True, report=report)
        recorder.show(result, run)
        if recorder.problem:
            self.is_on = False
            self._publish(Notice("warning", "Nothing goes to rerun", recorder.problem))

    def close(self) -> None:
        """End the recording and its viewer."""
        if self._recorder is not None:
            self._recorder.close()
            self._recorder = None
