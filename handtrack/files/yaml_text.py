"""The plain part of YAML that calibration files use: mappings, lists, numbers and texts.

Anchors and aliases, with which a small file fills the memory, are refused. OpenCV's own reader crashes on lists that
are nested deeply, and no other is among the dependencies.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any, NamedTuple

_DEEPEST = 40  # levels
_KEY = re.compile(
    r"""("[^"]*"|'[^']*'|[^\s\[\]{}"'#,&*!|>%@-][^\[\]{}"#]*?|-?\d[^\s:]*)\s*:(?=\s|$)"""
)
_TAG = re.compile(r"^!\S*\s*")
_TOKEN = re.compile(
    r"""\s*([\[\]{},]|"(?:[^"\\]|\\.)*"|'(?:[^']|'')*'|[^\[\]{},\s"'][^\[\]{},]*)"""
)
_INTEGER = re.compile(r"[-+]?\d{1,18}")
_SPECIAL = {
    "": None, "~": None, "null": None, "true": True, "false": False,
    ".nan": float("nan"), ".inf": float("inf"), "-.inf": float("-inf"),
}  # fmt: skip


class _Line(NamedTuple):
    number: int
    indent: int
    text: str


def parse_yaml(text: str) -> Any:
    """Return mappings as dict, lists as list, and numbers, texts, true, false and null.

    Raises ValueError, with the line, for what is no YAML or goes beyond this part of it.
    """
    lines = list(_lines(text))
    if not lines:
        return None
    value, rest = _block(lines, 0, 0)
    if rest < len(lines):
        raise _wrong(lines[rest], "this line fits nothing above it")
    return value


def _lines(text: str) -> Iterator[_Line]:
    """Yield the lines that say something; a list in brackets over several lines is one."""
    parts, start, opened = list[str](), 0, 0
    for number, line in enumerate(text.splitlines(), 1):
        if not parts and line.startswith(("%", "---", "...")):
            continue
        bare = _without_comment(line).rstrip()
        if not bare.strip():
            continue
        start = start if parts else number
        parts.append(bare)
        opened += sum(bare.count(sign) for sign in "[{") - sum(bare.count(sign) for sign in "]}")
        if opened <= 0:
            indent = len(parts[0]) - len(parts[0].lstrip(" "))
            yield _Line(start, indent, " ".join(map(str.strip, parts)))
            parts, opened = [], 0
    if parts:
        raise ValueError(f"line {start}: a bracket is not closed")


def _without_comment(line: str) -> str:
    """Return a line up to a # that stands alone or after a space, and not in quotes."""
    quote = ""
    for i, sign in enumerate(line) if "#" in line else ():
        if quote:
            quote = "" if sign == quote else quote
        elif sign in "\"'" and (i == 0 or line[i - 1] in " [{,:"):
            quote = sign
        elif sign == "#" and (i == 0 or line[i - 1].isspace()):
            return line[:i]
    return line


def _block(lines: list[_Line], at: int, depth: int) -> tuple[Any, int]:
    """Return what the lines from `at` on say at one indentation, and where it ends."""
    if depth > _DEEPEST:
        raise _wrong(lines[at], f"nested more than {_DEEPEST} times")
    if lines[at].text.startswith("- ") or lines[at].text == "-":
        return _sequence(lines, at, depth)
    if _KEY.match(lines[at].text):
        return _mapping(lines, at, depth)
    return _flow(lines[at], lines[at].text), at + 1


def _sequence(lines: list[_Line], at: int, depth: int) -> tuple[list[Any], int]:
    indent, items = lines[at].indent, []
    while at < len(lines) and lines[at].indent == indent and re.match(r"-(\s|$)", lines[at].text):
        line = lines[at]
        inner = line.text[1:].lstrip()
        if not inner:
            value, at = _below(lines, at, indent, depth)
        elif _KEY.match(inner) or inner.startswith("- "):
            lines[at] = _Line(line.number, indent + len(line.text) - len(inner), inner)
            value, at = _block(lines, at, depth + 1)
        else:
            value, at = _flow(line, inner), at + 1
        items.append(value)
    return items, at


