"""The connection that viser reads from and writes to, with the gate in between."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from functools import partial
from typing import Any

from websockets.asyncio.server import Server, ServerConnection
from websockets.frames import Frame, Opcode
from websockets.protocol import CONNECTING, Event
from websockets.server import ServerProtocol

from handtrack_app.door.flow import Flow
from handtrack_app.door.gate import Gate, NotForUs

log = logging.getLogger(__name__)
HANDSHAKE_S = 5.0
"""a page needs milliseconds; what takes longer is none"""
MOST_CONNECTIONS = 64
"""with those whose handshake is not done yet"""
_SLOW_S = 20.0
"""a client that has not taken one packet by then (a few MB at most) is given up; its page comes again by itself"""
_FAREWELL_S = 1.0


def connections_behind(gate: Gate) -> Callable[..., ServerConnection]:
    """Return what makes a server's connections, each with its own flow and the one gate."""
    return partial(_GatedConnection, gate=gate)


class _GatedConnection(ServerConnection):
    """One client's connection."""

    def __init__(
        self, protocol: ServerProtocol, server: Server, *, gate: Gate, **options: Any
    ) -> None:
        super().__init__(protocol, server, **options)
        self._gate, self._flow = gate, Flow()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Begin; where there are too many, the one goes that has waited longest for its handshake."""
        super().connection_made(transport)
        here = [one for one in self.server.handlers if not one.transport.is_closing()]
        if len(here) > MOST_CONNECTIONS:
            next(one for one in here if one.state is CONNECTING).transport.abort()

    def data_received(self, data: bytes) -> None:
        """Take what came, unless it is too much."""
        if self._flow.came(len(data)):
            super().data_received(data)
        elif not self.transport.is_closing():
            log.warning("%s sent too many bytes and was sent away", self.remote_address)
            self.transport.abort()

    def process_event(self, event: Event) -> None:
        """Take a frame; one that continues a message counts as one: of empty ones, a message may have millions."""
        if isinstance(event, Frame) and event.opcode is Opcode.CONT and not self._flow.heard():
            log.warning("%s sent too many pieces and was sent away", self.remote_address)
            self.transport.abort()
            return
        super().process_event(event)

    async def recv(self, decode: bool | None = None) -> bytes:  # type: ignore[override]
        """Return the next message that may pass."""
        client = self._gate.client_of(self)
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
            if not self._flow.heard():
                await self._send_away()
                continue  # viser hears that the connection is closed
            try:
                if not self._flow.put(*self._gate.examine(raw, client)):
                    raise NotForUs("more than waits")
            except NotForUs as why:
                self._gate.refuse(why, client)

    async def _send_away(self) -> None:
        log.warning("%s sent too much and was sent away", self.remote_address)
        try:
            async with asyncio.timeout(_FAREWELL_S):
                await self.close(1008, "too many messages")
        except TimeoutError:
            self.transport.abort()

    async def send(self, message: bytes, text: bool | None = None) -> None:  # type: ignore[override]
        """Send, unless the client takes too long to read."""
        try:
            async with asyncio.timeout(_SLOW_S):
                await super().send(message, text)
        except TimeoutError:
            log.warning("%s does not read and was given up", self.remote_address)
            self.transport.abort()
            await asyncio.shield(self.connection_lost_waiter)
            raise self.protocol.close_exc from None
