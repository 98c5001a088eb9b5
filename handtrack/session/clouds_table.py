"""The table [clouds] in the text of a session.toml: changed key by key, comments and everything else stay."""

from __future__ import annotations

import re
import tomllib
from dataclasses import asdict, fields
from typing import Any

from handtrack.errors import HandtrackError
from handtrack.files.toml_text import toml_value
from handtrack.session.clouds_settings import CloudSettings

_HEADER = re.compile(r"^\s*\[")
_OWN = re.compile(r"^\s*\[clouds\]\s*(#.*)?$")


def with_clouds(text: str, clouds: CloudSettings) -> str:
    """Return the text of a session.toml whose [clouds] reads as these settings.

    Lines of keys that already say so stay as they are, with their comments. Raises HandtrackError for a table
    that is written in a way that is not understood here.
    """
    wanted = clouds_values(clouds)
    lines = text.splitlines()
    start = next((i for i, line in enumerate(lines) if _OWN.match(line)), None)
    if start is None:
        if "clouds" in tomllib.loads(text):
            raise _unclear()
        gap = [] if not lines or not lines[-1].strip() else [""]
        return _joined([*lines, *gap, "[clouds]", *_assignments(wanted)])
    stop = next((i for i in range(start + 1, len(lines)) if _HEADER.match(lines[i])), len(lines))
    body = _edited(lines[start + 1 : stop], tomllib.loads(text)["clouds"], wanted)
    changed = _joined([*lines[: start + 1], *body, *lines[stop:]])
    usual, stands = _plain(vars(CloudSettings())), _read_back(changed)
    if stands is None or {k: v for k, v in stands.items() if v != usual.get(k)} != wanted:
        raise _unclear()
    return changed


def clouds_values(clouds: CloudSettings) -> dict[str, Any]:
    """Return what stands in [clouds] for these settings, by its keys; what is as usual is left out."""
    usual, values = CloudSettings(), {}
    for field in fields(clouds):
        value = getattr(clouds, field.name)
        if value == getattr(usual, field.name):
            continue
        values[field.name] = _plain(asdict(value) if field.name == "skin" else value)
    return values


def _edited(body: list[str], stands: dict[str, Any], wanted: dict[str, Any]) -> list[str]:
    """Return the table's lines with its values changed; new keys come before the blank lines at its end."""
    usual = _plain(vars(CloudSettings()))
    kept: list[str] = []
    for line in body:
        key = _key_of(line)
        if key is None or key not in stands or _same(stands[key], wanted.get(key, usual.get(key))):
            kept.append(line)
        elif key in wanted:
            comment = re.search(r"\s+#[^\"\]}]*$", line)
            kept.append(_assignments({key: wanted[key]})[0] + (comment.group() if comment else ""))
    end = len(kept)
    while end and not kept[end - 1].strip():
        end -= 1
    new = {key: value for key, value in wanted.items() if key not in stands}
    return [*kept[:end], *_assignments(new), *kept[end:]]


def _key_of(line: str) -> str | None:
    found = re.match(r"\s*(\w+)\s*=", line)
    return found.group(1) if found else None


def _assignments(values: dict[str, Any]) -> list[str]:
    return [f"{key} = {toml_value(value)}" for key, value in values.items()]


def _same(stands: Any, wanted: Any) -> bool:
    return stands == wanted and isinstance(stands, bool) == isinstance(wanted, bool)


def _plain(value: Any) -> Any:
    """Return a value as TOML reads it: tuples as lists."""
    if isinstance(value, dict):
        return {key: _plain(part) for key, part in value.items()}
    return [_plain(part) for part in value] if isinstance(value, list | tuple) else value


def _read_back(text: str) -> dict[str, Any] | None:
    try:
        return tomllib.loads(text).get("clouds")
    except tomllib.TOMLDecodeError:
        return None


def _joined(lines: list[str]) -> str:
    return "\n".join(lines) + "\n"


def _unclear() -> HandtrackError:
    return HandtrackError(
        "the clouds' settings in session.toml are written in a way that cannot be changed from here; expected a "
        "table [clouds] with one setting a line. Nothing was written."
    )
