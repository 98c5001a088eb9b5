"""How a field of a frame's result is kept as arrays of a sequence. All is said where the field is declared: kind and axes by its
type, the rest by `column`. Stacking and slicing, checks and files, records of the store, gaps and turned worlds follow.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import MISSING, Field, dataclass
from typing import Any, Literal

import numpy as np

from handtrack.arrays import D3, Array, Axes, Floats

_TYPE = re.compile(r"(\w+)(?:\[(.*)\])?(?: \| None)?")
_KINDS = {
    "int": int,
    "Ints": int,
    "Status": int,
    "float": float,
    "Floats": float,
    "str": str,
    "tuple": str,
}


@dataclass(frozen=True)
class Column:
    """An array with a row for each frame."""

    kind: type = float
    """float, int or str"""
    axes: tuple[str | int, ...] = ()
    """beside that of frames; equal letters are equal lengths"""
    missing: Any = np.nan
    """in rows of frames without it"""
    finite: bool = False
    gaps: Literal["held", "missing", "dropped"] = "held"
    """what frames that were not tracked have: the row before, `missing`, or the whole array goes"""
    turned: Callable[[Any, Floats[D3, D3]], Any] = lambda array, turn: array
    """the array in a turned world; None: it goes"""
    unit: str = "1"
    meaning: str = ""
    """in words, for readers of tables"""
    names: str = ""
    """the label that says what stands along its last axis"""
    known_names: tuple[str, ...] = ()
    """what does, where the values do not say it themselves"""
    read: Callable[[Any], Any] = lambda value: value
    """a row, of the field's value"""


def vector(array: Floats[*Axes], turn: Floats[D3, D3]) -> Floats[*Axes]:
    """(…, 3)."""
    return array @ turn.T


def tensor(array: Floats[*Axes], turn: Floats[D3, D3]) -> Floats[*Axes]:
    """(…, 3, 3)."""
    return turn @ array @ turn.T


def pose(array: Floats[*Axes], turn: Floats[D3, D3]) -> Floats[*Axes]:
    """(…, 4, 4): bone → world."""
    return np.block([[turn, np.zeros((3, 1))], [np.zeros((1, 3)), np.ones((1, 1))]]) @ array


@dataclass(frozen=True)
class ResultField:
    """A field of a frame's result, and the arrays that it is kept as."""

    columns: Mapping[str, Column]
    join: Callable[..., Any]
    """the value, of a row of each array, and of the names along the last axis"""
    is_optional: bool
    """whether the arrays are left out where no frame has any of it"""

    @property
    def group(self) -> tuple[str, ...]:
        """Arrays and labels that are there together."""
        return (*self.columns, *(c.names for c in self.columns.values() if c.names))


def column(join: Callable[..., Any] | None = None, **how: Any) -> dict[str, Any]:
    """Return the metadata of a field that is one array of its name: what differs from a Column's own, and how a row becomes the value
    where that is not plainly of the type's kind.
    """
    return {"join": join, "how": how}


def columns(join: Callable[..., Any], **arrays: Column) -> dict[str, Any]:
    """Return the metadata of a field that is several arrays, or one with names along it."""
    return {"join": join, "columns": arrays}


def result_fields(entries: Iterable[Field[Any]]) -> dict[str, ResultField]:
    """Return fields of a dataclass by name."""
    return {entry.name: _result_field(entry) for entry in entries}


def _result_field(entry: Field[Any]) -> ResultField:
    told, join = entry.metadata, entry.metadata.get("join")
    is_optional = entry.default is not MISSING or entry.default_factory is not MISSING
    if join is not None and "columns" in told:
        return ResultField(told["columns"], join, is_optional)
    found = _TYPE.fullmatch(str(entry.type))
    assert found is not None, f"{entry.name}: say how a {entry.type} is kept"
    kind = _KINDS[found[1]]
    axes = tuple(int(a[1:]) if a[1:].isdigit() else a for a in re.findall(r"\w+", found[2] or ""))
    how = {"axes": axes, "missing": {int: 0, str: "", float: np.nan}[kind]} | told.get("how", {})
    join = join or (kind if not axes else _unless_missing if is_optional else np.copy)
    return ResultField({entry.name: Column(kind, **how)}, lambda row, *_: join(row), is_optional)


def per_frame(known: Mapping[str, ResultField]) -> Iterator[tuple[str, Column]]:
    """Yield the optional arrays that tables hold beside a pose: a number or text for each frame, or one for each named thing."""
    for field in known.values():
        for name, column in field.columns.items():
            is_plain = len(column.axes) == bool(column.names)
            if field.is_optional and is_plain and column.gaps != "dropped":
                yield name, column


def _unless_missing(row: Array) -> Array | None:
    return None if np.isnan(row).all() else row.copy()


def stacked(known: Mapping[str, ResultField], frames: Sequence[object]) -> dict[str, Any]:
    """Return the arrays of frames, and the labels of their axes; without those of which no frame has anything."""
    found: dict[str, Any] = {}
    for field, own in known.items():
        values: list[Any] = [getattr(frame, field) for frame in frames]
        arrays, names = {}, ()
        if isinstance(values[0], Mapping):
            names = tuple(dict.fromkeys(key for value in values for key in value))
            values = [[value.get(key, np.nan) for key in names] for value in values]
        for name, column in own.columns.items():
            arrays[name] = _stack([None if v is None else column.read(v) for v in values], column)
            if column.names:
                arrays[column.names] = column.known_names or names
        first, *_ = own.columns
        array, missing = arrays[first], own.columns[first].missing
        if not (own.is_optional and ((array == missing) | (array != array)).all()):
            found |= arrays
    return found


def _stack(rows: Sequence[Any], column: Column) -> Array:
    """Return rows as one array; `missing` stands for frames without any, and for what others have more along H."""
    blank = _missing_like(next((row for row in rows if row is not None), None), column)
    if "H" in column.axes:
        most = max(map(len, rows))
        blank = _missing_like(next((row[0] for row in rows if row), None), column)
        rows = [[*row, *[blank] * (most - len(row))] for row in rows]
    return np.array([blank if row is None else row for row in rows], column.kind)


def _missing_like(row: Any, column: Column) -> Any:
    return np.full(() if row is None else np.shape(row), column.missing).tolist()


def joined(
    known: Mapping[str, ResultField], track: object, rows: Iterable[int]
) -> Iterator[dict[str, Any]]:
    """Yield frames' fields, of the arrays of a sequence."""
    there = []
    for field, own in known.items():
        group = [getattr(track, name) for name in own.group]
        if group[0] is not None:
            count = len(own.columns)
            there.append((field, own.join, group[:count], group[count:]))
    for row in rows:
        yield {
            field: join(*(array[row] for array in arrays), *names)
            for field, join, arrays, names in there
        }
