"""TOML in and out: read with errors that name file and line; a table as a frozen dataclass, whose fields' types say which kinds and
ranges are taken, and no other key is.

A field's type is what msgspec converts to; a `Meta` in it carries the limits, and the words that an error says of them.
"""

from __future__ import annotations

import functools
import sys
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, get_args, get_type_hints

import msgspec
from msgspec import Meta

from handtrack.errors import HandtrackError, listed_names
from handtrack.files.text_files import read_text

if TYPE_CHECKING:
    from tomlkit.items import Item

_WHOLE_BITS = 63  # and a sign
_MOST_BYTES = 4 << 20  # settings of a thousand cameras have 0.3 MB; Python reads some MB a second


def read_toml(path: Path, what: str) -> dict[str, Any]:
    """Return the tables of a TOML file.

    Parameters
    ----------
    what
        A few words for the error, such as `the calibration`.

    Raises
    ------
    HandtrackError
        When there is no such file, or it is too large, or not valid TOML (with its line).
    """
    text = read_text(path, what, _MOST_BYTES)
    try:
        tables = tomllib.loads(text)
        _check_numbers(tables)
    except (ValueError, RecursionError) as error:
        raise HandtrackError(f"{path}: not valid TOML: {error}.") from None
    return tables


def _check_numbers(value: Any) -> None:
    """Raise ValueError for what TOML forbids and Python allows."""
    if isinstance(value, int) and value.bit_length() > _WHOLE_BITS:
        raise ValueError(f"a whole number of {value.bit_length()} bits; expected at most 64")
    parts = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    for part in parts:
        _check_numbers(part)


def toml_item(value: Any) -> Item:
    """Return a value as TOML that stands on one line: a mapping as an inline table, a sequence as an array."""
    import tomlkit  # slow to import, and most commands only read

    if isinstance(value, Mapping):
        table = tomlkit.inline_table()
        for key, part in value.items():
            table.append(key, toml_item(part))
        return table
    if isinstance(value, list | tuple):
        array = tomlkit.array()
        array.extend(map(toml_item, value))
        return array
    return tomlkit.item(value)


# ---- A table as a frozen dataclass


T = TypeVar("T")

FULL = Meta(min_length=1, description="a text in quotes")
"""for a text that is not empty"""


def above(least: float, unit: str = "") -> Meta:
    """Return what a finite number greater than `least` is."""
    words = f"a number above {least:g}" + (f" [{unit}]" if unit else "")
    return Meta(gt=least, le=sys.float_info.max, description=words)


def at_least(least: int) -> Meta:
    """Return what a whole number of at least `least` is."""
    return Meta(ge=least, description=f"a whole number of at least {least}")


def one_of(known: Sequence[str]) -> Meta:
    """Return what one of some texts is."""
    names = ", ".join(f'"{name}"' for name in known)
    return Meta(pattern=f"^({'|'.join(known)})$", description=f"one of {names}")


def read_table(kind: type[T], table: Any, where: str, also: Sequence[str] = (), **ready: Any) -> T:
    """Return a table's values as a dataclass, some of which are `ready` already: the table has these only as far as the caller
    reads them.

    Parameters
    ----------
    where
        File and table for the errors, such as `session.toml, [hand]`.
    also
        Keys that the caller reads.

    Raises
    ------
    HandtrackError
        For a key that the dataclass lacks, for one that it needs, for a value of another kind or
        range, and with the words of a ValueError that the dataclass itself raises, because values
        do not go together.
    """
    table = checked_table(table, where)
    names = [field.name for field in fields(kind)]  # type: ignore[arg-type]
    known = [*also, *(name for name in names if name not in ready)]
    for key in table:
        if key not in known:
            raise HandtrackError(
                f"{where}: unknown key '{key}'; {listed_names(key, known, 'known keys')}"
            )
    types = _types(kind)
    values = dict[str, Any]()
    for key in [key for key in table if key not in also]:
        try:
            values[key] = msgspec.convert(table[key], types[key])
        except msgspec.ValidationError:
            expected = " or ".join(_words(types[key]))
            raise HandtrackError(
                f"{where}: {key} = {shown(table[key])}; expected {expected}."
            ) from None
    for field in fields(kind):  # type: ignore[arg-type]
        if field.default is MISSING and field.default_factory is MISSING:
            required({**table, **ready}, field.name, where)
    try:
        return kind(**values, **ready)
    except ValueError as error:
        raise HandtrackError(f"{where}: {error}") from None


@functools.cache
def _types(kind: type) -> dict[str, Any]:
    return get_type_hints(kind, include_extras=True)


def checked_table(table: Any, where: str) -> dict[str, Any]:
    """Return a table. Raises HandtrackError for anything else."""
    if not isinstance(table, Mapping):
        raise HandtrackError(f"{where}: expected a table of settings, found {shown(table)}.")
    return dict(table)


def required(table: Mapping[str, Any], key: str, where: str) -> Any:
    """Return the value of a key. Raises HandtrackError where there is none."""
    if key not in table:
        there = ", ".join(map(str, table)) or "none"
        raise HandtrackError(f"{where}: the key '{key}' is missing; keys there: {there}.")
    return table[key]


def shown(value: Any) -> str:
    """Return a value as TOML writes it, for errors."""
    if isinstance(value, bool):
        return str(value).lower()
    return f'"{value}"' if isinstance(value, str) else str(value)


def _words(kind: Any) -> list[str]:
    """Return what is expected of a kind, in words; the outermost description counts."""
    for meta in getattr(kind, "__metadata__", ()):
        if meta.description:
            return [meta.description]
    if kind is bool:
        return ["true or false"]
    return [words for part in get_args(kind) if part is not type(None) for words in _words(part)]
