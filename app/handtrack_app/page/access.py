"""Who may reach the workbench: this machine alone unless asked otherwise, and never another site's page.

viser has no log-in and looks at no `Origin`. So the server listens on loopback, the handshake refuses
pages of other sites (also those that reach loopback through a name of their own), and no client can open
a public tunnel.
"""

from __future__ import annotations

import ipaddress
import socket
import threading
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from http import HTTPStatus
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from handtrack.errors import HandtrackError

if TYPE_CHECKING:
    import viser

LOOPBACK = "127.0.0.1"
FIRST_PORT = 8080
_PORTS_TRIED = 100
_starting = threading.Lock()

# ---- where to listen -------------------------------------------------------------------------------


def is_loopback(host: str) -> bool:
    """Return whether only this machine can reach a server that listens on `host`."""
    if host.lower() == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


def host_warning(host: str) -> str:
    """Return what the user must know of the chosen host; nothing for loopback.

    Raises HandtrackError when this machine has no such address.
    """
    if is_loopback(host):
        return ""
    try:
        with socket.socket(_family(host), socket.SOCK_STREAM) as probe:
            probe.bind((host, 0))
    except OSError as error:
        raise HandtrackError(
            f"--host {host}: this machine cannot listen there ({error.strerror or error}). Leave --host away "
            f"to listen on {LOOPBACK}, for this machine alone."
        ) from None
    return (
        f"--host {host}: everyone who can reach this machine over the network can now see the recording, "
        "change poses and write into the session folder; there is no password. Use it in networks you "
        f"trust, or forward a port instead: ssh -L {FIRST_PORT}:{LOOPBACK}:{FIRST_PORT} this-machine"
    )


def choose_port(host: str, asked: int | None = None) -> int:
    """Return a free port: the one asked for, else the first free one from 8080 on.

    0 lets the system choose. Raises HandtrackError when the port asked for is taken or no port at all.
    """
    if asked is not None:
        if not 0 <= asked <= 65535:
            raise HandtrackError(
                f"--port {asked}: expected a number from 1 to 65535, or 0 for any."
            )
        problem = _bind(host, asked)
        if problem is None:
            return asked
        raise HandtrackError(
            f"--port {asked}: this port of {host} cannot be used ({problem.strerror or problem}). Perhaps "
            "another workbench is open there; close it, or leave --port away to use the next free one."
        )
    for port in range(FIRST_PORT, FIRST_PORT + _PORTS_TRIED):
        if _bind(host, port) is None:
            return port
    raise HandtrackError(
        f"no free port on {host} from {FIRST_PORT} to {FIRST_PORT + _PORTS_TRIED - 1}; name one with --port."
    )


def _bind(host: str, port: int) -> OSError | None:
    """Return why a server could not listen on a port, None when it could."""
    with socket.socket(_family(host), socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
            probe.listen(1)
        except OSError as error:
            return error
    return None


def _family(host: str) -> socket.AddressFamily:
    return socket.AF_INET6 if ":" in host else socket.AF_INET


# ---- who may connect -------------------------------------------------------------------------------


def guarded_server(
    host: str = LOOPBACK, port: int = 0, label: str = "handtrack"
) -> viser.ViserServer:
    """Return a started viser server that refuses other sites' pages and opens no tunnels.

    Raises HandtrackError when the port was taken since it was chosen.
    """
    import viser

    with _checked_handshakes(host):
        server = viser.ViserServer(host=host, port=port, label=label, verbose=False)
    server.request_share_url = lambda verbose=True: None  # type: ignore[method-assign]
    server.gui.configure_theme(show_share_button=False)
    if port and server.get_port() != port:  # viser takes the next one without a word
        server.stop()
        raise HandtrackError(
            f"port {port} of {host} was taken while the workbench started; try again, or name another "
            "with --port."
        )
    return server


def is_own_page(
    origin: str | None, host_header: str | None, allowed: Collection[str] | None
) -> bool:
    """Return whether a request comes from a page of this server, or from a program.

    origin, host_header: of the request. A program sends no Origin. A page of another site has another
    Origin; one that made its own name point to loopback betrays itself in Host.
    """
    if host_header is not None and not _is_allowed(f"//{host_header}", allowed):
        return False
    if origin is None:
        return True
    if not _is_allowed(origin, allowed):
        return False
    return host_header is None or urlsplit(origin).netloc.lower() == host_header.lower()


def _is_allowed(url: str, names: Collection[str] | None) -> bool:
    """Return whether a URL has one of the names, or any name where they are None."""
    try:
        name = (urlsplit(url).hostname or "").lower()
    except ValueError:
        return False
    return bool(name) if names is None else name in names


def _allowed_names(host: str) -> Collection[str] | None:
    if is_loopback(host):
        return {host.lower().strip("[]"), "localhost", LOOPBACK, "::1"}
    # the network's names for this machine are not known; Origin must still equal Host
    return None


@contextmanager
def _checked_handshakes(host: str) -> Iterator[None]:
    """While a viser server starts, put our check in front of its own handling of requests."""
    import websockets.asyncio.server as library

    allowed, original = _allowed_names(host), library.serve

    def serve(handler: Any, *address: Any, process_request: Any = None, **options: Any) -> Any:
        checked = _checked(process_request, allowed)
        return original(handler, *address, process_request=checked, **options)

    with _starting:
        library.serve = serve  # type: ignore[misc, assignment]
        try:
            yield
        finally:
            library.serve = original  # type: ignore[misc]


def _checked(
    inner: Callable[..., Any] | None, allowed: Collection[str] | None
) -> Callable[..., Any]:
    def process_request(connection: Any, request: Any) -> Any:
        headers = request.headers
        origins, hosts = headers.get_all("Origin"), headers.get_all("Host")
        single = len(origins) <= 1 and len(hosts) <= 1
        if not single or not is_own_page(headers.get("Origin"), headers.get("Host"), allowed):
            return connection.respond(
                HTTPStatus.FORBIDDEN, "handtrack: this page does not belong to the workbench.\n"
            )
        return None if inner is None else inner(connection, request)

    return process_request
