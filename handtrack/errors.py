"""HandtrackError, the error that reaches the user as one readable paragraph, and sentences for unknown names."""

from __future__ import annotations

from collections.abc import Collection, Sequence


class HandtrackError(Exception):
    """Something the user can mend: what, where, expected, found, what to do.

    The command line prints the message on stderr and exits with 2; the workbench shows it on the page.
    """


def unknown_name(kind: str, given: str, known: Sequence[str], where: str = "") -> HandtrackError:
    """Return the error for a name that does not exist, with the one that may be meant and all that do."""
    place = f" in {where}" if where else ""
    return HandtrackError(f"no {kind} '{given}'{place}; {listed_names(given, known)}")


def check_name(kind: str, given: str, known: Collection[str], where: str = "") -> None:
    """Raise HandtrackError unless a name exists, as `unknown_name` has it."""
    if given not in known:
        raise unknown_name(kind, given, tuple(known), where)


def index_of(kind: str, given: str, known: Sequence[str], where: str = "") -> int:
    """Return which of the known names is given. Raises HandtrackError for another."""
    check_name(kind, given, known, where)
    return known.index(given)


def listed_names(given: str, known: Sequence[str], what: str = "known") -> str:
    """Return the names that exist, and a question after the one that is most like the given name."""
    from difflib import get_close_matches  # rarely needed, and every command would wait for it

    by_small = {name.lower(): name for name in known}
    near = get_close_matches(str(given).lower(), list(by_small), 1)
    return f"{what}: {', '.join(known)}" + (
        f". Did you mean '{by_small[near[0]]}'?" if near else ""
    )


def not_enough_memory(what: str, error: BaseException) -> HandtrackError:
    """Return the error for what needs more memory than there is. error: what the system or a library said of it."""
    limit = _memory_limit()
    most = "there is" if limit is None else f"the {limit / 1e9:.1f} GB that handtrack may use here"
    said = f" ({error})" if str(error) else ""
    more = "" if limit is None else ", allow it more (`handtrack open --memory GB`)"
    return HandtrackError(
        f"{what} needs more memory than {most}{said}. Close other programs{more}, or use fewer cameras, smaller images or "
        "thinner clouds."
    )


def _memory_limit() -> int | None:
    """Return bytes that this process may use; None where nothing limits them."""
    try:
        import resource
    except ImportError:  # Windows has none
        return None
    limit = resource.getrlimit(resource.RLIMIT_DATA)[0]
    return None if limit == resource.RLIM_INFINITY else limit
