"""Change single values of a TOML file: comments, spelling and everything else stay as they are written."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.container import Container
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import Array, Item, Table

from handtrack.errors import HandtrackError
from handtrack.files.atomic import replace_text
from handtrack.files.text_files import read_text
from handtrack.files.toml_text import read_toml, toml_item
from handtrack.files.versions import keep_version


def edit_toml(path: Path, changes: Mapping[str, Any], what: str) -> str:
    """Change values of a file, whole or not at all; return a sentence about the file before, empty
    where nothing changed.

    Parameters
    ----------
    changes
        Values by their dotted names, None to remove one; of tables in a list, by their number from
        0 (`camera.0.roi`).
    what
        A few words for the error, such as `a session's settings`.

    Raises
    ------
    HandtrackError
        For a file that is no valid TOML, or that cannot be read, changed or written.
    """
    read_toml(path, what)
    before = read_text(path, what)
    try:
        after = changed_toml(before, changes)
    except ValueError as error:
        wished = ", ".join(
            f"without {name}" if value is None else f"{name} = {toml_item(value).as_string()}"
            for name, value in changes.items()
        )
        raise HandtrackError(
            f"{path.name} is written in a way that cannot be changed from here ({error}). Nothing was written. "
            f"To be set by hand: {wished}."
        ) from None
    if after == before:
        return ""
    try:
        previous = keep_version(path)
        replace_text(path, after)
    except OSError as error:
        raise HandtrackError(
            f"{path}: cannot be written ({error.strerror}). Is the folder read-only?"
        ) from None
    return f" The file before is kept as versions/{previous.name}." if previous else ""


def changed_toml(text: str, changes: Mapping[str, Any]) -> str:
    """Return a TOML text with values, by their dotted names, changed; None removes one.

    What reads the same already is not touched. Raises ValueError where a name leads into what is no table, or the
    text would not read back as wished.
    """
    text = text if text.endswith("\n") else f"{text}\n"
    document, wished = tomlkit.parse(text), tomllib.loads(text)
    try:
        for name, value in changes.items():
            keys = name.split(".")
            for path, item in _single(wished, keys, None if value is None else toml_item(value)):
                table, left = _inner(wished, path)
                if item is None:
                    table.pop(left[0], None)
                else:
                    table[left[0]] = _nested(left[1:], item.unwrap())
                _put(document, path, item)
        after = document.as_string()
        stands = tomllib.loads(after)
    except (TOMLKitError, tomllib.TOMLDecodeError, TypeError, AttributeError) as error:
        raise ValueError(str(error)) from None
    if _filled(stands) != _filled(wished):
        raise ValueError("it would not read back as intended")
    return after


def _single(
    tables: Any, keys: list[str], item: Item | None
) -> Iterator[tuple[list[str], Item | None]]:
    """Yield what differs from the tables; a mapping where there is a table already, key by key."""
    inner, left = _inner(tables, keys)
    now = inner.get(left[0]) if len(left) == 1 else None
    value = None if item is None else item.unwrap()
    if isinstance(now, dict) and isinstance(item, Mapping):
        for key in {**now, **item}:
            yield from _single(tables, [*keys, key], item.get(key))
    elif now != value or isinstance(now, bool) != isinstance(value, bool):
        yield keys, item


def _inner(tables: Any, keys: list[str]) -> tuple[Any, list[str]]:
    """Return the innermost table there is on the way to a value, and the keys from there."""
    while len(keys) > 1 and keys[0] in tables:
        tables, table, keys = tables[keys[0]], keys[0], keys[1:]
        in_list = isinstance(tables, list) and len(keys) > 1 and keys[0].isdecimal()
        if in_list and int(keys[0]) < len(tables):
            tables, table, keys = tables[int(keys[0])], f"{table}.{keys[0]}", keys[1:]
        if not isinstance(tables, dict):
            raise ValueError(f"'{table}' is no table")
    return tables, keys


def _put(document: tomlkit.TOMLDocument, keys: list[str], item: Item | None) -> None:
    table, left = _inner(document, keys)
    if table is document and len(left) > 1:
        table = document[left[0]] = tomlkit.table()
        left = left[1:]
    now = table.get(left[0]) if len(left) == 1 else None
    if item is None:
        del table[left[0]]
    elif isinstance(now, Array) and isinstance(item, Array) and len(now) == len(item):
        for index, part in enumerate(item):  # comments between its lines stay
            now[index] = part
    elif len(left) > 1 and isinstance(table, Table | Container):
        table.append(tomlkit.key(left), item)
    else:
        table[left[0]] = toml_item(_nested(left[1:], item))


def _nested(keys: list[str], value: Any) -> Any:
    for key in reversed(keys):
        value = {key: value}
    return value


def _filled(value: Any) -> Any:
    """Return tables without empty ones, which say as much as none."""
    if not isinstance(value, dict):
        return value
    return {key: part for key in value if (part := _filled(value[key])) != {}}
