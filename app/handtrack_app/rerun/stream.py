"""Residual pictures, energies and parameters for rerun's viewer, live or as a file: what is recorded, and how it is shown."""

from __future__ import annotations

import atexit
import json
import os
import re
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping, Sequence, Set
from contextlib import contextmanager, suppress
from http.client import HTTPConnection
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote

import cv2
import numpy as np

from handtrack.arrays import D3, Array, Axes, Bytes, Floats, H, N, W
from handtrack.errors import HandtrackError
from handtrack.files.user_folder import user_data_folder
from handtrack.geometry.camera import Camera
from handtrack.geometry.rotation import quaternion_wxyz
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.kinematics import BonePoses
from handtrack.tracking.frame.result import FrameResult

# ---- What stands in space of a tracked frame: cameras, skeleton, flesh and cloud; and where the viewer opens


if TYPE_CHECKING:
    from rerun import FileSink, GrpcSink, RecordingStream
    from rerun.blueprint import Blueprint

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


def layout(kinds: Set[str] = frozenset()) -> Blueprint:
    """Return how the viewer arranges what is recorded. kinds: of pictures, besides the usual ones."""
    import rerun.blueprint as rrb

    shown = [
        rrb.Spatial2DView(origin="/cameras", contents=f"/cameras/*/{kind}", name=kind.capitalize().replace("_", ": "))
        for kind in ("image", "residual", "observed", "predicted", *sorted(kinds))
    ]  # fmt: skip
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(
                rrb.Spatial3DView(origin="/world", name="Space"),
                rrb.Grid(*shown),
            ),
            rrb.Vertical(
                rrb.TimeSeriesView(origin="/energy", name="Cost by term"),
                rrb.TimeSeriesView(origin="/overlap", name="Overlap by camera"),
                rrb.TimeSeriesView(origin="/error", name="Error [mm]"),
                rrb.TimeSeriesView(origin="/parameters", name="Parameters [m, rad]"),
                rrb.TextLogView(origin="/log", name="Frames of low confidence, or lost"),
            ),
            column_shares=[3, 2],
        ),
        rrb.TimePanel(timeline="frame"),
    )


def writable(path: Path) -> Path:
    """Return a file's path. Raises HandtrackError when a recording cannot be written there."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with suppress(FileNotFoundError), path.open("rb+"):
            return path
        path.touch()
    except OSError as error:
        raise HandtrackError(
            f"{path}: the recording for rerun cannot be written there ({error.strerror}). Name another "
            "file, ending in .rrd."
        ) from None
    return path
