"""Access control: who may connect to the workbench, and how much of what a client sends reaches viser.

viser has no log-in and ignores `Origin`. Here each request needs the token: in its address, as it is printed and opened, or
in the cookie that the page got for it. `Host` must be a name of this machine, so that another site's name made to point here
does not help; `Origin` must be the same place.

Whoever has the token may do what the user can, so messages are limited only against faults: in size, number and rate; to what
viser listens to, as it declares it, with finite numbers; to widgets and nodes that exist; and to the value of a widget, of its
type and within its limits. viser itself sets whatever attribute a client names and fails on numbers too large for its wire.
"""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import html
import io
import logging
import math
import os
import secrets
import threading
import time
import webbrowser
from collections.abc import Awaitable, Callable, Hashable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from http import HTTPStatus
from typing import Any
from urllib.parse import parse_qs, urlencode, urlsplit

import msgspec
import viser
import websockets.asyncio.server as library
from websockets.asyncio.server import Server, ServerConnection
from websockets.frames import DATA_OPCODES, Frame
from websockets.http11 import Request, Response
from websockets.protocol import CONNECTING, Event
from websockets.server import ServerProtocol

from handtrack.errors import HandtrackError
from handtrack.files.user_folder import user_data_folder
from handtrack_app import viser_internals as internals
from handtrack_app.access.address import LOOPBACK, own_names

log = logging.getLogger(__name__)

LARGEST_MESSAGE = 64 * 1024
"""[bytes]; a camera, the largest message of the page but a file, has 300"""
LARGEST_FILE = 512 * 1024
"""[bytes] of an upload: what viser's page sends in one part"""
_MOST_FILES = 4
"""whose beginning came and not yet the rest"""
_LARGEST_NUMBER = 1e9
"""far below what 64 bits hold"""
RATE, BURST = 200.0, 400.0
"""messages a second, and at once. viser's page sends at most 20 values, 20 drags, 50 clicks and 50 cameras a second"""
MOST_READ, MOST_READ_AT_ONCE = 1000.0, 4000.0
"""messages that are looked at; a client that sends more is disconnected"""
MOST_BYTES, MOST_BYTES_AT_ONCE = 1e6, 4e6
"""of all that comes, pings too; the page sends at most some 30 kB a second"""
MOST_WAITING = 256
"""different things that wait; the page has about as many widgets"""
MOST_CLIENTS = 16
"""pages and programs at a time; each costs a copy of what is on its way to it"""
_NEW_CLIENTS = (4.0, 12.0)
"""a second, and at once: each is sent the whole scene"""
MOST_CONNECTIONS = 64
"""with those whose handshake is not done yet"""
_HANDSHAKE_S = 5.0
_SLOW_S = 20.0
"""a client that has not taken one packet by then (a few MB at most) is given up; its page reconnects"""

_PAGE = "<!doctype html><title>handtrack</title><p>handtrack: {}</p>\n"
_HEADERS = {
    "Content-Security-Policy": "; ".join((
        "default-src 'none'",
        # the page is one file with its scripts in it; zstd in WebAssembly, functions made from strings
        "script-src 'self' 'unsafe-inline' blob: 'wasm-unsafe-eval' 'unsafe-eval'",
        "worker-src 'self' blob:",  # the connection lives in a worker
        "style-src 'self' 'unsafe-inline'",
        "img-src 'self' data: blob:",
        "font-src 'self' data:",
        "connect-src 'self' data: blob:",  # nothing leaves this machine; the environment's light is a data URL
        "base-uri 'none'", "form-action 'none'", "frame-ancestors 'none'",
    )),
    "X-Frame-Options": "DENY",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cache-Control": "no-store",
}  # fmt: skip
_starting = threading.Lock()
Passed = bytes | Callable[[], None]
"""a message for viser, or what is to be called instead"""
_Inner = Callable[[ServerConnection, Request], Response | None]


# ---- requests


class Rejected(Exception):
    """A request, with its status and a sentence; or a message, that no page of ours would send."""


@dataclass
class Allowance:
    """A number of things allowed a second, and at once after a pause."""

    rate: float
    burst: float
    clock: Callable[[], float] = time.monotonic
    left: float = field(init=False)
    _then: float = field(init=False)

    def __post_init__(self) -> None:
        self.left, self._then = self.burst, self.clock()

    def take(self, amount: float = 1.0) -> bool:
        """Return whether so much more is allowed now, and count it."""
        if self.wait(amount) > 0:
            return False
        self.left -= amount
        return True

    def wait(self, amount: float = 1.0) -> float:
        """Return the seconds until so much more is allowed."""
        now = self.clock()
        self.left = min(self.burst, self.left + (now - self._then) * self.rate)
        self._then = now
        return max(0.0, (amount - self.left) / self.rate)


