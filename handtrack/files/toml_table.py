"""Checked reading of one TOML table: types, ranges, and no unknown key."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from handtrack.errors import HandtrackError, listed_names


class TableReader:
    """Hands out a table's values one by one; whatever nobody asked for is an unknown key.

    where: file and table for the errors, such as `session.toml, [hand]`. Every method raises
    HandtrackError.
    """

    def __init__(self, table: Any, where: str) -> None:
        if not isinstance(table, Mapping):
            raise HandtrackError(f"{where}: expected a table of settings, found {_shown(table)}.")
        self._table = dict(table)
        self._known: list[str] = []
        self.where = where

    def raw(self, key: str) -> Any:
        """Return the value as it stands, None when absent."""
        self._known.append(key)
        return self._table.get(key)

    def text(self, key: str, default: str | None = None) -> str:
        """Return a text; without a default the key is required."""
        value = self._required(key, default)
        if not isinstance(value, str) or not value:
            raise self.error(key, value, "a text in quotes")
        return value

    def choice(self, key: str, known: tuple[str, ...], default: str) -> str:
        """Return one of the known texts."""
        value = self._required(key, default)
        if value not in known:
            names = ", ".join(f'"{name}"' for name in known)
            raise self.error(key, value, f"one of {names}")
        return value

    def flag(self, key: str, default: bool) -> bool:
        """Return true or false."""
        value = self._required(key, default)
        if not isinstance(value, bool):
            raise self.error(key, value, "true or false")
        return value

    def number(
        self,
        key: str,
        default: float | None = None,
        above: float = -math.inf,
        unit: str = "",
    ) -> float:
        """Return a finite number greater than `above`; without a default the key is required."""
        value = self._required(key, default)
        expected = f"a number above {above:g}" if math.isfinite(above) else "a number"
        if not _is_number(value) or value <= above:
            raise self.error(key, value, expected + (f" [{unit}]" if unit else ""))
        return float(value)

    def whole(self, key: str, default: int | None = None, least: int = 0) -> int:
        """Return an integer of at least `least`; without a default the key is required."""
        value = self._required(key, default)
        if isinstance(value, bool) or not isinstance(value, int) or value < least:
            raise self.error(key, value, f"a whole number of at least {least}")
        return value

    def whole_list(self, key: str, default: tuple[int, ...] | None, names: str) -> tuple[int, ...]:
        """Return integers, as many as `names` has words, such as `x y w h`."""
        value = self._required(key, default)
        count = len(names.split())
        form = f"{count} whole numbers [{', '.join(names.split())}]"
        if not isinstance(value, list | tuple) or len(value) != count:
            raise self.error(key, value, form)
        if any(isinstance(v, bool) or not isinstance(v, int) for v in value):
            raise self.error(key, value, form)
        return tuple(value)

    def finish(self) -> None:
        """Refuse the keys that nobody asked for, naming the known ones."""
        for key in self._table:
            if key not in self._known:
                known = list(dict.fromkeys(self._known))
                raise HandtrackError(
                    f"{self.where}: unknown key '{key}'; {listed_names(key, known, 'known keys')}"
                )

    def error(self, key: str, value: Any, expected: str) -> HandtrackError:
        """Return the error for a value that is not as expected."""
        return HandtrackError(f"{self.where}: {key} = {_shown(value)}; expected {expected}.")

    def _required(self, key: str, default: Any) -> Any:
        value = self.raw(key)
        if value is not None:
            return value
        if default is None:
            there = ", ".join(map(str, self._table)) or "none"
            raise HandtrackError(f"{self.where}: the key '{key}' is missing; keys there: {there}.")
        return default


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _shown(value: Any) -> str:
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, bool):
        return str(value).lower()
    return str(value)
