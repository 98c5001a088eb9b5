"""One setting, declared once: default, range, unit, words. Checks, `--set`, session.toml, page and docs derive from it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cache
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

_KEY = "setting"


@dataclass(frozen=True)
class Setting:
    """What is known of a setting. Name, kind and default are its field's; the rest is said in `setting(...)`."""

    help: str
    """what it does, in one sentence; below its widget and in the docs"""
    label: str = ""
    """beside its widget"""
    level: Literal["user", "expert"] = "expert"
    """user: stands on the page; expert: for `--set` and session.toml; on the page, in a folder of its own, where it has a label"""
    unit: str = ""
    low: float = -math.inf
    """least value; of each number, where there are several"""
    above: float = -math.inf
    """what the value must be above"""
    high: float = math.inf
    slider: tuple[float, float, float] | None = None
    """low, high and step of its widget, in units of the page"""
    page_unit: float = 1.0
    """what 1 on the page is, in the setting's own unit"""
    words: Mapping[str, str] = field(default_factory=dict)
    """the page's words for values to choose from"""
    explanations: Mapping[str, str] = field(default_factory=dict)
    """a sentence on each of these values, shown below the widget for the one chosen"""
    about: Literal["hand", "body", ""] = ""
    """the only kind of model for which it means anything"""
    name: str = ""
    kind: type = str
    default: Any = None
    choices: tuple[str, ...] = ()
    """all values there are"""
    many: bool = False
    """several numbers or names"""
    optional: bool = False
    """None, written `false`, switches off what it is about"""

    def accept(self, value: Any) -> Any:
        """Return a value, or what stands for one in text, as its kind. Raises ValueError."""
        try:
            found = self._converted(value)
        except (TypeError, ValueError):
            raise ValueError(self.range_words) from None
        if self.choices and found not in self.choices:
            raise ValueError(f"one of {', '.join(self.choices)}")
        if self.many and not found:
            raise ValueError(self.range_words)
        if self.kind in (bool, str):
            return found
        numbers = found if self.many else (found,)
        if any(n < self.low or n <= self.above or n > self.high for n in numbers):
            raise ValueError(self.range_words)
        return found

    @property
    def range_words(self) -> str:
        """What values are accepted, in words."""
        if self.kind is bool:
            return "true or false"
        if self.kind is str:
            return "names"
        kind = "numbers" if self.many else "a whole number" if self.kind is int else "a number"
        unit = f" [{self.unit}]" if self.unit else ""
        if self.above > -math.inf and self.high < math.inf:
            return f"{kind} above {self.above:g}, at most {self.high:g}{unit}"
        if self.high < math.inf:
            return f"{kind} from {self.low:g} to {self.high:g}{unit}"
        if self.above > -math.inf:
            return f"{kind} above {self.above:g}{unit}"
        return f"{kind} of at least {self.low:g}{unit}" if self.low > -math.inf else kind + unit

    def _converted(self, value: Any) -> Any:
        if self.kind is bool:
            return _boolean(value)
        if self.many:
            items = value.split(",") if isinstance(value, str) else value
            if self.kind is str:
                return tuple(str(item).strip() for item in items)
            return tuple(self._number(item) for item in items)
        if self.kind in (float, int):
            return self._number(value)
        return str(value).lower() if isinstance(value, bool) else str(value)

    def _number(self, value: Any) -> Any:
        number = float(_boolean(value)) if _is_boolean(value) else float(value)
        if not math.isfinite(number) or self.kind(number) != number:
            raise ValueError
        return self.kind(number)


def setting(default: Any, help: str, **more: Any) -> Any:
    """Return a dataclass field that is a setting, with its default and what `Setting` holds of it."""
    return field(default=default, metadata={_KEY: Setting(help, **more)})


@cache
def declared(table: type[Any], prefix: str = "") -> Mapping[str, Setting]:
    """Return the settings among a dataclass' fields by name, in order; a field without a declaration is none."""
    hints = get_type_hints(table)
    found = {}
    for item in fields(table):
        if _KEY in item.metadata:
            name = prefix + item.name
            known = replace(item.metadata[_KEY], name=name, default=item.default)
            found[name] = _of_kind(known, hints[item.name])
    return found


def _of_kind(known: Setting, hint: Any) -> Setting:
    if get_origin(hint) in (Union, UnionType):
        known = replace(known, optional=True)
        (hint,) = (part for part in get_args(hint) if part is not NoneType)
    if get_origin(hint) is Literal:
        return replace(known, choices=get_args(hint))
    if get_origin(hint) is tuple:
        return replace(known, kind=get_args(hint)[0], many=True)
    return replace(known, kind=hint)


def _is_boolean(value: Any) -> bool:
    return isinstance(value, bool) or str(value).lower() in ("true", "false")


def _boolean(value: Any) -> bool:
    if not _is_boolean(value):
        raise ValueError
    return str(value).lower() == "true"