@dataclass
class Handshake:
    """Checks each request before viser sees it."""

    names: frozenset[str]
    """names of this machine, in lower case"""
    token: str = field(repr=False)
    hide_address: Callable[[], object] = lambda: None
    """removes what leads to the address with the token; called when a page has come by it, and at the end"""
    _new: Allowance = field(default_factory=lambda: Allowance(*_NEW_CLIENTS))

    def wrap(self, inner: _Inner | None) -> _Inner:
        """Return viser's own handling of requests behind this one."""

        def answer(connection: ServerConnection, request: Request) -> Response | None:
            host = None
            try:
                host = self._checked_host(connection, request)
                asked = parse_qs(request.path.partition("?")[2])
                self._check_token(request, host, asked.pop("token", []))
                response = None
                if (_only(request, "Upgrade") or "").lower() == "websocket":
                    self._check_room(connection)
                elif "token=" in request.path:  # it is not to stay in the address
                    response = connection.respond(HTTPStatus.SEE_OTHER, "")
                    response.headers["Location"] = f"/?{urlencode(asked, doseq=True)}".rstrip("?")
                    self.hide_address()
                elif inner is not None:
                    response = inner(connection, request)
            except Rejected as refused:
                status, message = refused.args
                response = connection.respond(status, _PAGE.format(message))
                del response.headers["Content-Type"]
                response.headers["Content-Type"] = "text/html; charset=utf-8"
                host = None
            if response is not None:
                for name, value in _HEADERS.items():
                    response.headers[name] = value
                if host is not None:
                    cookie = f"{cookie_name(host)}={self.token}; Path=/; HttpOnly; SameSite=Lax"
                    response.headers["Set-Cookie"] = cookie
            return response

        return answer

    def _checked_host(self, connection: ServerConnection, request: Request) -> str:
        """Return `Host`, which must be a name of this machine; a page's `Origin` must be the same."""
        host, origin = _only(request, "Host"), _only(request, "Origin")
        reached = str(connection.local_address[0]).lower() if connection.local_address else ""
        name = _name(f"//{host}")
        if host is None or not name or (name not in self.names and name != reached):
            raise Rejected(
                HTTPStatus.FORBIDDEN,
                "The workbench does not know itself by this name. Use the address that it printed.",
            )
        if origin is not None and (
            _name(origin) != name or urlsplit(origin).netloc.lower() != host.lower()
        ):
            raise Rejected(HTTPStatus.FORBIDDEN, "This page does not belong to the workbench.")
        return host

    def _check_token(self, request: Request, host: str, asked: list[str]) -> None:
        cookies = (_only(request, "Cookie") or "").split(";")
        parts = [one.strip().partition("=") for one in cookies]
        kept = [value for name, _, value in parts if name == cookie_name(host)]
        if not any(hmac.compare_digest(one.encode(), self.token.encode()) for one in asked + kept):
            raise Rejected(
                HTTPStatus.FORBIDDEN,
                "Open the workbench by the whole address that it printed, with the token at its end. Each start has a "
                "new token.",
            )

    def _check_room(self, connection: ServerConnection) -> None:
        if len(connection.server.connections) >= MOST_CLIENTS:
            raise Rejected(
                HTTPStatus.SERVICE_UNAVAILABLE,
                f"{MOST_CLIENTS} pages show this workbench already; close one.",
            )
        if not self._new.take():
            raise Rejected(
                HTTPStatus.TOO_MANY_REQUESTS, "Too many pages open at once; try again in a second."
            )


def cookie_name(host: str) -> str:
    """Return the cookie's name by the port in `Host`: the ports of a host share their cookies."""
    return f"handtrack_{urlsplit(f'//{host}').port or 80}"


def _only(request: Request, name: str) -> str | None:
    """Return a header; None where it is missing. Raises Rejected where it stands twice."""
    values = request.headers.get_all(name)
    if len(values) > 1:
        raise Rejected(HTTPStatus.BAD_REQUEST, f"The request has {len(values)} headers {name}.")
    return values[0] if values else None


def _name(url: str) -> str:
    """Return the host of a URL in lower case; empty where there is none, or a port that is no number."""
    try:
        parts = urlsplit(url)
        _ = parts.port
        return (parts.hostname or "").lower()
    except ValueError:
        return ""


# ---- messages


