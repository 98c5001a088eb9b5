"""Questions to whoever sits at the terminal; where nobody does, nothing is asked."""

from __future__ import annotations

import sys


def can_ask() -> bool:
    """Return whether both ends are a terminal, so that somebody can read the question and answer it."""
    return sys.stdin.isatty() and sys.stderr.isatty()


def question(text: str, proposal: str = "") -> str:
    """Return the answer, the proposal for an empty one. Raises KeyboardInterrupt when the terminal is closed."""
    shown = f" [{proposal}]" if proposal else ""
    print(f"{text}{shown} ", end="", file=sys.stderr, flush=True)
    line = sys.stdin.readline()
    if not line:
        raise KeyboardInterrupt
    return line.strip() or proposal


def confirmed(text: str) -> bool:
    """Return whether somebody says yes; nobody does where nobody can be asked."""
    return can_ask() and question(f"{text} y/n", "n").lower() in ("y", "yes")
