"""HTML that several panels show: lines of text, rows of a name and a value, chips of a colour."""

from __future__ import annotations

import html
from collections.abc import Iterable


def text(words: str, faint: bool = True, kind: str = "") -> str:
    """Return a paragraph; nothing for no words. words: HTML. kind: a class for the style sheet."""
    if not words:
        return ""
    return f"<div class='handtrack-text {'handtrack-faint' if faint else ''} {kind}'>{words}</div>"


def escaped(words: str, faint: bool = True) -> str:
    """Return a paragraph of plain words."""
    return text(html.escape(words), faint)


def row(name: str, value: str) -> str:
    """Return a name at the left and a value at the right, both plain words."""
    return f"<div class='handtrack-row'><span>{html.escape(name)}</span><b>{html.escape(value)}</b></div>"


def chip(colour: str) -> str:
    """Return a small square of a colour."""
    return f"<span class='handtrack-chip' style='background:{colour}'></span>"


def table(rows: str, kind: str = "") -> str:
    """Return rows (HTML) as a table."""
    return f"<table class='handtrack-table {kind}'>{rows}</table>"


def rgb(colour: Iterable[float]) -> str:
    """Return a colour as CSS has it."""
    return f"rgb{tuple(map(int, colour))}"
