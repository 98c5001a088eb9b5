"""The workbench's door: a viser server behind the handshake and the gate."""

from __future__ import annotations

import contextlib
import io
import threading
from collections.abc import Awaitable, Callable, Iterator
from dataclasses import dataclass
from typing import Any

import viser
import websockets.asyncio.server as library

from handtrack.errors import HandtrackError
from handtrack_app.door.address import LOOPBACK, own_names
from handtrack_app.door.connection import HANDSHAKE_S, connections_behind
from handtrack_app.door.gate import LARGEST_MESSAGE, Gate
from handtrack_app.door.handshake import Handshake, new_token

_starting = threading.Lock()
_Handler = Callable[[library.ServerConnection], Awaitable[None]]


@dataclass(frozen=True)
class Door:
    """A started server and the way to it."""

    server: viser.ViserServer
    host: str
    gate: Gate
    handshake: Handshake

    @property
    def token(self) -> str:
        return self.handshake.token

    @property
    def port(self) -> int:
        return self.server.get_port()

    @property
    def url(self) -> str:
        """The address of the page on this machine, with the token."""
        return self.url_by(LOOPBACK if self.host in ("0.0.0.0", "::") else self.host)

    def close(self) -> None:
        """End the server."""
        self.server.stop()
        self.handshake.hide_address()

    def url_by(self, name: str) -> str:
        """Return the address with another of this machine's names."""
        name = f"[{name}]" if ":" in name else name
        return f"http://{name}:{self.server.get_port()}/?token={self.token}"


def open_door(
    host: str = LOOPBACK, port: int = 0, label: str = "handtrack", token: str | None = None
) -> Door:
    """Return a started viser server behind its door; it opens no tunnels. token: of a page before, which then comes again.

    Raises HandtrackError when the port was taken since it was chosen.
    """
    gate, handshake = Gate(), Handshake(own_names(host), token or new_token())
    with (
        _behind(handshake, gate),
        contextlib.redirect_stdout(io.StringIO()),
    ):  # an address without the token
        server = viser.ViserServer(host=host, port=port, label=label, verbose=False)
    gate.server = server
    server.request_share_url = lambda verbose=True: None  # type: ignore[method-assign]
    server.gui.configure_theme(show_share_button=False)
    if port and server.get_port() != port:  # viser takes the next one without a word
        server.stop()
        raise HandtrackError(
            f"port {port} of {host} was taken while the workbench started; try again, or name another "
            "with --port."
        )
    return Door(server, host, gate, handshake)


@contextlib.contextmanager
def _behind(handshake: Handshake, gate: Gate) -> Iterator[None]:
    """While a viser server starts, put handshake and gate in front of its own handling."""
    original = library.serve

    def serve(handler: _Handler, *address: object, **options: Any) -> library.serve:
        ours = {
            "process_request": handshake.wrap(options.get("process_request")),
            "create_connection": connections_behind(gate),
            "max_size": LARGEST_MESSAGE,
            "open_timeout": HANDSHAKE_S,
        }
        return original(_of_our_version(handler), *address, **(options | ours))  # type: ignore[arg-type]

    with _starting:
        library.serve = serve  # type: ignore[misc, assignment]
        try:
            yield
        finally:
            library.serve = original  # type: ignore[misc]


def _of_our_version(handler: _Handler) -> _Handler:
    """Return viser's handler for clients of its own version; of others it would tell the terminal."""

    async def handle(connection: library.ServerConnection) -> None:
        wanted = f"viser-v{viser.__version__}"
        if connection.subprotocol != wanted:
            await connection.close(1002, f"Version mismatch: this server speaks {wanted}.")
            return
        await handler(connection)

    return handle
