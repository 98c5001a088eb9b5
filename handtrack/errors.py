"""Errors that reach the user, each one readable paragraph."""

from __future__ import annotations


class HandtrackError(Exception):
    """Something the user can mend: what, where, expected, found, what to do.

    The command line prints the message on stderr and exits with 2; the workbench shows it on the page.
    """


def unknown_name(
    kind: str, given: str, known: list[str] | tuple[str, ...], where: str = ""
) -> HandtrackError:
    """Return the error for a name that does not exist, listing the names that do."""
    place = f" in {where}" if where else ""
    return HandtrackError(f"no {kind} '{given}'{place}; known: {', '.join(known)}")
