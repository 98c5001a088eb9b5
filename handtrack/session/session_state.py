"""What was decided in a session, as one value: an edit is a function of it, and undo goes back to the one before.

A field of `SessionState` is a kind of decision, and its type is how the store has it: a table's entries are values of
their own (`pose/12`, `setting/cloud.weight`), everything else is one value (`size`). What is not decided holds as the
session's files have it.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import astuple, dataclass, field, fields, replace
from typing import Any, get_args, get_origin, get_type_hints

import msgspec

from handtrack.arrays import number_runs
from handtrack.errors import HandtrackError
from handtrack.model.articulated import HandScale
from handtrack.model.model_file import scale_from, scale_table
from handtrack.observation.pins import Pin
from handtrack.store.history import Span, Value
from handtrack.store.store import spans_of
from handtrack.tracking.whole.refinement import CameraError


class DecidedPose(msgspec.Struct, frozen=True, omit_defaults=True):
    """A frame's pose, by names of joint parameters [m, rad]."""

    parameters: Mapping[str, float]
    found: bool = False
    """a search gave it"""
    pinned: bool = False
    """pins led to it"""
    refitted: bool = False
    """the frame was fitted again while settings were tuned"""
    carried: bool = False
    """it was only seen there when the frame was posed: undo comes back to it"""

    @property
    def is_led(self) -> bool:
        """Whether the solver led there: a person did not pose it."""
        return self.pinned or self.refitted


class MaskSource(msgspec.Struct, frozen=True):
    """Where a camera's masks come from, as session.toml has it."""

    masks: str | dict[str, Any] | None
    roi: tuple[int, int, int, int] | None


class Correction(msgspec.Struct, frozen=True):
    """What is painted over a mask, as a PNG file."""

    png: bytes
    carried: bool = False
    """from a frame beside, not painted there"""


class CameraCorrection(msgspec.Struct, frozen=True):
    """A camera's error against calibration.toml and `lag_s`, which counts as corrected."""

    error: CameraError
    take: int
    """whose estimate it is"""
    calibration: str
    """`Session.calibration_digest` of the camera that it corrects"""


class StartPose(msgspec.Struct, frozen=True):
    """Where tracking begins without a first pose."""

    frame: int
    parameters: Mapping[str, float]


@dataclass(frozen=True)
class DecidedSize:
    """The size of the hand or body."""

    scale: HandScale
    pending: bool = False
    """it is still to be fitted"""
    live: HandScale | None = None
    """what it was before refining found another: tracking begins with it"""

    @property
    def table(self) -> dict[str, Any]:
        """As the store has it."""
        live = {} if self.live is None else {"live": scale_table(self.live)}
        return scale_table(self.scale) | {"pending": self.pending} | live

    @classmethod
    def of(cls, table: dict[str, Any]) -> DecidedSize:
        """Return what `table` is of. Raises HandtrackError."""
        parts = {key: part for key, part in table.items() if key not in ("pending", "live")}
        live, where = table.get("live"), "the saved size"
        before = None if live is None else scale_from(live, where)
        return cls(scale_from(parts, where), bool(table.get("pending", False)), before)


def _own_form(of: Callable[[Any], Any], write: Callable[[Any], Value], **default: Any) -> Any:
    """Return a field whose form in the store is not that of its type; of a table, that of its entries."""
    return field(metadata={"read": of, "write": write}, **default)


Key = tuple[str, Any]
"""a kind of decision, and the entry of its table; None of a kind without one"""


@dataclass(frozen=True)
class SessionState:
    """What was decided; nothing in it is ever changed in place."""

    pose: Mapping[int, DecidedPose] = field(default_factory=dict)
    setting: Mapping[str, Any] = field(default_factory=dict)
    """of [tracking], by dotted names"""
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """of joint parameters [rad]"""
    masks: Mapping[str, MaskSource] = field(default_factory=dict)
    """by camera"""
    correction: Mapping[tuple[str, int], Correction] = field(default_factory=dict)
    """by camera and its own frame"""
    camera: Mapping[str, CameraCorrection] = field(default_factory=dict)
    """by name"""
    pins: Mapping[int, tuple[Pin, ...]] = _own_form(
        lambda said: msgspec.convert(said["pins"], tuple[Pin, ...]),
        lambda pins: {"pins": pins},
        default_factory=dict,
    )
    """by frame"""
    size: DecidedSize | None = _own_form(DecidedSize.of, lambda size: size.table, default=None)
    clouds: dict[str, Any] | None = _own_form(
        lambda said: said["table"] or {}, lambda table: {"table": table or None}, default=None
    )
    """the table [clouds]; empty: there is none"""
    forearm: float | None = _own_form(
        lambda said: math.inf if said is True else float(said),
        lambda arm_m: arm_m if 0 < arm_m < math.inf else arm_m > 0,
        default=None,
    )
    """`TrackingRun.arm_m`; written as whether there is one, or where it ends: JSON has no infinity"""
    start: StartPose | None = None
    accepted: tuple[tuple[int, int], ...] = ()
    """frames that a person accepted, half-open pairs: no tracking changes what shows there"""
    spans: tuple[Span, ...] = _own_form(
        spans_of, lambda spans: [astuple(s) for s in spans], default=()
    )
    """what the current track is composed of, the uppermost last"""

    @property
    def accepted_frames(self) -> frozenset[int]:
        """The frames of `accepted`, one by one."""
        return frozenset(f for first, stop in self.accepted for f in range(first, stop))

    def get(self, key: Key) -> Any:
        """Return what was decided of one thing; None, or nothing, where nothing was."""
        kind, entry = key
        return getattr(self, kind).get(entry) if kind in _TABLES else getattr(self, kind)

    def having(self, values: Mapping[Key, Any]) -> SessionState:
        """Return the state with these values; None: as the session's files have it."""
        changed: dict[str, Any] = {}
        for (kind, entry), value in values.items():
            if kind not in _TABLES:
                changed[kind] = _DEFAULTS[kind] if value is None else value
                continue
            table = changed.setdefault(kind, dict(getattr(self, kind)))
            if value is None:
                table.pop(entry, None)
            else:
                table[entry] = value
        return replace(self, **changed)

    def without(self, kind: str) -> SessionState:
        """Return the state with nothing decided of a kind."""
        return replace(self, **{kind: {} if kind in _TABLES else _DEFAULTS[kind]})

    def changed(self, before: SessionState) -> dict[Key, Any]:
        """Return what is another than before, each with its value now: None where nothing is decided any more."""
        found: dict[Key, Any] = {}
        for kind in _HINTS:
            now, then = getattr(self, kind), getattr(before, kind)
            if now is then:
                continue
            if kind not in _TABLES:
                found[kind, None] = now
                continue
            found |= {(kind, e): value for e, value in now.items() if then.get(e) is not value}
            found |= {(kind, e): None for e in then if e not in now}
        return found


