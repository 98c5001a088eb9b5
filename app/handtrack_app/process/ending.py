"""How a process ended, and what becomes of the page's work, in words."""

from __future__ import annotations

import re
import signal
from pathlib import Path

from handtrack_app.process.memory import GB
from handtrack_app.protocol.snapshots import Notice

_TAIL = 20_000  # bytes of the log in which the last words of a crash stand, with the stacks of all threads
_MEMORY = re.compile(
    rb"out of memory|bad_alloc|MemoryError|cannot allocate|insufficient memory", re.I
)
_CRASHES = {"SIGSEGV", "SIGBUS", "SIGILL", "SIGFPE", "SIGABRT", "SIGSYS", "SIGTRAP"}


def ending_words(code: int, memory: int | None, log: Path, since: int) -> str:
    """Return how the engine's process ended, in a sentence.

    code: its exit code, or the number of a signal below 0. memory: what it was allowed [bytes]. since: where in the log its
    words begin [bytes]; what ended one before it does not count.
    """
    limit = "" if memory is None else f" It may use {memory / GB:.1f} GB (--memory)."
    name = _signal_name(-code) if code < 0 else ""
    if name == "SIGKILL":
        return f"The engine was ended from outside (SIGKILL), as the system does when memory runs out.{limit}"
    if name in _CRASHES or code > 0:
        how = f"crashed ({name})" if name else f"ended with exit code {code}"
        if _MEMORY.search(_tail(log, since)):
            return f"The engine {how}, for want of memory.{limit}"
        return f"The engine {how}, a mistake in handtrack or in a library."
    if code == 0:
        return "The engine was asked to end (SIGTERM), by a person or by a guard of the memory."
    return f"The engine was ended from outside ({name})."


def again_notice(
    how: str,
    stopped_at: int | None,
    job: str,
    recording: str,
    edits: str,
    given_up: str,
    log: Path,
) -> Notice:
    """Return what the user is told when the engine begins again.

    stopped_at: the frame tracked last, if it tracked; job: what it was at; recording: the folder that running cameras were recorded
    to; edits: what is not on disk yet, and made again; given_up: what is not.
    """
    text = f"{how} It begins again from the disk."
    text += f" Not on disk yet, and done again now: {edits}." if edits else ""
    text += f" Given up: {given_up}." if given_up else ""
    if stopped_at is not None:
        text += f" Tracking stopped at frame {stopped_at}; there, 'From here' (tab Track) goes on."
    elif job and job != "tracking":
        text += f" What ran was cut off ({job}); begin it again."
    if recording:
        text += f" The recording in {recording} was cut off: its videos are there, its session.toml is not."
    return Notice("error", "The engine was ended", f"{text} Details: {log}")


def down_notice(how: str, times: int, edits: str, given_up: str, log: Path) -> Notice:
    """Return what the user is told when the engine stays ended. edits: what is not on disk; given_up: what is not done again."""
    often = f" That was {times} times within a minute." if times > 1 else ""
    waits = f" Not on disk yet: {edits}; done again then." if edits else ""
    lost = f" Given up: {given_up}." if given_up else ""
    return Notice(
        "error",
        "The engine stays ended",
        f"{how}{often} It does not begin again by itself: 'Start again' (at the top) opens what is on disk.{waits}{lost} Details: {log}",
    )


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


def _tail(log: Path, since: int) -> bytes:
    try:
        with log.open("rb") as file:
            file.seek(max(since, log.stat().st_size - _TAIL))
            return file.read()
    except OSError:
        return b""
