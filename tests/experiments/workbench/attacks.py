"""What a hostile client that knows the token could send to the workbench: `python -m tests.experiments.workbench.attacks NAME < page.json`."""

from __future__ import annotations

import contextlib
import json
import math
import socket
import struct
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from importlib.metadata import version
from urllib.parse import urlsplit

import msgspec

_VALUES = 3000
_UPLOAD_BYTES = 200_000_000
_A_SECOND = 10_000
_FLOOD_S = 8.0
_SLOW_READERS, _SLOW_S = 8, 8.0
_RECONNECTS = 500
_PIECES = 4_000_000


@dataclass(frozen=True)
class TargetPage:
    """What an attacker knows: the address with its token, and the widgets' names on the wire."""

    url: str
    uuids: list[str]


# ---- the wire


def websocket(url: str) -> socket.socket:
    """Return a socket whose websocket handshake was asked for; whether it was granted is not looked at."""
    address = urlsplit(url)
    wire = socket.create_connection((address.hostname or "", address.port or 80), timeout=5.0)
    wire.sendall(
        f"GET /?{address.query} HTTP/1.1\r\nHost: {address.netloc}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n"
        f"Sec-WebSocket-Protocol: viser-v{version('viser')}\r\n\r\n".encode()
    )
    return wire


def frame(message: object, kind: int = 2) -> bytes:
    """Return a websocket's frame with a message. kind: 1 text, 2 binary, 9 ping; bytes are sent as they are."""
    data = message if isinstance(message, bytes) else msgspec.msgpack.encode(message)
    if len(data) < 126:
        size = bytes([0x80 | len(data)])
    elif len(data) < 2**16:
        size = b"\xfe" + struct.pack(">H", len(data))
    else:
        size = b"\xff" + struct.pack(">Q", len(data))
    return bytes([0x80 | kind]) + size + bytes(4) + data  # the mask is zero


def set_to(uuid: str, **updates: object) -> bytes:
    return frame({"type": "GuiUpdateMessage", "uuid": uuid, "updates": updates})


def pour(url: str, frames: Iterable[bytes]) -> int:
    """Send frames, by a new connection wherever the old one was closed; return how many were sent."""
    sent, frames = 0, iter(frames)
    while True:
        with contextlib.suppress(OSError), websocket(url) as wire:
            for one in frames:
                wire.sendall(one)
                sent += 1
            return sent
        time.sleep(0.2)


# ---- the attacks


def values(page: TargetPage) -> int:
    """Odd values for each widget."""
    odd = [
        math.nan, math.inf, -math.inf, 1e308, 2**63, "", "x" * 5000, None, [], [math.nan, 1], [1] * 5000, {}, {"a": 1},
        b"\x00" * 5000, True, -1, "Undo\x00", [[[]]],
    ]  # fmt: skip
    pairs = ((uuid, value) for value in odd for uuid in page.uuids)
    frames = [set_to(uuid, value=value) for uuid, value in pairs]
    return pour(page.url, (frames[k % len(frames)] for k in range(_VALUES)))


def attributes(page: TargetPage) -> int:
    """Everything else that a widget has in viser."""
    wishes = (
        {"update_cb": []},
        {"removed": True},
        {"props": {}},
        {"sync_cb": None},
        {"value": 1, "update_cb": []},
    )
    return pour(page.url, (set_to(uuid, **wish) for wish in wishes for uuid in page.uuids))


def upload(page: TargetPage) -> int:
    """200 MB for a widget that takes no files."""
    uuid, part = page.uuids[0], bytes(60_000)
    start = {
        "type": "FileTransferStartUpload", "source_component_uuid": uuid, "transfer_uuid": "1", "filename": "x",
        "mime_type": "x", "size_bytes": 10**12, "part_count": 10**6,
    }  # fmt: skip
    parts = (
        frame({
            "type": "FileTransferPart", "source_component_uuid": uuid, "transfer_uuid": "1", "part_index": k, "content": part,
        })
        for k in range(_UPLOAD_BYTES // len(part))
    )  # fmt: skip
    return pour(page.url, [frame(start)]) + pour(page.url, parts)


def flood(page: TargetPage) -> int:
    """10,000 good messages a second."""

    def frames() -> Iterator[bytes]:
        began, batch, last = time.monotonic(), _A_SECOND // 20, 0.0
        while (now := time.monotonic()) < began + _FLOOD_S:
            time.sleep(max(0.0, last + 0.05 - now))
            last = time.monotonic()
            yield b"".join(
                set_to(page.uuids[k % len(page.uuids)], value=k % 7) for k in range(batch)
            )

    return _A_SECOND // 20 * pour(page.url, frames())


def slow_readers(page: TargetPage) -> int:
    """Clients that take the scene and read nothing."""
    with contextlib.ExitStack() as wires:
        for _ in range(_SLOW_READERS):
            wires.enter_context(websocket(page.url)).setsockopt(
                socket.SOL_SOCKET, socket.SO_RCVBUF, 4096
            )
        time.sleep(_SLOW_S)
    return _SLOW_READERS


def reconnects(page: TargetPage) -> int:
    """Clients that come and go."""
    for _ in range(_RECONNECTS):
        with contextlib.suppress(OSError), websocket(page.url) as wire:
            wire.recv(1)
    return _RECONNECTS


def malformed(page: TargetPage) -> int:
    """Half a handshake, and frames that are no messages."""
    address = urlsplit(page.url)
    idle = [
        socket.create_connection((address.hostname or "", address.port or 80)) for _ in range(100)
    ]
    huge = b"\x82\xff" + struct.pack(">Q", 49_000_000) + bytes(4)
    odd = [b"", b"\xc1", b"\x91" * 60_000, b"\xdd\xff\xff\xff\xff", msgspec.msgpack.encode({})]
    sent = pour(page.url, [frame(one) for one in odd] + [frame(b"text", 1)])
    sent += pour(page.url, [frame(bytes(125), 9)] * 60_000)
    for one in (huge + bytes(10**6), b"\x82\x01a", b"\xff" * 100):
        with contextlib.suppress(OSError), websocket(page.url) as wire:
            wire.sendall(one)
            wire.recv(1)
    for wire in idle:
        wire.close()
    return sent + 3


def pieces(page: TargetPage) -> int:
    """A message in millions of empty pieces."""
    begin, piece, at_once = b"\x02\x80" + bytes(4), b"\x00\x80" + bytes(4), 50_000
    return at_once * pour(page.url, [begin] + [piece * at_once] * (_PIECES // at_once))


ATTACKS: dict[str, Callable[[TargetPage], int]] = {
    one.__name__: one
    for one in (values, attributes, upload, flood, slow_readers, reconnects, malformed, pieces)
}


if __name__ == "__main__":
    target = TargetPage(**json.load(sys.stdin))
    print(ATTACKS[sys.argv[1]](target))