Edit = Callable[[SessionState], SessionState]

_HINTS: dict[str, Any] = get_type_hints(SessionState)
_OWN_FORMS = {one.name: one.metadata for one in fields(SessionState) if one.metadata}
_TABLES = {kind: get_args(hint) for kind, hint in _HINTS.items() if get_origin(hint) is Mapping}
_DEFAULTS = {kind: getattr(SessionState(), kind) for kind in _HINTS}


def decide(**kinds: Any) -> Edit:
    """Return the edit that decides: of a kind with a table some entries, None to leave them to the session's files; of the others
    the value.
    """
    values = dict[Key, Any]()
    for kind, value in kinds.items():
        is_table = kind in _TABLES
        values |= {(kind, e): v for e, v in value.items()} if is_table else {(kind, None): value}
    return lambda state: state.having(values)


def in_turn(*edits: Edit) -> Edit:
    """Return the edit that makes several, one after the other."""

    def edit(state: SessionState) -> SessionState:
        for one in edits:
            state = one(state)
        return state

    return edit


NOTHING = in_turn()
"""the edit that changes nothing"""


def accepting(frames: Iterable[int]) -> Edit:
    """Return the edit by which these frames are accepted, and no others."""
    return decide(accepted=tuple(number_runs(frames)))


# ---- as the store has it


def name_of(key: Key) -> str:
    """Return the store's name of a value."""
    kind, entry = key
    if kind not in _TABLES:
        return kind
    return f"{kind}/{'/'.join(map(str, entry)) if isinstance(entry, tuple) else entry}"


def key_of(name: str) -> Key:
    """Return the key of a value of the store. Raises HandtrackError for one that this version does not know."""
    kind, _, entry = name.partition("/")
    if kind not in _HINTS:
        raise HandtrackError(f"no kind of decision '{kind}'; known: {', '.join(_HINTS)}")
    if kind not in _TABLES:
        return kind, None
    by = _TABLES[kind][0]
    try:
        if get_origin(by) is tuple:
            camera, _, frame = entry.rpartition("/")
            return kind, (camera, int(frame))
        return kind, by(entry)
    except ValueError:
        raise HandtrackError(f"'{name}' is no value of a session's state") from None


def written(key: Key, value: Any) -> Value:
    """Return a value as the store has it; None where nothing is decided."""
    kind = key[0]
    if value is None or (kind not in _TABLES and value == _DEFAULTS[kind]):
        return None
    if kind in _OWN_FORMS:
        value = _OWN_FORMS[kind]["write"](value)
    plain = msgspec.to_builtins(value, enc_hook=lambda number: number.item())
    return json.loads(json.dumps(plain))


def read(values: Mapping[str, Value]) -> dict[Key, Any]:
    """Return values of the store by their keys. Raises HandtrackError for what is none."""
    found: dict[Key, Any] = {}
    for name, value in values.items():
        key = kind, _ = key_of(name)
        if value is None:
            found[key] = None
            continue
        try:
            if kind in _OWN_FORMS:
                found[key] = _OWN_FORMS[kind]["read"](value)
            else:
                hint = _TABLES[kind][1] if kind in _TABLES else _HINTS[kind]
                found[key] = msgspec.convert(value, hint)
        except (
            msgspec.ValidationError,
            LookupError,
            ValueError,
            TypeError,
            AttributeError,
        ) as error:
            raise HandtrackError(f"{name}: {error}") from None
    return found


def readable(
    values: Mapping[str, Value],
    pass_over: Callable[[str, Exception], None] = lambda _name, _error: None,
) -> SessionState:
    """Return the state of a store's values. pass_over: takes the name of each that cannot be read, and why."""
    found: dict[Key, Any] = {}
    for name, value in values.items():
        try:
            found |= read({name: value})
        except HandtrackError as error:
            pass_over(name, error)
    return SessionState().having(found)
