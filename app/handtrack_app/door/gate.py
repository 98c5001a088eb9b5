"""The gate: looks at each message of a client before viser does, and lets through what a page may send.

viser itself sets whatever attribute of a widget a client names, keeps whatever file it begins to send, and dies of a
number too large for its wire. So a message must be one of the vocabulary, name a widget or node that is there, and bring a
value of that widget's kind; it is packed anew from what was understood.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Container, Hashable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import msgspec
import viser

from handtrack_app.door import vocabulary as words
from handtrack_app.door.flow import Message

log = logging.getLogger(__name__)
LARGEST_MESSAGE = 64 * 1024
"""bytes; a camera, the largest that the page sends, has 300"""
_LARGEST_NUMBER = 1e9
"""where a widget says no limits; far below what 64 bits hold"""
_MOST_KEPT = 2000
"""widgets whose last value is kept; the page has about 200"""

_OF_THE_PAGE = ("camera", "kept")
"""kinds of messages that tell of a page itself: where it looks from, what its browser keeps"""

Value = words.Value
_Widgets = Mapping[str, Any]


class NotForUs(Exception):
    """A message that no page of ours would send."""


class LooksOn(NotForUs):
    """What a page does that looks on while another one edits: the widget or node of this name."""


@dataclass
class Gate:
    """What may pass to a viser server, and what its page said last."""

    server: viser.ViserServer | None = None
    """none yet while it starts"""
    refused: int = 0
    """messages"""
    may_edit: Callable[[int], bool] = lambda _: True
    """whether a client may do more than look around"""
    looked_on: Callable[[int, str], None] = lambda _client, _name: None
    """is called where it did more"""
    own: dict[str, Callable[[int, object], None]] = field(default_factory=dict)
    """widgets that each page has for itself: what is called with a client's value, which no other page gets"""
    everyones: set[str] = field(default_factory=set)
    """commands that a page may give that looks on"""
    _said: dict[str, Value] = field(default_factory=dict)

    def client_of(self, connection: object) -> int | None:
        """Return viser's number of a client by its connection; None before viser has it."""
        live = {} if self.server is None else self.server._websock_server._live_connections
        return next((number for number, one in live.items() if one is connection), None)

    def examine(self, raw: bytes | str, client: int | None = None) -> tuple[Hashable, Message]:
        """Return of what kind a message is, and what viser is handed; of one kind only the newest counts.

        For a widget that each page has for itself: what is to be called instead. Raises NotForUs.
        """
        if isinstance(raw, str):
            raise NotForUs("text")
        try:
            message = words.DECODER.decode(raw)
        except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
            raise NotForUs(str(error)) from None
        private = self._private_widgets(client)
        kind, message = self._checked(message, private, self._nodes(client))
        name = getattr(message, "uuid", None) or getattr(message, "name", "")
        if isinstance(message, words.GuiUpdateMessage) and name in self.own and client is not None:
            return kind, partial(self.own[name], client, message.updates.value)
        looking = kind in _OF_THE_PAGE or name in private or name in self.everyones
        if isinstance(message, words.ScenePointerMessage):
            looking = looking or (message.modifier or "").startswith("cmd/ctrl")  # turns its view
        if not (looking or client is None or self.may_edit(client)):
            raise LooksOn(name)
        if isinstance(message, words.GuiUpdateMessage):
            self._keep(message)
        return kind, msgspec.msgpack.encode(message)

    def refuse(self, why: NotForUs, client: int | None) -> None:
        """Count a message that does not pass; the log tells the 1st, 2nd, 4th, 8th …"""
        if isinstance(why, LooksOn) and client is not None:
            self.looked_on(client, str(why))
            return
        self.refused += 1
        if self.refused & (self.refused - 1) == 0:
            log.warning(
                "%d messages refused; the last, of client %s: %.200s", self.refused, client, why
            )

    def said(self, handle: Any) -> Any:
        """Return the value that a page last gave to a widget, a list where the widget has a tuple.

        The widget's own may be another by now: the program moves it, too.
        """
        return self._said.get(handle._impl.uuid, handle.value)

    def _keep(self, message: words.GuiUpdateMessage) -> None:
        if len(self._said) >= _MOST_KEPT and self.server is not None:
            known = self.server.gui._gui_input_handle_from_uuid
            self._said = {uuid: kept for uuid, kept in self._said.items() if uuid in known}
        self._said[message.uuid] = message.updates.value

    def _private_widgets(self, client: int | None) -> _Widgets:
        """Return the widgets that one client alone has."""
        if self.server is None or client is None:
            return {}
        handle = self.server.get_clients().get(client)
        return {} if handle is None else handle.gui._gui_input_handle_from_uuid

    def _nodes(self, client: int | None) -> Container[str]:
        """Return the names of the scene's nodes, and of those that one client alone has."""
        if self.server is None:
            return ()
        handle = None if client is None else self.server.get_clients().get(client)
        own = {} if handle is None else handle.scene._handle_from_node_name
        return {*self.server.scene._handle_from_node_name, *own}

    def _checked(
        self, message: words.Message, private: _Widgets, nodes: Container[str]
    ) -> tuple[Hashable, words.Message]:
        once = object()  # like no other: each of these counts
        match message:
            case words.GuiUpdateMessage():
                return self._update(message, private)
            case words.ViewerCameraMessage():
                for vector in (message.wxyz, message.up_direction):
                    if not any(vector):
                        raise NotForUs("a camera without a direction")
                return "camera", message
            case words.LocalStorageGetItemResponseMessage():
                return "kept", message
            case words.CommandTriggerMessage():
                if (
                    self.server is None
                    or message.uuid not in self.server.gui._command_handle_from_uuid
                ):
                    raise NotForUs("an unknown command")
                return once, message
            case words.ScenePointerMessage():
                rays = message.ray_origin is not None and message.ray_direction is not None
                if len(message.screen_pos) != 2 and not (rays and message.event_type == "click"):
                    raise NotForUs("half a click")
                if message.event_type == "click" and not rays:
                    raise NotForUs("a click from nowhere")
                return once, message
        if message.name not in nodes:
            raise NotForUs("an unknown node")
        match message:
            case words.TransformControlsUpdateMessage():
                if not any(message.wxyz):
                    raise NotForUs("a pose without a direction")
                return ("control", message.name), message
            case words.SceneNodeDragMessage(phase="update"):
                return ("drag", message.name), message
        return once, message

    def _update(
        self, message: words.GuiUpdateMessage, private: _Widgets
    ) -> tuple[Hashable, words.Message]:
        known = {} if self.server is None else self.server.gui._gui_input_handle_from_uuid
        handle = known.get(message.uuid) or private.get(message.uuid)
        if handle is None or isinstance(handle, viser.GuiUploadButtonHandle):
            raise NotForUs("an unknown widget")
        props = handle._impl.props
        if getattr(props, "disabled", False):
            raise NotForUs("a widget that is switched off")
        value = fitting(message.updates.value, handle.value, props)
        kind = object() if handle._impl.is_button else message.uuid
        return kind, words.GuiUpdateMessage(message.uuid, words.Updates(value))


def fitting(value: Value, now: object, props: object) -> Value:
    """Return a page's value for a widget that has the value `now`, within its limits. Raises NotForUs."""
    options: tuple[str, ...] | None = getattr(props, "options", None)
    match value, now:
        case bool(), bool():
            return value
        case bool(), _:
            pass
        case str(), str() if options is None or value in options:
            return value
        case ((int() | float()), (int() | float())) if not isinstance(now, bool):
            return _number(value, now, props)
        case list(), tuple() if len(value) == len(now):
            return [_number(one, other, props) for one, other in zip(value, now, strict=True)]
    raise NotForUs(f"{type(value).__name__} for a widget that has {type(now).__name__}")


def _number(value: float, now: object, props: object) -> float:
    """Return a number within a widget's limits, whole where it has been."""
    if isinstance(value, bool) or not isinstance(now, int | float) or not math.isfinite(value):
        raise NotForUs("no number")
    low, high = getattr(props, "min", None), getattr(props, "max", None)
    low = -_LARGEST_NUMBER if low is None else low
    high = _LARGEST_NUMBER if high is None else high
    inside = min(max(value, low), high)
    return round(inside) if isinstance(now, int) else float(inside)
