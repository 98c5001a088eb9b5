"""Change single values of a TOML file: comments, spelling and everything else stay as they are written."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.container import Container
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import Array, Table

from handtrack.errors import HandtrackError
from handtrack.files.atomic import keep_version, replace_text
from handtrack.files.text_files import read_text
from handtrack.files.toml_table import read_toml, toml_item


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
            _set(document, wished, name.split("."), value)
        after = document.as_string()
        stands = tomllib.loads(after)
    except (TOMLKitError, tomllib.TOMLDecodeError, TypeError, AttributeError) as error:
        raise ValueError(str(error)) from None
    if _filled(stands) != _filled(wished):
        raise ValueError("it would not read back as intended")
    return after


def _set(table: Any, wished: dict[str, Any], keys: list[str], value: Any) -> None:
    """Set a value in a table, and in the same one as plain Python; None removes it. Where a table stands and another is given,
    they are changed key by key. Raises ValueError where the keys lead into what is no table.
    """
    is_root = True
    while len(keys) > 1 and keys[0] in wished:
        named, *keys = keys
        table, inner, is_root = table[named], wished[named], False
        in_list = isinstance(inner, list) and len(keys) > 1 and keys[0].isdecimal()
        if in_list and int(keys[0]) < len(inner):
            number, *keys = keys
            table, inner, named = table[int(number)], inner[int(number)], f"{named}.{number}"
        if not isinstance(inner, dict):
            raise ValueError(f"'{named}' is no table")
        wished = inner
    key, *below = keys
    now = None if below else wished.get(key)
    if isinstance(now, dict) and isinstance(value, Mapping):
        for inner_key in {**now, **value}:
            _set(table[key], now, [inner_key], value.get(inner_key))
        return
    item = None if value is None else toml_item(value)
    plain = None if item is None else item.unwrap()
    if now == plain and isinstance(now, bool) == isinstance(plain, bool):
        return
    if item is None:
        del table[key], wished[key]
        return
    wished[key] = _nested(below, plain)
    if below and is_root:
        table[key] = tomlkit.table()
        table, key, *below = table[key], *below
    stands = None if below else table.get(key)
    if isinstance(stands, Array) and isinstance(item, Array) and len(stands) == len(item):
        for index, part in enumerate(item):  # comments between its lines stay
            stands[index] = part
    elif below and isinstance(table, Table | Container):
        table.append(tomlkit.key([key, *below]), item)
    else:
        table[key] = toml_item(_nested(below, item))


def _nested(keys: list[str], value: Any) -> Any:
    for key in reversed(keys):
        value = {key: value}
    return value


def _filled(value: Any) -> Any:
    """Return tables without empty ones, which say as much as none."""
    if not isinstance(value, dict):
        return value
    return {key: part for key in value if (part := _filled(value[key])) != {}}
