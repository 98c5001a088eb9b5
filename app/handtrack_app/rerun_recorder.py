"""ResidualRecorder: what each tracked frame left unexplained, painted for rerun beside the tracking.

Tracking hands over poses and numbers only. An own thread reads the silhouettes again, paints and logs them, and leaves
pictures out when it falls behind a live viewer; numbers are never left out.
"""

from __future__ import annotations

import atexit
import json
import logging
import os
import re
import socket
import subprocess
import sys
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from contextlib import contextmanager
from dataclasses import replace
from http.client import HTTPConnection
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from queue import SimpleQueue
from typing import TYPE_CHECKING
from urllib.parse import quote

import cv2
import numpy as np

from handtrack.arrays import D2, D3, Array, Axes, Bytes, Floats, H, N, P, W
from handtrack.diagnostics.residuals import (
    dots,
    image_residuals,
    predicted_image,
    residual_image,
    space_residuals,
)
from handtrack.files.user_folder import user_data_folder
from handtrack.geometry.camera import Camera
from handtrack.geometry.rotation import quaternion_wxyz
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.kinematics import BonePoses
from handtrack.observation.observation import Observation
from handtrack.observation.truth import mean_error_mm
from handtrack.session.run import TrackingRun
from handtrack.terms.silhouettes import ConicFieldTerm, CoverageTerm, outline_overlap
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.frame_terms import frame_terms
from handtrack.tracking.frame.result import FrameResult
from handtrack.tracking.frame.terms.appearance_terms import Before
from handtrack_app.protocol import Notice, RerunPage

