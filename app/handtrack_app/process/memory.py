"""How much memory the engine's process may use: a limit of its own, below the one at which the system ends programs."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from handtrack.errors import HandtrackError

GB = 10**9
LEAST_GB = 1.0
"""tracking the bundled session takes about half of it"""
_SHARE = 0.75
"""of what there is: a quarter is for page, browser and system. Guards such as earlyoom and systemd-oomd end programs at the
last tenth; a refusal that can be told in words is to come before"""
_M_ARENA_MAX = -8  # of glibc's malloc.h
_CONTROL_GROUPS, _OWN_GROUPS = Path("/sys/fs/cgroup"), Path("/proc/self/cgroup")


def memory_limit(asked_gb: float | None = None) -> int:
    """Return bytes that the engine may use: those asked for, else a share of what there is. Raises HandtrackError."""
    if asked_gb is None:
        return max(round(_SHARE * machine_memory()), round(LEAST_GB * GB))
    if not LEAST_GB <= asked_gb < 1e6:
        raise HandtrackError(
            f"--memory {asked_gb:g}: expected gigabytes, at least {LEAST_GB:g}; this machine has "
            f"{machine_memory() / GB:.1f}."
        )
    return round(asked_gb * GB)


def limit_memory(most: int | None) -> None:
    """Let this process have no more bytes, where the system can see to it."""
    if most is None:
        return
    try:
        import resource
    except ImportError:  # Windows has none
        return
    # Private writable memory counts. Of address space (RLIMIT_AS) libraries reserve far more than they use.
    with suppress(ValueError, OSError):  # a lower limit holds already
        resource.setrlimit(
            resource.RLIMIT_DATA, (most, resource.getrlimit(resource.RLIMIT_DATA)[1])
        )


def use_one_arena() -> None:
    """Let all threads of this process allocate from one heap, where the C library is glibc. Before the first thread.

    Else each has its own, and what a page that went has left in it is seldom used again: 300 pages that came and went left
    14 MB in this process, 5 MB with one (bench `soak`).
    """
    with suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).mallopt(_M_ARENA_MAX, 1)


def machine_memory() -> int:
    """Return bytes of memory that this machine, or the container that it is, has."""
    try:
        physical = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):  # Windows: there is no limit to be set either
        physical = 1 << 40
    return min([physical, *_group_limits()])


def _group_limits() -> Iterator[int]:
    """Yield what the control groups of this process, and those above them, allow [bytes]."""
    with suppress(OSError):
        for line in _OWN_GROUPS.read_text().splitlines():
            _, controllers, path = line.split(":", 2)
            if not controllers:
                root, name = _CONTROL_GROUPS, "memory.max"
            elif "memory" in controllers.split(","):  # the first version
                root, name = _CONTROL_GROUPS / "memory", "memory.limit_in_bytes"
            else:
                continue
            own = root / path.strip("/")
            for group in (own, *own.parents):
                with suppress(OSError, ValueError):  # "max"
                    yield int((group / name).read_text())
                if group == root:
                    break
