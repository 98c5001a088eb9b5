"""TOML in and out: read with errors that name file and line, and single values written."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from handtrack.errors import HandtrackError
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
