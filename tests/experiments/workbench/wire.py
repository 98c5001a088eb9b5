"""A bare client on the wire, as viser's page speaks: for latency, and for input that no page would send."""

from __future__ import annotations

import threading
import time
from importlib.metadata import version
from types import TracebackType
from typing import Any

import msgspec
import numpy as np
import zstandard
from websockets.sync.client import connect
from websockets.typing import Subprotocol

_MOST_KEPT = 20_000
"""messages; more than the whole scene"""


class WireClient:
    """Connects, collects every message with the time it came, and sends GUI updates."""

    def __init__(self, url: str, draws: bool = True) -> None:
        """url: of the page, with its token. draws: it answers, as a page does, that it has drawn a frame that is played."""
        self._draws = draws
        self._socket = connect(
            url.replace("http", "ws", 1),
            subprotocols=[Subprotocol(f"viser-v{version('viser')}")],
            max_size=None,
        )
        self.messages: list[tuple[float, dict[str, Any]]] = []
        self.bytes_taken = 0
        self._came = threading.Condition()
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()
        self.send({  # only a client that told its camera counts
            "type": "ViewerCameraMessage", "wxyz": [1.0, 0.0, 0.0, 0.0], "position": [0.0, 0.0, -1.0], "fov": 0.7,
            "near": 0.01, "far": 100.0, "image_height": 600, "image_width": 800, "look_at": [0.0, 0.0, 0.0],
            "up_direction": [0.0, -1.0, 0.0],
        })  # fmt: skip

    def __enter__(self) -> WireClient:
        return self

    def __exit__(
        self, kind: type | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._socket.close()
        self._thread.join(5.0)

    def _read(self) -> None:
        unpack = zstandard.ZstdDecompressor()
        try:
            for raw in self._socket:
                now = time.perf_counter()
                assert isinstance(raw, bytes)
                size, packed = (
                    int.from_bytes(raw[:8], "little"),
                    int.from_bytes(raw[8:16], "little"),
                )
                inner = unpack.decompress(raw[16 : 16 + packed], max_output_size=size)
                told = msgspec.msgpack.decode(inner)
                _fill(told, raw, 16 + packed)
                with self._came:
                    del self.messages[:-_MOST_KEPT]
                    self.messages += [(now, message) for message in told["messages"]]
                    self.bytes_taken += len(raw)
                    self._came.notify_all()
                for message in told["messages"] if self._draws else ():
                    if message.get("key") == "handtrack.drawn":
                        self.answer(message, None)
        except Exception:  # the server went away: the test that minds will see no message
            return

    def send(self, message: dict[str, Any]) -> float:
        """Send one message; return since when an answer may come."""
        now = time.perf_counter()
        self._socket.send(msgspec.msgpack.encode(message))
        return now

    def answer(self, question: dict[str, Any], value: str | None) -> None:
        """Answer what the program asks of what the browser keeps."""
        self.send({
            "type": "LocalStorageGetItemResponseMessage", "value": value, "error": None,
            "request_uuid": question["request_uuid"],
        })  # fmt: skip

    def send_packed(self, frames: bytes) -> None:
        """Send frames of the websocket's protocol, packed already."""
        self._socket.socket.sendall(frames)

    @property
    def close_code(self) -> int | None:
        """Why the server closed the connection; 1006 if without a word, None while it is open."""
        return self._socket.protocol.close_code

    def set_value(self, handle: Any, value: Any) -> float:
        """Send a GUI value as the page would; return when. handle: viser's, or its name on the wire."""
        uuid = handle if isinstance(handle, str) else handle._impl.uuid
        return self.send({"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": value}})

    def widgets(self) -> list[dict[str, Any]]:
        """Return the messages that made the widgets a user can set, in their order."""
        with self._came:
            return [
                message
                for _, message in self.messages
                if message["type"].startswith("Gui")
                and {"uuid", "value", "props"} <= message.keys()
            ]

    def trigger(self, words: str, timeout: float = 600.0) -> None:
        """Give a command of the palette once the page has it. Raises TimeoutError where it does not come within so many seconds."""

        def command() -> str | None:
            known = (m for _, m in self.messages if m["type"] == "RegisterCommandMessage")
            return next((m["uuid"] for m in known if m["props"]["label"] == words), None)

        with self._came:
            uuid = self._came.wait_for(command, timeout)
        if uuid is None:
            raise TimeoutError(f"no command {words!r} on the page within {timeout:g} s")
        self.send({"type": "CommandTriggerMessage", "uuid": uuid})

    def latest(self, name: str, prop: str) -> tuple[float, Any] | None:
        """Return the value that a scene node's property was told last, and when; None where it was not."""
        with self._came:
            for came, message in reversed(self.messages):
                told = message.get("updates") or message.get("props") or {}
                if message.get("name") == name and prop in told:
                    return came, told[prop]
        return None

    def button(self, label: str) -> str | None:
        """Return a button's name on the wire; None where the page has none, or no more."""
        there = None
        with self._came:
            for _, message in self.messages:
                if message.get("props", {}).get("label") == label:
                    there = message["uuid"]
                elif message["type"] == "GuiRemoveMessage" and message["uuid"] == there:
                    there = None
        return there

    def press(self, label: str, timeout: float = 600.0) -> None:
        """Press a button once the page has it. Raises TimeoutError where it does not come within so many seconds."""
        with self._came:
            if not self._came.wait_for(lambda: self.button(label) is not None, timeout):
                raise TimeoutError(f"no button {label!r} on the page within {timeout:g} s")
            self.set_value(self.button(label), True)

    def wait_for(self, after: float, name: str, prop: str, timeout: float = 600.0) -> float | None:
        """Return when the first update of a scene node's property came after a time; None if none did."""

        def found() -> float | None:
            for came, message in reversed(self.messages):
                if came < after:
                    return None
                if message.get("name") == name and prop in message.get("updates", {}):
                    return came
            return None

        with self._came:
            self._came.wait_for(lambda: found() is not None, timeout)
            return found()


def _fill(told: dict[str, Any], raw: bytes, start: int) -> None:
    """Put arrays, which lie behind the messages at multiples of 8 bytes, in their places."""
    at, buffers = start, list[bytes]()
    for size in told["binaryBufferLengths"]:
        at += -at % 8
        buffers.append(raw[at : at + size])
        at += size
    for message in told["messages"]:
        for values in (message.get("updates"), message.get("props")):
            for name, value in values.items() if isinstance(values, dict) else ():
                if isinstance(value, dict) and "__binary_index" in value:
                    values[name] = np.frombuffer(buffers[value["__binary_index"]], value["dtype"])