def _mapping(lines: list[_Line], at: int, depth: int) -> tuple[dict[str, Any], int]:
    indent, table = lines[at].indent, dict[str, Any]()
    while at < len(lines) and lines[at].indent == indent:
        line = lines[at]
        match = _KEY.match(line.text)
        if match is None:
            break
        key, value = match[1].strip("\"'"), _TAG.sub("", line.text[match.end() :].strip(), count=1)
        if key in table:
            raise _wrong(line, f"the key '{key}' stands twice")
        if value:
            table[key], at = _flow(line, value), at + 1
        else:
            table[key], at = _below(lines, at, indent, depth)
    return table, at


def _below(lines: list[_Line], at: int, indent: int, depth: int) -> tuple[Any, int]:
    """Return what stands below a line that ends with its key; a list may stand as far left as the key."""
    if at + 1 == len(lines):
        return None, at + 1
    below = lines[at + 1]
    is_list = below.indent == indent and re.match(r"-(\s|$)", below.text)
    if below.indent > indent or (is_list and not lines[at].text.startswith("-")):
        return _block(lines, at + 1, depth + 1)
    return None, at + 1


def _flow(line: _Line, text: str) -> Any:
    """Return what stands on one line: a scalar, or lists and mappings in brackets."""
    if text[0] in "&*|>":
        raise _wrong(line, f"{text[0]!r} is not read here: write the value itself")
    if text[0] not in "[{":
        return _scalar(text)
    stack: list[tuple[Any, list[Any]]] = []
    for match in _TOKEN.finditer(text):
        token = match[1].strip()
        if token in ("[", "{"):
            stack.append((token, []))
            if len(stack) > _DEEPEST:
                raise _wrong(line, f"nested more than {_DEEPEST} times")
        elif token in ("]", "}"):
            if not stack or {"[": "]", "{": "}"}[stack[-1][0]] != token:
                raise _wrong(line, "brackets that do not match")
            kind, items = stack.pop()
            value = items if kind == "[" else _flow_mapping(line, items)
            if not stack:
                if text[match.end() :].strip():
                    raise _wrong(line, "words after a bracket")
                return value
            stack[-1][1].append(value)
        elif token != "," and stack:
            stack[-1][1].append(token if stack[-1][0] == "{" else _item(line, token))
    raise _wrong(line, "a bracket is not closed")


def _item(line: _Line, token: str) -> Any:
    if token[0] in "&*":
        raise _wrong(line, f"{token[0]!r} is not read here: write the value itself")
    return _scalar(token)


def _flow_mapping(line: _Line, items: list[Any]) -> dict[str, Any]:
    """Return the mapping of what stood between braces: `key: value` texts, or `key:` before a value in brackets."""
    table, key = dict[str, Any](), None
    for item in items:
        if key is not None:
            table[key], key = item, None
            continue
        name, colon, value = item.partition(":") if isinstance(item, str) else ("", "", "")
        if not colon:
            raise _wrong(line, "a mapping in braces needs `key: value`")
        if value.strip():
            table[name.strip("\"' ")] = _item(line, value.strip())
        else:
            key = name.strip("\"' ")
    return table


def _scalar(text: str) -> Any:
    if text[0] in "\"'" and text[-1] == text[0] and len(text) > 1:
        return text[1:-1]
    if text.lower() in _SPECIAL:
        return _SPECIAL[text.lower()]
    if _INTEGER.fullmatch(text):
        return int(text)
    try:
        return float(text) if text[0] in "+-.0123456789" else text
    except ValueError:
        return text


def _wrong(line: _Line, what: str) -> ValueError:
    return ValueError(f"line {line.number}: {what}")
