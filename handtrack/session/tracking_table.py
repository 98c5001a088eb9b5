"""The table [tracking] in the text of a session.toml: some settings changed, every other line and all comments stay."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from typing import Any

from handtrack.errors import HandtrackError
from handtrack.files.toml_text import toml_value

_TABLE = "tracking"
_HEADER = re.compile(r"^\s*\[+([^\[\]#]+)\]+\s*(#.*)?$")
_SETTING = re.compile(r"""^(\s*([\w."'-]+)\s*=\s*)(.*)$""")


def with_tracking(text: str, changed: Mapping[str, Any]) -> str:
    """Return the text of a session.toml whose [tracking] has some settings, by their dotted names, changed.

    Raises HandtrackError for a text that is written in a way that is not understood here.
    """
    before = tomllib.loads(text)
    lines, places, left = [], {}, dict(changed)
    where: tuple[str, ...] = ()
    for line in text.splitlines():
        if header := _HEADER.match(line):
            where = _parts(header.group(1))
        elif (found := _SETTING.match(line)) and (value := _value_of(found.group(3))) is not None:
            first, *own = (*where, *_parts(found.group(2)))
            name = ".".join(own)
            if first == _TABLE and name in left:
                rest = found.group(3)[len(value) :]
                line = f"{found.group(1)}{toml_value(left.pop(name))}{rest}"
        lines.append(line)
        if line.strip():
            places[where] = len(lines)
    after = "\n".join(_with_new(lines, places, left)) + "\n"
    if _read(after) != _expected(before, changed):
        raise _unclear(changed)
    return after


def _with_new(
    lines: list[str], places: Mapping[tuple[str, ...], int], new: Mapping[str, Any]
) -> list[str]:
    """Return the lines with new settings at the ends of their tables. places: after how many lines each table ends."""
    found = list(lines)
    if (_TABLE,) not in places and any((_TABLE, n.partition(".")[0]) not in places for n in new):
        found += [*([""] if found and found[-1].strip() else []), f"[{_TABLE}]"]
        places = {**places, (_TABLE,): len(found)}
    added: dict[int, list[str]] = {}
    for name, value in new.items():
        group, _, rest = name.partition(".")
        own = (_TABLE, group) in places
        place = places[(_TABLE, group) if own else (_TABLE,)]
        added.setdefault(place, []).append(f"{rest if own else name} = {toml_value(value)}")
    for place in sorted(added, reverse=True):
        found[place:place] = added[place]
    return found


def _parts(key: str) -> tuple[str, ...]:
    return tuple(part.strip().strip("\"'") for part in key.split("."))


def _value_of(text: str) -> str | None:
    """Return the part of a line that is its value, without a comment; None for one that goes on in the next line."""
    ends = [found.start() for found in re.finditer("#", text)]
    for end in (*ends, len(text)):
        value = text[:end].rstrip()
        if _read(f"x = {value}\n") is not None:
            return value
    return None


def _read(text: str) -> dict[str, Any] | None:
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return None


def _expected(before: Mapping[str, Any], changed: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the changed text is to read as."""
    tables: dict[str, Any] = {**before}
    for name, value in changed.items():
        table = tables[_TABLE] = dict(tables.get(_TABLE, {}))
        *groups, last = name.split(".")
        for group in groups:
            table[group] = dict(table.get(group, {}))
            table = table[group]
        table[last] = list(value) if isinstance(value, tuple) else value
    return tables


def _unclear(changed: Mapping[str, Any]) -> HandtrackError:
    wished = ", ".join(f"{name} = {toml_value(value)}" for name, value in changed.items())
    return HandtrackError(
        "the settings in session.toml are written in a way that cannot be changed from here; expected a table [tracking] "
        f"with one setting a line. Nothing was written. To be set by hand: {wished}."
    )