@dataclass
class MessageFilter:
    """Which messages reach a viser server, and what its pages sent last."""

    server: viser.ViserServer | None = None
    """None while it starts"""
    refused: int = 0
    """messages"""
    own: dict[str, Callable[[int, object], None]] = field(default_factory=dict)
    """widgets that each page has for itself: what is called with a client's value, which no other page gets"""
    files: dict[str, Callable[[int, str, bytes | None], None]] = field(default_factory=dict)
    """upload buttons: what is called with a client, a file's name and its content, None where it is too large"""
    _values: dict[str, Any] = field(default_factory=dict)
    _begun: dict[tuple[int | None, str], Any] = field(default_factory=dict)
    """files of which the first message came"""

    def check(self, raw: bytes | str, client: int | None = None) -> tuple[Hashable, Passed]:
        """Return a message's kind, of which only the newest counts, and what passes. Raises Rejected."""
        if isinstance(raw, str) or self.server is None:
            raise Rejected("text")
        try:
            content = msgspec.msgpack.decode(raw)
            declared = internals.from_pages(self.server)[content["type"]]
            message: Any = msgspec.msgpack.decode(raw, type=declared)
        except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError, KeyError, TypeError) as error:  # fmt: skip
            raise Rejected(repr(error)) from None
        if not content.keys() <= {"type", *vars(message)}:
            raise Rejected("unknown fields")
        if len(raw) > LARGEST_MESSAGE + len(getattr(message, "content", b"")):
            raise Rejected("a message of this size")
        if isinstance(
            message, internals.messages.FileTransferStartUpload | internals.FileTransferPart
        ):
            return object(), self._file(message, client)
        if not all(map(_is_finite, vars(message).values())):
            raise Rejected("a number out of range")
        if not any(getattr(message, "wxyz", (1,))):
            raise Rejected("a pose without a direction")
        page = None if client is None else self.server.get_clients().get(client)
        owners = [self.server] if page is None else [self.server, page]
        match message:
            case internals.messages.GuiUpdateMessage(uuid=name):
                found = (internals.widgets(owner).get(name) for owner in owners)
                widget = next(filter(None, found), None)
                value = _checked_value(widget, message.updates)
                self._values[name] = value
                kind = object() if internals.is_button(widget) else name
                if name in self.own and client is not None:
                    return kind, partial(self.own[name], client, value)
                return kind, msgspec.msgpack.encode(content | {"updates": {"value": value}})
            case internals.messages.ViewerCameraMessage():
                if not any(message.up_direction) or not 0 < message.fov < math.pi or min(message.image_width, message.image_height) < 0:  # fmt: skip
                    raise Rejected("no camera")
                return "camera", raw
            case internals.messages.CommandTriggerMessage():
                if not internals.has_command(self.server, message.uuid):
                    raise Rejected("an unknown command")
            case internals.messages.ScenePointerMessage():
                rays = None not in (message.ray_origin, message.ray_direction)
                if not (rays if message.event_type == "click" else len(message.screen_pos) == 2):
                    raise Rejected("half a click")
            case internals.messages.LocalStorageGetItemResponseMessage():
                pass
            case _:
                name = getattr(message, "name", "")
                if not any(name in internals.nodes(owner) for owner in owners):
                    raise Rejected("an unknown node")
                if hasattr(message, "wxyz") or getattr(message, "phase", "") == "update":
                    return ("drag", name), raw
        return object(), raw  # unlike any other: each of these counts

    def _file(self, message: Any, client: int | None) -> Callable[[], None]:
        """Return what is done with one of the two messages of an upload, of which viser hears nothing. Raises Rejected."""
        hear, key = self.files.get(message.source_component_uuid), (client, message.transfer_uuid)
        if self.server is None or hear is None:
            raise Rejected("a file for what takes none")
        if isinstance(message, internals.FileTransferPart):
            begun = self._begun.pop(key, None)
            if begun is None or len(message.content) != begun.size_bytes:
                raise Rejected("a part of no file")
            if client is not None:
                internals.acknowledge(self.server, client, message)
            return partial(internals.submit, self.server.gui, hear, client, begun.filename, message.content)  # fmt: skip
        if message.size_bytes > LARGEST_FILE:
            return partial(internals.submit, self.server.gui, hear, client, message.filename, None)
        if message.size_bytes < 0 or message.part_count != min(message.size_bytes, 1):
            raise Rejected("a file of another size than its parts")
        self._begun = dict([*self._begun.items(), (key, message)][-_MOST_FILES:])
        return lambda: None

    def refuse(self, why: Rejected, client: int | None) -> None:
        """Count a message that does not pass; the log has the 1st, 2nd, 4th, 8th …"""
        self.refused += 1
        if self.refused & (self.refused - 1) == 0:
            log.warning(
                "%d messages refused; the last, of client %s: %.200s", self.refused, client, why
            )

    def sent_value(self, handle: Any) -> Any:
        """Return the value that a page last gave to a widget, a list where the widget has a tuple.

        The widget's own may be another by now: the program moves it, too.
        """
        return self._values.get(internals.id_of(handle), getattr(handle, "value", None))


