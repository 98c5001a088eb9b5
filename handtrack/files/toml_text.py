"""TOML in and out: read with errors that name file and line, write short values on one line."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from handtrack.errors import HandtrackError
from handtrack.files.text_files import read_text

_WHOLE_BITS = 63  # and a sign


def read_toml(path: Path, what: str) -> dict[str, Any]:
    """Return the tables of a TOML file. what: a few words for the error, such as `the calibration`.

    Raises HandtrackError when there is no such file, or it is not valid TOML (with its line).
    """
    text = read_text(path, what)
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


def toml_value(value: Any) -> str:
    """Return a value as TOML on one line: text, numbers, booleans, lists and inline tables."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{toml_key(k)} = {toml_value(v)}" for k, v in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(toml_value(v) for v in value) + "]"
    if isinstance(value, float):
        return repr(float(value))  # every digit, and no numpy type's name around it
    if isinstance(value, int):
        return repr(int(value))
    raise TypeError(f"no TOML for {type(value).__name__}")


def toml_key(key: str) -> str:
    """Return a key, quoted where TOML needs it."""
    bare = key.isascii() and key.replace("_", "").replace("-", "").isalnum()
    return key if bare else toml_value(key)
