"""The handshake: who knows the token, and calls the workbench by a name of its own, is let in.

viser has no log-in and looks at no `Origin`. Here each request needs the token: in its address, as it is printed and
opened, or in the cookie that the page got for it. `Host` must be a name of this machine, so that no other site's name
that was made to point here helps; a page's `Origin` must be the same place.
"""

from __future__ import annotations

import hmac
import secrets
from collections.abc import Callable
from dataclasses import dataclass, field
from http import HTTPStatus
from urllib.parse import parse_qs, urlencode, urlsplit

from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from handtrack_app.door.flow import Allowance
from handtrack_app.door.headers import page_headers

MOST_CLIENTS = 16
"""pages and programs at a time; each costs a copy of what is on its way to it"""
_NEW_CLIENTS = (4.0, 12.0)
"""a second, and at once: each is sent the whole scene"""

Inner = Callable[[ServerConnection, Request], Response | None]


class Refused(Exception):
    """A request that is answered with a sentence."""

    def __init__(self, status: HTTPStatus, words: str) -> None:
        super().__init__(words)
        self.status, self.words = status, words


def new_token() -> str:
    """Return a word that nobody guesses."""
    return secrets.token_urlsafe(24)


@dataclass
class Handshake:
    """Looks at each request before viser does."""

    names: frozenset[str]
    """names of this machine, in lower case"""
    token: str = field(default_factory=new_token, repr=False)
    hide_address: Callable[[], object] = lambda: None
    """takes away what leads to the address with the token; called when a page has come by it, and at the end"""
    _new: Allowance = field(default_factory=lambda: Allowance(*_NEW_CLIENTS))
    _headers: dict[str, str] = field(default_factory=page_headers)

    def wrap(self, inner: Inner | None) -> Inner:
        """Return viser's own handling of requests behind this one."""

        def answer(connection: ServerConnection, request: Request) -> Response | None:
            try:
                host = self._checked_host(connection, request)
                asked = parse_qs(request.path.partition("?")[2])
                self._check_token(request, host, asked.pop("token", []))
                response = None
                if (_only(request, "Upgrade") or "").lower() == "websocket":
                    self._check_room(connection)
                elif "token=" in request.path:  # is not to stay in the address
                    response = connection.respond(HTTPStatus.SEE_OTHER, "")
                    response.headers["Location"] = f"/?{urlencode(asked, doseq=True)}".rstrip("?")
                    self.hide_address()
                elif inner is not None:
                    response = inner(connection, request)
            except Refused as refused:
                response = connection.respond(refused.status, _PAGE.format(refused.words))
                del response.headers["Content-Type"]
                response.headers["Content-Type"] = "text/html; charset=utf-8"
                host = None
            if response is None:
                return None
            for name, value in self._headers.items():
                response.headers[name] = value
            if host is not None:
                response.headers["Set-Cookie"] = (
                    f"{cookie_name(host)}={self.token}; Path=/; HttpOnly; SameSite=Lax"
                )
            return response

        return answer

    def _checked_host(self, connection: ServerConnection, request: Request) -> str:
        """Return `Host`, which is a name of this machine, and where the page comes from that asks."""
        host, origin = _only(request, "Host"), _only(request, "Origin")
        reached = str(connection.local_address[0]).lower() if connection.local_address else ""
        name = _name(f"//{host}")
        if host is None or not name or (name not in self.names and name != reached):
            raise Refused(
                HTTPStatus.FORBIDDEN,
                "The workbench does not know itself by this name. Use the address that it printed.",
            )
        if origin is not None and (
            _name(origin) != name or urlsplit(origin).netloc.lower() != host.lower()
        ):
            raise Refused(HTTPStatus.FORBIDDEN, "This page does not belong to the workbench.")
        return host

    def _check_token(self, request: Request, host: str, asked: list[str]) -> None:
        kept = [
            value
            for name, _, value in (
                one.strip().partition("=") for one in (_only(request, "Cookie") or "").split(";")
            )
            if name == cookie_name(host)
        ]
        if not any(hmac.compare_digest(one.encode(), self.token.encode()) for one in asked + kept):
            raise Refused(
                HTTPStatus.FORBIDDEN,
                "Open the workbench by the whole address that it printed, with the token at its end: after a new start "
                "the token is a new one.",
            )

    def _check_room(self, connection: ServerConnection) -> None:
        if len(connection.server.connections) >= MOST_CLIENTS:
            raise Refused(
                HTTPStatus.SERVICE_UNAVAILABLE,
                f"{MOST_CLIENTS} pages show this workbench already; close one.",
            )
        if not self._new.take():
            raise Refused(
                HTTPStatus.TOO_MANY_REQUESTS, "Too many pages come at once; try again in a second."
            )


_PAGE = "<!doctype html><title>handtrack</title><p>handtrack: {}</p>\n"


def cookie_name(host: str) -> str:
    """Return the cookie's name by the port in `Host`: the ports of a host share their cookies."""
    return f"handtrack_{urlsplit(f'//{host}').port or 80}"


def _only(request: Request, name: str) -> str | None:
    """Return a header; None where it is missing. Raises Refused where it stands twice."""
    found = request.headers.get_all(name)
    if len(found) > 1:
        raise Refused(HTTPStatus.BAD_REQUEST, f"The request has {len(found)} headers {name}.")
    return found[0] if found else None


def _name(url: str) -> str:
    """Return the host of a URL in lower case; nothing where there is none, or a port that is no number."""
    try:
        parts = urlsplit(url)
        _ = parts.port
        return (parts.hostname or "").lower()
    except ValueError:
        return ""