def _checked_value(widget: Any, updates: dict[str, Any]) -> Any:
    """Return a page's value for a widget, of its type and within its limits. Raises Rejected."""
    if widget is None or updates.keys() != {"value"}:
        raise Rejected("an unknown widget, or more than its value")
    value, now, drawn = updates["value"], widget.value, internals.properties(widget)
    if getattr(drawn, "disabled", False):
        raise Rejected("a widget that is disabled")
    if isinstance(now, tuple):
        if not isinstance(value, list) or len(value) != len(now):
            raise Rejected("another number of values")
        return [_limited(one, other, drawn) for one, other in zip(value, now, strict=True)]
    return _limited(value, now, drawn)


def _limited(value: Any, now: object, drawn: object) -> Any:
    """Return one of the widget's options, or a number within its limits, whole where it was."""
    kind, expected = (float if type(one) is int else type(one) for one in (value, now))
    options = getattr(drawn, "options", None)
    if kind is not expected or (options is not None and value not in options):
        raise Rejected(f"{kind.__name__} for a widget that has {expected.__name__}")
    if kind is not float:
        return value
    if not math.isfinite(value):
        raise Rejected("a number out of range")
    low, high = getattr(drawn, "min", None), getattr(drawn, "max", None)
    low = -_LARGEST_NUMBER if low is None else low
    high = _LARGEST_NUMBER if high is None else high
    inside = min(max(value, low), high)
    return round(inside) if isinstance(now, int) else float(inside)


def _is_finite(value: object) -> bool:
    """Return whether no number of a message's field is infinite or too large."""
    if isinstance(value, tuple):
        return all(map(_is_finite, value))
    return not isinstance(value, int | float) or abs(value) <= _LARGEST_NUMBER


# ---- rates


