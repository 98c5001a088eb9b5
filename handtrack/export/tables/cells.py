"""Rows of CSV files: numbers as text, and names that no spreadsheet takes for formulas."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from handtrack.files.atomic import replace_text
from handtrack.files.versions import keep_version

_BEGINS_A_FORMULA = ("=", "+", "-", "@", "\t", "\r")


def number(value: float | np.floating) -> str:
    """Return a number with nine digits; nothing for one that is not known."""
    return "" if np.isnan(value) else f"{float(value):.9g}"


def beside(path: Path) -> Path:
    """Return the path of a file that nobody asked for by its name; what stands there is kept in versions/."""
    keep_version(path)
    return path


def write_rows(path: Path, header: Sequence[str], rows: Iterable[Sequence[object]]) -> Path:
    """Write a CSV file whole or not at all; return its path."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([_harmless(cell) for cell in header])
    for row in rows:
        writer.writerow([_harmless(cell) for cell in row])
    replace_text(path, text.getvalue())
    return path


def _harmless(cell: object) -> object:
    """Return a cell that no spreadsheet takes for a formula: names come from files that others made; numbers stay."""
    if not isinstance(cell, str) or not cell.startswith(_BEGINS_A_FORMULA):
        return cell
    try:
        float(cell)
    except ValueError:
        return f"'{cell}"
    return cell
