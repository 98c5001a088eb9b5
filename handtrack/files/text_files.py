"""Files that people name: looked at before they are opened, so that none waits for ever or fills the memory; texts read in one place."""

from __future__ import annotations

import csv
import io
import json
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from handtrack.errors import HandtrackError

MOST_BYTES = 64 << 20  # of a description in words or numbers; a calibration has some kB
INCH_M = 0.0254
UNITS_M = {
    word: metres
    for words, metres in {
        "m meter meters metre metres": 1.0,
        "mm millimeter millimeters millimetre millimetres": 1e-3,
        "cm centimeter centimeters centimetre centimetres": 1e-2,
        "in inch inches": INCH_M,
    }.items()
    for word in words.split()
}
"""metres in the units of length that files name"""
LIKELY_UNITS_M = {"metres": 1.0, "centimetres": 0.01, "millimetres": 0.001, "inches": INCH_M}
"""in which a file that does not name its unit may be, in words"""


def check_file(path: Path, what: str, most_bytes: int = MOST_BYTES) -> None:
    """Raise HandtrackError unless a path is a plain file of at most so many bytes.

    Parameters
    ----------
    what
        A few words for the error, such as `a calibration`.
    """
    if path.is_dir():
        raise HandtrackError(f"{path} is a folder; expected {what}.")
    if not path.exists():
        raise HandtrackError(f"{path}: no such file; expected {what} there.")
    if not path.is_file():
        raise HandtrackError(f"{path} is a pipe or a device, not a file, so it was not opened.")
    size = path.stat().st_size
    if size > most_bytes:
        raise HandtrackError(
            f"{path} has {size / 1e6:.0f} MB; {what} of more than {most_bytes / 1e6:.0f} MB is not read. Is it another file?"
        )


def first_bytes(path: Path, count: int = 4096) -> bytes:
    """Return how a file begins. Raises HandtrackError where it cannot be read."""
    try:
        with path.open("rb") as file:
            return file.read(count)
    except OSError as error:
        raise HandtrackError(f"{path}: cannot be read ({error.strerror}).") from None


_DECIMAL_COMMA = re.compile(r"^(\s*[-+]?\d*),(\d+(?:[eE][-+]?\d+)?\s*)$")
_LONGEST_WHOLE = 18  # digits: what 64 bits hold; longer ones become floats


def read_text(path: Path, what: str, most_bytes: int = MOST_BYTES) -> str:
    """Return a file's text, without the mark that some editors put before it.

    Parameters
    ----------
    what
        A few words for the error, such as `the calibration`.

    Raises
    ------
    HandtrackError
        Also for a file of more than so many bytes.
    """
    check_file(path, what, most_bytes)
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise HandtrackError(
            f"{path}: not UTF-8 text ({error.reason} at byte {error.start}). Save it as UTF-8."
        ) from None
    except OSError as error:
        raise HandtrackError(f"{path}: cannot read {what}: {error.strerror}.") from None


def read_json(path: Path, what: str, most_bytes: int = MOST_BYTES) -> Any:
    """Return what a JSON file says; NaN and infinity are refused, as JSON does. Raises HandtrackError."""
    text = read_text(path, what, most_bytes)
    try:
        return json.loads(
            text,
            parse_constant=_no_constant,
            parse_int=lambda n: int(n) if len(n) <= _LONGEST_WHOLE else float(n),
        )
    except json.JSONDecodeError as error:
        raise HandtrackError(
            f"{path}: not valid JSON at line {error.lineno}: {error.msg}; expected {what} there."
        ) from None
    except (ValueError, RecursionError) as error:
        raise HandtrackError(f"{path}: cannot be read as JSON: {error}.") from None


def read_xml(path: Path, what: str) -> ElementTree.Element:
    """Return an XML file's root; one that declares a document type or entities is refused. Raises HandtrackError."""
    text = read_text(path, what)
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise HandtrackError(
            f"{path}: XML with declarations of its own (DOCTYPE) is not read; {what} needs none."
        )
    try:
        return ElementTree.fromstring(re.sub(r"^\s*<\?xml[^>]*\?>", "", text))
    except ElementTree.ParseError as error:
        raise HandtrackError(f"{path}: not valid XML: {error}.") from None


def read_rows(text: str, where: str, separator: str = "") -> list[list[str]]:
    """Return the rows of a table. Raises HandtrackError.

    separator: unless given, comma, semicolon or tab, as the first line has it. Between semicolons, decimal commas become points.
    """
    chosen = separator or max(",;\t", key=text[:4096].lstrip().partition("\n")[0].count)
    try:
        rows = list(csv.reader(io.StringIO(text), delimiter=chosen))
    except csv.Error as error:
        raise HandtrackError(f"{where}: no readable table ({error}).") from None
    if chosen != ";" or "," not in text:
        return rows
    return [[_DECIMAL_COMMA.sub(r"\1.\2", cell) for cell in row] for row in rows]


def column_of(head: Sequence[str], names: str) -> int | None:
    """Return which column has one of some names, the first of them that is there. names: with a space between two."""
    return next((head.index(name) for name in names.split(" ") if name in head), None)


def number_in(cell: str, where: str) -> float:
    """Return a cell's number, NaN for an empty one. Raises HandtrackError for another text."""
    try:
        return float(cell) if cell.strip() else math.nan
    except ValueError:
        raise HandtrackError(f"{where}: '{cell[:40]}'; expected a number.") from None


def metres_in(unit: Any, where: str) -> float:
    """Return the metres in a unit of length, given by name or as a number of metres. Raises HandtrackError."""
    known = float(unit) if isinstance(unit, int | float) else UNITS_M.get(str(unit).strip().lower())
    if known is None or not known > 0:
        raise HandtrackError(f"{where} = {unit!r}; expected one of {', '.join(UNITS_M)}.")
    return known


def _no_constant(name: str) -> float:
    raise ValueError(f"{name} is no JSON number; write null where a value is unknown")
