"""RerunViewer: rerun's own viewer program, on loopback only, and so that neither it nor its page sends anything anywhere."""

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
from http.client import HTTPConnection
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import quote

from handtrack.files.user_folder import user_data_folder

LOOPBACK = "127.0.0.1"
_STARTING_S = 30.0
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
    told = {"analytics_enabled": False, "analytics_id": "", "metadata": {}}
    places = {"config_file_path": str(file), "data_dir_path": str(file.parent / "analytics")}
    file.write_text(json.dumps(told | places), encoding="utf-8")
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
