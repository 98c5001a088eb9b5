"""HandtrackError, the error that reaches the user as one readable paragraph, and sentences for unknown names."""

from __future__ import annotations

from collections.abc import Sequence


class HandtrackError(Exception):
    """Something the user can mend: what, where, expected, found, what to do.

    The command line prints the message on stderr and exits with 2; the workbench shows it on the page.
    """


def unknown_name(kind: str, given: str, known: Sequence[str], where: str = "") -> HandtrackError:
    """Return the error for a name that does not exist, with the one that may be meant and all that do."""
    place = f" in {where}" if where else ""
    return HandtrackError(f"no {kind} '{given}'{place}; {listed_names(given, known)}")


def listed_names(given: str, known: Sequence[str], what: str = "known") -> str:
    """Return the names that exist, and a question after the one that is most like the given name."""
    from difflib import get_close_matches  # rarely needed, and every command would wait for it

    by_small = {name.lower(): name for name in known}
    near = get_close_matches(str(given).lower(), list(by_small), 1)
    return f"{what}: {', '.join(known)}" + (
        f". Did you mean '{by_small[near[0]]}'?" if near else ""
    )
