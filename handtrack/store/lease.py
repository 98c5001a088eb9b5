"""The lease: which program may write to a store. One at a time; who it is can be read, and taking over is a deliberate act.

A lease is a file `lease-000007.json`. Its number is a generation: whoever is to write next makes the next one, which only
one program can. The holder looks before each record whether its file is still there.
"""

from __future__ import annotations

import json
import os
import socket
import tempfile
import time
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import msgspec

from handtrack.errors import HandtrackError

BEAT_S = 5.0
"""how often a holder says that it lives"""
SILENT_S = 60.0
"""a holder on another machine that has not said so for this long is taken for dead"""
_PREFIX = "lease-"


@dataclass(frozen=True)
class Holder:
    """Who holds a lease."""

    generation: int
    program: str
    """such as `handtrack track`"""
    pid: Annotated[int, msgspec.Meta(ge=1, lt=1 << 31)]
    host: str
    machine: str
    """names one running system: a number of a process means something there only"""
    process_started: str
    """by the system's own clock, as it tells a process from a later one of the same number; empty where unknown"""
    since: str
    """local time, for people"""

    def __str__(self) -> str:
        return f"`{self.program}` (process {self.pid} on {self.host}, since {self.since or 'just now'})"


class LeaseTaken(HandtrackError):
    """Another program writes to this store."""


def holder_of(folder: Path) -> Holder | None:
    """Return who holds the lease of a store, None when nobody that lives does."""
    path = _newest(folder)
    if path is None:
        return None
    holder = _read(path)
    return holder if _lives(holder, path) else None


def was_left(folder: Path) -> bool:
    """Return whether a lease lies in a store: its holder lives, or ended without giving it back."""
    return _newest(folder) is not None


class Lease:
    """The right to write to a store, until `release` or until another program takes over."""

    def __init__(self, folder: Path, holder: Holder, handle: int) -> None:
        """Use `Lease.acquire`."""
        self.folder, self.holder = folder, holder
        self._handle = handle  # open as long as it is held: so no later file is taken for it
        self._path = _path(folder, holder.generation)

    @classmethod
    def acquire(cls, folder: Path, program: str, least: int = 1, take_over: bool = False) -> Lease:
        """Return the lease of a folder that exists.

        Raises LeaseTaken, or OSError where nothing can be written.

        Parameters
        ----------
        least
            The generation is at least this; those below have written already.
        take_over
            Even if its holder lives.
        """
        while True:
            before = _newest(folder)
            if before is not None and not take_over:
                holder = _read(before)
                if _lives(holder, before):
                    raise LeaseTaken(
                        f"{folder} is being written to by {holder}, so nothing was changed. Wait for it or end it; or take over "
                        "(give the same command `--take-over`): then it can write no more."
                    )
            generation = max(least, 1 if before is None else _generation(before) + 1)
            pid, now = os.getpid(), time.strftime("%Y-%m-%d %H:%M:%S")
            host, started = socket.gethostname(), _process_start(pid)
            holder = Holder(generation, program, pid, host, _machine(), started, now)
            path = _path(folder, generation)
            try:
                handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o666)
            except FileExistsError:
                continue  # another program was quicker; it is asked again who that is
            try:
                os.write(handle, (json.dumps(asdict(holder), indent=1) + "\n").encode())
                os.fsync(handle)
            except OSError:
                os.close(handle)
                path.unlink()
                raise
            for old in folder.glob(f"{_PREFIX}*.json"):
                if _generation(old) < generation:
                    old.unlink(missing_ok=True)
            return cls(folder, holder, handle)

    @property
    def generation(self) -> int:
        return self.holder.generation

    def check(self) -> None:
        """Raise HandtrackError when this program holds the lease no more."""
        if self._holds():
            return
        other = holder_of(self.folder) if self.folder.is_dir() else None
        if other is not None:
            raise HandtrackError(
                f"{self.folder}: {other} took over, so this change was not saved. What was saved before stands; open the "
                "session again to go on."
            )
        raise HandtrackError(
            f"{self.folder}: the folder was moved or removed, or its lease was, so this change was not saved. Bring the "
            "folder back, and open the session again."
        )

    def beat(self) -> None:
        """Say that the holder lives."""
        with suppress(OSError):
            if self._holds():
                os.utime(self._path)

    def release(self) -> None:
        """Give the lease back."""
        with suppress(OSError):
            if self._holds():
                self._path.unlink()
        os.close(self._handle)

    def _holds(self) -> bool:
        try:
            return os.path.samestat(os.fstat(self._handle), os.stat(self._path))
        except OSError:
            return False


def _path(folder: Path, generation: int) -> Path:
    return folder / f"{_PREFIX}{generation:06d}.json"


def _generation(path: Path) -> int:
    number = path.stem.removeprefix(_PREFIX)
    return int(number) if number.isdecimal() else 0


def _newest(folder: Path) -> Path | None:
    found = [path for path in folder.glob(f"{_PREFIX}*.json") if _generation(path)]
    return max(found, key=_generation, default=None)


def _read(path: Path) -> Holder:
    """Return who wrote a lease; one that is being written, or was torn, tells nothing but its number."""
    try:
        return msgspec.json.decode(path.read_bytes(), type=Holder)
    except (OSError, msgspec.MsgspecError):
        return Holder(_generation(path), "an unknown program", 0, "an unknown host", "", "", "")


def _machine() -> str:
    """Return a name of this running system: host, this start of it, and the namespace of its processes."""
    parts = [socket.gethostname()]
    with suppress(OSError):
        parts.append(Path("/proc/sys/kernel/random/boot_id").read_text().strip())
        parts.append(os.readlink("/proc/self/ns/pid"))
    return " ".join(parts)


def _process_start(pid: int) -> str:
    """Return when a process started, in the system's ticks; empty where that cannot be asked."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return ""
    return stat.rpartition(")")[2].split()[19]


def _lives(holder: Holder, path: Path) -> bool:
    if holder.machine == _machine() and os.name == "posix":
        return _runs(holder)
    silent = SILENT_S if holder.pid else BEAT_S  # without a number it was torn while it was written
    with suppress(OSError):
        return _now_there(path.parent) - path.stat().st_mtime < silent
    return path.exists()


def _runs(holder: Holder) -> bool:
    """Return whether a process of this system still runs, and is not another one of the same number."""
    try:
        os.kill(holder.pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        pass  # another user's
    return holder.process_started in ("", _process_start(holder.pid))


def _now_there(folder: Path) -> float:
    """Return the time by the clock of the folder's disk, which may be another machine's; by ours where it is read-only."""
    try:
        with tempfile.TemporaryFile(dir=folder) as probe:
            return os.fstat(probe.fileno()).st_mtime
    except OSError:
        return time.time()
