"""The only file that uses private names of viser: what its public interface lacks, each under a name of ours.

Tried with viser 1.1.0 and 1.1.1; 1.0.30 has neither panels, browser storage nor bounds of the orbit distance. The messages that a page sends are checked against viser's own declarations of them.
"""

from __future__ import annotations

from collections.abc import AsyncGenerator, Callable, Mapping, Sequence
from contextlib import aclosing
from typing import TYPE_CHECKING, Any
from weakref import WeakValueDictionary

import viser
from viser import _messages as messages
from viser._messages import FileTransferPart, Message

if TYPE_CHECKING:
    from viser import infra
    from viser._gui_handles import GuiModalHandle
    from viser._messages import DragButton, HotkeyKey, KeyModifier
    from viser.infra._async_message_buffer import AsyncMessageBuffer
    from viser.infra._infra import WebsockClientConnection

    _Windows = AsyncGenerator[Sequence[infra.Message], None]

__all__ = [
    "DragButton", "FileTransferPart", "GuiModalHandle", "HotkeyKey", "KeyModifier", "Message", "messages",
]  # fmt: skip


def from_pages(server: viser.ViserServer) -> Mapping[str, type[Any]]:
    """Return the messages of pages to which a server listens, or each of its clients for itself, by name."""
    of_clients = (messages.ViewerCameraMessage, messages.LocalStorageGetItemResponseMessage)
    kinds = {*server._websock_server._incoming_handlers, *of_clients}
    return {one.__name__: one for one in kinds}


# ---- handles


def id_of(handle: Any) -> str:
    """Return the id of a widget or command."""
    return handle._impl.uuid


def is_button(widget: Any) -> bool:
    """Return whether a widget is pressed, and has no value of its own."""
    return widget._impl.is_button


def properties(widget: Any) -> Any:
    """Return what a widget is drawn by: its limits, options and whether it is disabled."""
    return widget._impl.props


def widgets(owner: viser.ViserServer | viser.ClientHandle) -> Mapping[str, Any]:
    """Return the input widgets of a server, or of one client alone, by id."""
    return owner.gui._gui_input_handle_from_uuid


def nodes(owner: viser.ViserServer | viser.ClientHandle) -> Mapping[str, Any]:
    """Return the scene's nodes by name."""
    return owner.scene._handle_from_node_name


def has_command(server: viser.ViserServer, uuid: str) -> bool:
    """Return whether a command is registered."""
    return uuid in server.gui._command_handle_from_uuid


# ---- messages


def send(to: viser.ViserServer | viser.ClientHandle, message: Message) -> None:
    """Send a message to all clients, or to one."""
    if isinstance(to, viser.ClientHandle):
        to._websock_connection.queue_message(message)
    else:
        to._websock_server.queue_message(message)


def acknowledge(server: viser.ViserServer, client: int, part: FileTransferPart) -> None:
    """Tell a page that its file came, of which this is all."""
    if (page := server.get_clients().get(client)) is not None:
        size = len(part.content)
        send(page, messages.FileTransferPartAck(part.source_component_uuid, part.transfer_uuid, size, size))  # fmt: skip


def run_javascript(to: viser.ViserServer | viser.ClientHandle, source: str) -> None:
    """Run a script in all pages, or in one."""
    send(to, messages.RunJavascriptMessage(source))


def show_value(client: viser.ClientHandle, widget: Any, value: object) -> None:
    """Show one client a value of a widget."""
    send(client, messages.GuiUpdateMessage(id_of(widget), {"value": value}))


def mark(slider: viser.GuiMultiSliderHandle[float], value: float) -> None:
    """Mark a value on a range, for all pages."""
    marks = (messages.GuiSliderMark(value, None),)
    if properties(slider)._marks != marks:
        slider._marks = marks


def fold_panel(client: viser.ClientHandle, gui: viser.GuiApi, panel: Any, folded: bool) -> None:
    """Fold a panel or open it, for one client."""
    send(client, messages.GuiSetPanelCollapsedMessage(
        panel._placement_uuid, folded, gui._next_layout_counter(), gui._layout_run_id
    ))  # fmt: skip


def on_storage(server: viser.ViserServer, hear: Callable[[str], None]) -> None:
    """Call back with the question of each answer."""
    server._websock_server.register_handler(
        messages.LocalStorageGetItemResponseMessage, lambda _, message: hear(message.request_uuid)
    )  # fmt: skip


# ---- connections and threads


def send_whole(server: viser.ViserServer) -> None:
    """Let each page get all that waits for all pages at once, and what waits for that page alone after all that it found here.

    viser ends a window of messages after 128 of them, and where another thread begins a block: a page drew half of a pose for as
    long as that block took. And what a new page alone was told could come before the scene as all see it, which then undid it.
    """
    shared = server._websock_server
    new = WeakValueDictionary[int, "AsyncMessageBuffer"]()
    """of pages that have nothing of the scene yet, and have not left"""

    def greet(connection: WebsockClientConnection) -> None:
        new[connection.client_id] = own = connection.get_message_buffer()
        own.atomic_start()
        _join_windows(own)

    def sent(client: int) -> None:
        if (own := new.pop(client, None)) is not None:
            own.atomic_end()

    _join_windows(shared.get_message_buffer(), sent)
    shared.on_client_connect(greet)
    shared.disconnect_all_clients()  # who came before this comes again


def _join_windows(
    buffer: AsyncMessageBuffer, sent: Callable[[int], None] = lambda client: None
) -> None:
    """Let clients get windows of which nothing is left behind. sent: is told whom one was sent.

    A message is taken only while no block is open: where none is left, each block is in the window as a whole or not at all.
    """
    windows_of = buffer.window_generator

    async def joined(client: int, windows: _Windows) -> _Windows:
        window: list[infra.Message] = []
        async with aclosing(windows):
            async for part in windows:
                window += part
                left = range(buffer.generator_cursors[client] + 1, buffer.message_counter)
                behind = filter(None, map(buffer.message_from_id.get, left))
                if all(one.excluded_self_client == client for one in behind):
                    yield window
                    sent(client)
                    window = []

    buffer.window_generator = lambda client_id, backlog_done_message=None: joined(
        client_id, windows_of(client_id, backlog_done_message)
    )


def client_of(server: viser.ViserServer, connection: object) -> int | None:
    """Return the number of a client by its connection; None before viser has it."""
    live = server._websock_server._live_connections
    return next((number for number, one in live.items() if one is connection), None)


def submit(gui: viser.GuiApi, act: Callable[..., None], *arguments: object) -> None:
    """Call on one of viser's threads."""
    gui._thread_executor.submit(act, *arguments)
