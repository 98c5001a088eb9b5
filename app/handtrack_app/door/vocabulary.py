"""The words of viser's page that the workbench listens to; whatever else a client sends is none of them.

The fields are viser's own (its `_messages.py`). Not among them, because nothing in the workbench asks for them: uploads,
forms, buttons held down, pictures rendered by the page, public tunnels.
"""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

_Number = Annotated[float, Meta(ge=-1e9, le=1e9)]  # finite, by this
_Pair = tuple[_Number, _Number]
_Place = tuple[_Number, _Number, _Number]
_Turn = tuple[_Number, _Number, _Number, _Number]
_Name = Annotated[str, Meta(max_length=256)]
_Modifier = Annotated[str, Meta(max_length=32)] | None
_Index = Annotated[int, Meta(ge=0, le=2**31)] | None
_Pixels = Annotated[float, Meta(ge=0, le=1e6)]

Value = (
    bool
    | int
    | float
    | Annotated[str, Meta(max_length=4096)]
    | Annotated[list[float], Meta(max_length=64)]
)


class _Message(msgspec.Struct, frozen=True, tag=True, tag_field="type", forbid_unknown_fields=True):
    pass


class ViewerCameraMessage(_Message, frozen=True):
    wxyz: _Turn
    position: _Place
    fov: Annotated[float, Meta(gt=0, lt=3.15)]
    near: _Number
    far: _Number
    image_height: _Pixels
    image_width: _Pixels
    look_at: _Place
    up_direction: _Place


class Updates(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    value: Value


class GuiUpdateMessage(_Message, frozen=True):
    uuid: _Name
    updates: Updates


class LocalStorageGetItemResponseMessage(_Message, frozen=True):
    value: Annotated[str, Meta(max_length=4096)] | None
    error: Annotated[str, Meta(max_length=1024)] | None
    request_uuid: _Name


class CommandTriggerMessage(_Message, frozen=True):
    uuid: _Name


class _OfNode(_Message, frozen=True, kw_only=True):
    name: _Name
    owner: _Name = ""


class TransformControlsUpdateMessage(_OfNode, frozen=True, kw_only=True):
    wxyz: _Turn
    position: _Place


class TransformControlsDragStartMessage(_OfNode, frozen=True):
    pass


class TransformControlsDragEndMessage(_OfNode, frozen=True):
    pass


class SceneNodeClickMessage(_OfNode, frozen=True, kw_only=True):
    instance_index: _Index
    ray_origin: _Place
    ray_direction: _Place
    screen_pos: _Pair
    modifier: _Modifier


class SceneNodeDragMessage(_OfNode, frozen=True, kw_only=True):
    phase: Literal["start", "update", "end"]
    instance_index: _Index
    start_position: _Place
    start_screen_pos: _Pair
    end_position: _Place
    end_screen_pos: _Pair
    button: Literal["left", "middle", "right"]
    modifier: _Modifier


class ScenePointerMessage(_Message, frozen=True):
    event_type: Literal["click", "rect-select"]
    ray_origin: _Place | None
    ray_direction: _Place | None
    screen_pos: Annotated[list[_Pair], Meta(min_length=1, max_length=2)]
    modifier: _Modifier


OfNode = (
    TransformControlsUpdateMessage
    | TransformControlsDragStartMessage
    | TransformControlsDragEndMessage
    | SceneNodeClickMessage
    | SceneNodeDragMessage
)
Message = (
    ViewerCameraMessage
    | GuiUpdateMessage
    | LocalStorageGetItemResponseMessage
    | CommandTriggerMessage
    | ScenePointerMessage
    | OfNode
)
DECODER = msgspec.msgpack.Decoder(Message)