if TYPE_CHECKING:
    from rerun import FileSink, GrpcSink, RecordingStream
    from rerun.blueprint import Blueprint


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
        """Start. closely: a frame whose every iteration is recorded, if tracked as `watching` says. report: gets the address of the live
        viewer's page once it is there.
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
        self._path = path
        self._viewer = RerunViewer() if live else None
        self._results: dict[int, FrameResult] = {}
        """of the frames that were recorded"""
        self._pictures: set[tuple[str, str]] = set()
        """cameras and kinds of pictures that the viewer has room for"""
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
        shown = {(camera, kind) for camera, made in pictures.items() for kind in made}
        if not shown <= self._pictures:
            self._pictures |= shown
            recording.send_blueprint(layout(self._pictures))
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
        fitted = {seen.camera.name: i for i, seen in enumerate(self._terms.prepared)}
        for silhouette in self._observation.silhouettes:
            made, i = views[silhouette.camera.name], fitted.get(silhouette.camera.name)
            counts = silhouette.mask >= 0
            if i is not None:  # else it contradicts the others, and is not fitted to
                valid = self._terms.prepared[i].mask.valid
                counts &= _within(valid, silhouette.mask.shape[1])
            mask = np.where(counts, silhouette.mask, 0.0)
            made["observed"] = grey(mask)
            if self._term is not None and i is not None:
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
        return dict(zip([seen.camera.name for seen in observed], shares, strict=True))

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


# ---- What is recorded, how it is shown, and the viewer: a process of its own


# ---- What stands in space of a tracked frame: cameras, skeleton, flesh and cloud; and where the viewer opens


_MOST_POINTS = 20_000  # of a cloud, evenly spread: enough to see it by
_LONG_MM = 80.0  # a camera's picture stands so far before it


def log_cameras(recording: RecordingStream, cameras: Sequence[Camera]) -> None:
    """Record where cameras stand, once for all frames."""
    import rerun as rr

    for camera in cameras:
        place = rr.Transform3D(translation=camera.centre, mat3x3=camera.rotation.T)
        recording.log(f"world/cameras/{camera.name}", place, static=True)
        eye = rr.Pinhole(
            image_from_camera=camera.matrix, resolution=camera.size, image_plane_distance=_LONG_MM / 1e3
        )  # fmt: skip
        recording.log(f"world/cameras/{camera.name}", eye, static=True)


def log_space(
    recording: RecordingStream,
    model: ArticulatedModel,
    bones: BonePoses,
    cloud: Floats[N, D3] | None,
    residuals: Mapping[str, tuple[Floats[N, D3], Floats[N]]],
) -> None:
    """Record a posed model, what a cloud had of it, and what is left between them, at the time that is set; world [m].

    residuals: places (N, 3) and signed values (N,), full at −1 and 1, by kind.
    """
    import rerun as rr

    ends = bones.position + bones.rotation[:, :, 1] * model.skeleton.length[:, None]
    rods = np.stack([bones.position, ends], axis=1)
    recording.log("world/skeleton", rr.LineStrips3D(rods, radii=0.0008, colors=[40, 90, 200]))
    ellipsoids = model.ellipsoids["fine"].posed(bones)
    turns = quaternion_wxyz(ellipsoids.rotation)[:, [1, 2, 3, 0]]
    shown = rr.Ellipsoids3D(
        centers=ellipsoids.centre, half_sizes=ellipsoids.radii, quaternions=turns, colors=[230, 180, 150], fill_mode="solid"
    )  # fmt: skip
    recording.log("world/flesh", shown)
    if cloud is not None and len(cloud):
        some = cloud[:: max(len(cloud) // _MOST_POINTS, 1)]
        recording.log("world/cloud", rr.Points3D(some, radii=0.0006, colors=[0, 158, 115]))
    for kind, (points, values) in residuals.items():
        result = rr.Points3D(points, radii=0.0012, colors=signed_colours(values))
        recording.log(f"world/residual_{kind}", result)


def signed_colours(residual: Floats[*Axes]) -> Bytes[*Axes]:
    """Return colours, RGB last: red where the hand was seen and not predicted (+1), blue the other way, white at 0."""
    value = np.clip(np.nan_to_num(residual), -1.0, 1.0)
    fade = np.rint(255 * (1 - np.abs(value))).astype(np.uint8)
    full = np.full_like(fade, 255)
    red, blue = np.where(value >= 0, full, fade), np.where(value <= 0, full, fade)
    return np.stack([red, fade, blue], axis=-1)


LOOPBACK = "127.0.0.1"
_STARTING_S = 120.0  # a busy machine reads its large program slowly; one that ends is told at once
_MEMORY = "500MB"


class RerunViewer:
    """A viewer in a process of its own, because rerun cannot serve on loopback from inside this one."""

    def __init__(self) -> None:
        self._data_port, self._page_port, self._inner_port = free_ports(3)
        self._process: subprocess.Popen[bytes] | None = None
        self._server: ThreadingHTTPServer | None = None

    @property
    def address(self) -> str:
        """Where recordings connect."""
        return f"rerun+http://{LOOPBACK}:{self._data_port}/proxy"

    @property
    def page(self) -> str:
        """The viewer's page, showing what is sent to `address`."""
        return f"http://{LOOPBACK}:{self._page_port}/?url={quote(self.address, safe='')}"

    def start(self) -> None:
        """Start the viewer and wait until it takes connections. RuntimeError when it does not."""
        command = [*_program(), "--serve-web", "--bind", LOOPBACK]
        command += ["--port", str(self._data_port), "--web-viewer-port", str(self._inner_port)]
        command += ["--server-memory-limit", _MEMORY]
        quiet = subprocess.DEVNULL
        self._process = subprocess.Popen(
            command, stdin=quiet, stdout=quiet, stderr=quiet, env=silent_environment()
        )
        atexit.register(self.stop)
        deadline = time.monotonic() + _STARTING_S
        while time.monotonic() < deadline:
            if self._process.poll() is not None:
                raise RuntimeError(
                    f"rerun's viewer ended at once, with code {self._process.returncode}"
                )
            if all(_listens(port) for port in (self._data_port, self._inner_port)):
                self._server = _page_server(self._page_port, self._inner_port, self._data_port)
                return
            time.sleep(0.1)
        raise RuntimeError(f"rerun's viewer did not answer within {_STARTING_S:.0f} s")

    def stop(self) -> None:
        """End the viewer."""
        atexit.unregister(self.stop)
        if self._server is not None:
            self._server.shutdown()
            self._server.server_close()
        if self._process is None or self._process.poll() is not None:
            return
        self._process.terminate()
        try:
            self._process.wait(5.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def silent_environment() -> dict[str, str]:
    """Return the environment of a viewer that keeps and sends no statistics: by a configuration of its own where that can be
    named, and by CI, as on machines that build, elsewhere.
    """
    own = user_data_folder().resolve()
    file = own / "rerun" / "analytics.json"
    file.parent.mkdir(parents=True, exist_ok=True)
    message = {"analytics_enabled": False, "analytics_id": "", "metadata": {}}
    places = {"config_file_path": str(file), "data_dir_path": str(file.parent / "analytics")}
    file.write_text(json.dumps(message | places), encoding="utf-8")
    return os.environ | {"XDG_CONFIG_HOME": str(own), "XDG_DATA_HOME": str(own), "CI": "1"}


def _page_server(port: int, inner_port: int, data_port: int) -> ThreadingHTTPServer:
    """Return a running server of the viewer's page, which may load from here alone: rerun's asks four hosts for fonts, releases and
    examples, and tells one of its use.
    """
    policy = (
        "default-src 'self' data: blob:; script-src 'self' 'unsafe-inline' 'unsafe-eval' blob:; style-src 'self' 'unsafe-inline'; "
        f"connect-src 'self' data: blob: http://{LOOPBACK}:{data_port}; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )

    class Page(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            inner = HTTPConnection(LOOPBACK, inner_port, timeout=10.0)
            inner.request("GET", self.path)
            answer = inner.getresponse()
            body = answer.read()
            if (
                b"<html" in body[:500].lower()
            ):  # a policy does not keep a browser from connecting early
                body = re.sub(rb'<link rel="preconnect"[^>]*>', b"", body)
            inner.close()
            self.send_response(answer.status)
            self.send_header("Content-Type", answer.getheader("Content-Type", ""))
            if encoding := answer.getheader("Content-Encoding"):
                self.send_header("Content-Encoding", encoding)
            self.send_header("Content-Length", str(len(body)))
            self.send_header("Content-Security-Policy", policy)
            self.send_header("Referrer-Policy", "no-referrer")
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, format: str, *args: object) -> None:
            """Say nothing."""

    server = ThreadingHTTPServer((LOOPBACK, port), Page)
    threading.Thread(target=server.serve_forever, name="rerun's page", daemon=True).start()
    return server


def _program() -> list[str]:
    """Return the command of rerun's viewer, without the Python around it that would outlive `stop`."""
    import rerun_cli

    name = "rerun.exe" if sys.platform == "win32" else "rerun"
    program = Path(str(rerun_cli.__file__)).parent / name
    return [str(program)] if program.is_file() else [sys.executable, "-m", "rerun"]


def _listens(port: int) -> bool:
    with socket.socket() as probe:
        probe.settimeout(0.5)
        return probe.connect_ex((LOOPBACK, port)) == 0


def free_ports(count: int) -> list[int]:
    """Return different free ports of loopback."""
    probes = [socket.socket() for _ in range(count)]
    try:
        for probe in probes:
            probe.bind((LOOPBACK, 0))
        return [probe.getsockname()[1] for probe in probes]
    finally:
        for probe in probes:
            probe.close()


_JPEG = 75
_CLOSING_S = 15.0


Pictures = dict[str, dict[str, Bytes[H, W, *Axes]]]
"""by camera and kind: `image` without its lens's distortion, `observed` and `predicted` coverage by the hand, `residual` as
`signed_colours`; and, of clouds, edges and texture, `residual_` and the kind
"""
DOTTED = "residual_"
_FIRST = ("residual", "image", "observed", "predicted")
"""of the kinds, in this order; then the others"""


@contextmanager
def recording_to(
    path: Path | None, viewer: RerunViewer | None, cameras: Sequence[Camera]
) -> Iterator[RecordingStream]:
    """Give a recording of one tracking run, to a file, to a live viewer, which is started, or to both. One thread begins it, logs and
    ends it: rerun's clock belongs to that. cameras: that are shown in space.
    """
    import rerun as rr

    sinks: list[FileSink | GrpcSink] = []
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        sinks.append(rr.FileSink(str(path)))
    if viewer is not None:
        viewer.start()
        sinks.append(rr.GrpcSink(viewer.address))
    recording = rr.RecordingStream("handtrack", send_properties=False)
    recording.set_sinks(*sinks, default_blueprint=layout())
    log_cameras(recording, cameras)
    try:
        yield recording
    finally:
        recording.flush(timeout_sec=_CLOSING_S)
        recording.disconnect()


# ---- entries → entities ----------------------------------------------------------------------------


def log_result(
    recording: RecordingStream, result: FrameResult, named: Mapping[str, float], error_mm: float
) -> None:
    """Record a frame's numbers; what is recorded next is of the same frame. named: joint parameters [m, rad]. error_mm: mean distance
    of joints to the truth, NaN without.
    """
    import rerun as rr

    recording.set_time("frame", sequence=result.frame)
    recording.set_time("time", duration=result.time_s)
    log_scalars(recording, "energy", {"total": result.energy, **result.energies})
    log_scalars(recording, "parameters", named)
    solved = {"iterations": result.iterations, "status": int(result.status)}
    log_scalars(recording, "solver", solved)
    if np.isfinite(error_mm):
        log_scalars(recording, "error", {"mm": error_mm})
    if result.note:
        words = f"frame {result.frame}: {result.note}"
        recording.log("log", rr.TextLog(words, level="WARN"))


def log_scalars(recording: RecordingStream, root: str, values: Mapping[str, float]) -> None:
    """Record numbers below an entity, by their names."""
    import rerun as rr

    for name, value in values.items():
        recording.log(f"{root}/{name}", rr.Scalars(float(value)))


def log_pictures(recording: RecordingStream, root: str, pictures: Pictures) -> None:
    """Record pictures below an entity, by camera and kind."""
    import rerun as rr

    for camera, made in pictures.items():
        for kind, picture in made.items():
            image = rr.Image(picture).compress(jpeg_quality=_JPEG)
            if kind.startswith(DOTTED):  # single pixels, which JPEG would blur
                contents = cv2.imencode(".png", picture[..., ::-1])[1].tobytes()
                image = rr.EncodedImage(contents=contents, media_type="image/png")
            recording.log(f"{root}/{camera}/{kind}", image)


def grey(picture: Array[H, W]) -> Bytes[H, W]:
    """Return bytes of a picture in 0…1."""
    return np.rint(255 * np.clip(np.nan_to_num(picture), 0.0, 1.0)).astype(np.uint8)


def layout(pictures: Set[tuple[str, str]] = frozenset()) -> Blueprint:
    """Return how the viewer arranges what is recorded: of each kind of pictures a tab, with each camera's beside the others'.

    pictures: cameras and kinds.
    """
    import rerun.blueprint as rrb

    known = {kind for _, kind in pictures}
    kinds = [kind for kind in _FIRST if kind in known] + sorted(known.difference(_FIRST))
    tabs = [
        rrb.Grid(
            *(
                rrb.Spatial2DView(origin=f"/cameras/{camera}/{kind}", name=camera)
                for camera, one in sorted(pictures)
                if one == kind
            ),
            name=kind.capitalize().replace("_", ": "),
        )
        for kind in kinds
    ]
    space = rrb.Spatial3DView(origin="/world", name="Space")
    many = rrb.PlotLegend(visible=False)  # a line's name stands at the pointer
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(space, rrb.Tabs(*tabs)) if tabs else space,
            rrb.Vertical(
                rrb.TimeSeriesView(origin="/energy", name="Cost by term"),
                rrb.TimeSeriesView(origin="/overlap", name="Overlap by camera"),
                rrb.TimeSeriesView(origin="/error", name="Error [mm]"),
                rrb.TimeSeriesView(
                    origin="/parameters", name="Parameters [m, rad]", plot_legend=many
                ),
                rrb.TextLogView(origin="/log", name="Frames of low confidence, or lost"),
            ),
            column_shares=[3, 2],
        ),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(timeline="frame", state="collapsed"),
    )