class Flow:
    """The messages of one client on their way to viser: a steady rate; where more come, the newest of each kind waits."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._passing = Allowance(RATE, BURST, clock)
        self.messages = Allowance(MOST_READ, MOST_READ_AT_ONCE, clock)
        self.bytes = Allowance(MOST_BYTES, MOST_BYTES_AT_ONCE, clock)
        """what may come; a client that sends more is disconnected"""
        self._waiting: dict[Hashable, Passed] = {}

    def put(self, kind: Hashable, message: Passed) -> bool:
        """Let a message wait in the place of the older one of its kind; return whether there was room."""
        if kind not in self._waiting and len(self._waiting) >= MOST_WAITING:
            return False
        self._waiting[kind] = message
        return True

    def take(self) -> Passed | None:
        """Return the message that may pass now, None where none may."""
        if not self._waiting or not self._passing.take():
            return None
        return self._waiting.pop(next(iter(self._waiting)))

    def pause(self) -> float | None:
        """Return the seconds until one may pass; None where none waits."""
        return self._passing.wait() if self._waiting else None


class _Connection(ServerConnection):
    """One client's connection, from which viser reads what the filter lets pass."""

    def __init__(
        self, protocol: ServerProtocol, server: Server, *, messages: MessageFilter, **options: Any
    ) -> None:
        super().__init__(protocol, server, **options)
        self._messages, self._flow = messages, Flow()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Begin; where there are too many, the one ends that has waited longest for its handshake."""
        super().connection_made(transport)
        here = [one for one in self.server.handlers if not one.transport.is_closing()]
        if len(here) > MOST_CONNECTIONS:
            next(one for one in here if one.state is CONNECTING).transport.abort()

    def data_received(self, data: bytes) -> None:
        """Take what came, unless it is too much."""
        if self._flow.bytes.take(len(data)):
            super().data_received(data)
        else:
            self._disconnect("sent too many bytes")

    def process_event(self, event: Event) -> None:
        """Take a frame, unless there are too many; a fragment counts as a message: of empty ones, a message may have millions."""
        is_data = isinstance(event, Frame) and event.opcode in DATA_OPCODES
        if is_data and not self._flow.messages.take():
            self._disconnect("sent too many messages")
        else:
            super().process_event(event)

    def _disconnect(self, why: str) -> None:
        if not self.transport.is_closing():
            log.warning("%s %s and was disconnected", self.remote_address, why)
            self.transport.abort()

    async def recv(self, decode: bool | None = None) -> bytes:  # type: ignore[override]
        """Return the next message that may pass."""
        server = self._messages.server
        client = None if server is None else internals.client_of(server, self)
        while True:
            message = self._flow.take()
            if callable(message):
                message()
                continue
            if message is not None:
                return message
            try:
                async with asyncio.timeout(self._flow.pause()):
                    raw = await super().recv(decode)
            except TimeoutError:
                continue
            try:
                if not self._flow.put(*self._messages.check(raw, client)):
                    raise Rejected("too many messages wait")
            except Rejected as why:
                self._messages.refuse(why, client)

    async def send(self, message: bytes, text: bool | None = None) -> None:  # type: ignore[override]
        """Send, unless the client takes too long to read."""
        try:
            async with asyncio.timeout(_SLOW_S):
                await super().send(message, text)
        except TimeoutError:
            self._disconnect("does not read")
            await asyncio.shield(self.connection_lost_waiter)
            raise self.protocol.close_exc from None


# ---- the server


@dataclass(frozen=True)
class WebServer:
    """A started viser server behind access control, and its address."""

    server: viser.ViserServer
    host: str
    messages: MessageFilter
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


def start_web_server(host: str = LOOPBACK, port: int = 0, token: str | None = None) -> WebServer:
    """Start a viser server behind access control; it opens no tunnels.

    Parameters
    ----------
    token
        of an earlier page, which then reconnects; a new one by default

    Raises
    ------
    HandtrackError
        when the port was taken since it was chosen
    """
    messages = MessageFilter()
    handshake = Handshake(own_names(host), token or secrets.token_urlsafe(24))
    # viser prints an address without the token
    with _guarding(handshake, messages), contextlib.redirect_stdout(io.StringIO()):
        server = viser.ViserServer(host=host, port=port, label="handtrack", verbose=False)
    messages.server = server
    # no public tunnel, whoever asks: with internet access, viser would open one
    server.request_share_url = lambda verbose=True: None  # type: ignore[method-assign]
    server.gui.configure_theme(show_share_button=False)
    if port and server.get_port() != port:  # viser silently takes the next one
        server.stop()
        raise HandtrackError(
            f"port {port} of {host} was taken while the workbench started; try again, or name another "
            "with --port."
        )
    return WebServer(server, host, messages, handshake)


@contextlib.contextmanager
def _guarding(handshake: Handshake, messages: MessageFilter) -> Iterator[None]:
    """While a viser server starts, put access control in front of its own handling."""
    original = library.serve

    def serve(handler: _Handler, *address: object, **options: Any) -> library.serve:
        ours = {
            "process_request": handshake.wrap(options.get("process_request")),
            "create_connection": partial(_Connection, messages=messages),
            "max_size": LARGEST_MESSAGE + LARGEST_FILE,
            "open_timeout": _HANDSHAKE_S,
        }
        return original(_of_our_version(handler), *address, **(options | ours))  # type: ignore[arg-type]

    with _starting:
        library.serve = serve  # type: ignore[misc, assignment]
        try:
            yield
        finally:
            library.serve = original  # type: ignore[misc]


_Handler = Callable[[ServerConnection], Awaitable[None]]


def _of_our_version(handler: _Handler) -> _Handler:
    """Return viser's handler for clients of its own version; about others it would print."""

    async def handle(connection: ServerConnection) -> None:
        wanted = f"viser-v{viser.__version__}"
        if connection.subprotocol != wanted:
            await connection.close(1002, f"Version mismatch: this server speaks {wanted}.")
            return
        await handler(connection)

    return handle


def show_in_browser(web: WebServer) -> None:
    """Open the page in the user's browser, without its token on a command line, which every user of a machine can read.

    The browser opens a file that only the user can read and that leads to the page; it is removed when the page has come.
    """
    path = user_data_folder() / f"open-{web.port}.html"
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    path.unlink(missing_ok=True)
    address = html.escape(web.url)
    with open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
        file.write(
            f'<!doctype html><title>handtrack</title><meta http-equiv="refresh" content="0; url={address}">'
            f'<p><a href="{address}">handtrack</a>\n'
        )

    def remove() -> None:
        with suppress(OSError):
            path.unlink(missing_ok=True)

    web.handshake.hide_address = remove
    webbrowser.open(path.resolve().as_uri())
