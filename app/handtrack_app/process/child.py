"""The engine's own process: calls come in by a pipe, snapshots go out by it.

It ends when it is asked to, when whoever started it is gone, and on SIGTERM: each time what was accepted is on disk and
the session free for others. What it or a library prints goes to the log."""

from __future__ import annotations

import ctypes
import faulthandler
import logging
import multiprocessing
import os
import pickle
import signal
import threading
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any

from handtrack.errors import HandtrackError

if TYPE_CHECKING:
    from handtrack_app.engine.worker import Opener


@dataclass(frozen=True)
class EnginePlan:
    """What to open, and how."""

    folder: Path
    live: LiveOptions | None = None
    """track running cameras by the folder's settings"""
    rerun: bool = False
    """stream what is tracked to rerun's viewer"""
    take_over: bool = False
    """write, even if another program does"""
    opener: Opener | None = None
    """what opens the folder instead; a module's function, where it is for another process"""
    memory: int | None = None
    """bytes that the engine's process may use; None: no limit"""
    preview: bool = True
    """show what can be shown at once before the session can be worked in"""
    version: int = 0
    """of the user's edits so far"""
    page: str = ""
    """whose numbers the commands have: an engine that begins again finds on disk up to which they are done"""


# ---- What the command line says of a live source; light to import


@dataclass(frozen=True)
class LiveOptions:
    """How running cameras are opened."""

    devices: Mapping[str, str]
    """by camera; none: 0, 1, 2 … in the session's order"""
    tolerance_s: float
    """how far apart the images of one frame may be"""
    record: Path | None = None
    """a new folder to record to from the start"""
    rate: float = 1.0
    """how many times faster than their pace video files are played, to measure by"""


# ---- How much memory the engine's process may use


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


# ---- The engine's own process. By its pipe come first the plan, then calls (name, arguments, number), at last how long each of its
# threads has to end [s]; out go first its commands (a dict), then snapshots, at last what is to be said (a list)


_ALONE_S = 15.0  # for each thread to end when nobody says how long: a recording of running cameras is completed
_GOING_S = 2.0  # between the end of its pipe and its own
_LARGEST_LOG = 1_000_000  # bytes; a larger one makes room when an engine begins


class EngineChild:
    """A started process as the one that started it sees it. It imports what the engine needs at once; its plan may come later."""

    def __init__(self, log: Path) -> None:
        """Start it. log: takes what it prints, its tracebacks and those of crashes."""
        with suppress(OSError):  # another user's file
            log.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            if log.is_file() and log.stat().st_size > _LARGEST_LOG:
                log.replace(log.with_name(f"{log.name}.1"))
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._sending, self._is_over = threading.Lock(), False
        self._process = context.Process(target=serve, args=(theirs, log), daemon=True)
        safe = os.environ.get("PYTHONSAFEPATH")
        os.environ["PYTHONSAFEPATH"] = (
            "1"  # nothing is imported from the folder that the user happens to be in
        )
        try:
            self._process.start()
        finally:
            os.environ.pop("PYTHONSAFEPATH")
            if safe is not None:
                os.environ["PYTHONSAFEPATH"] = safe
        theirs.close()
        self.pid = self._process.pid

    def send(self, message: object) -> None:
        """Hand over a message, waiting while the pipe is full; to one that ended, nothing."""
        with suppress(OSError, ValueError), self._sending:
            self._pipe.send(message)

    def listen(self, take: Callable[[Any], None]) -> int:
        """Hand over its messages as they come, until it ended; return its exit code, or the signal's number below 0."""
        with suppress(EOFError, OSError, pickle.UnpicklingError):  # gone, or torn while it was sent
            while True:
                take(self._pipe.recv())
        self._process.join(_GOING_S)
        self.kill()
        return self._process.exitcode or 0

    def kill(self) -> None:
        """End it at once, and what it started. Until its end was waited for, its lease would look alive."""
        if self._is_over:
            return
        self._is_over = True  # its number may be another's from now on
        if os.name == "posix" and self.pid is not None:
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(self.pid, signal.SIGKILL)
        self._process.kill()
        self._process.join()
        self._pipe.close()


def serve(pipe: Connection, log: Path) -> None:
    """Be the engine: serve one plan until the end."""
    for name in ("SIGINT", "SIGHUP"):  # whoever started it is told, and says what is to be done
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    if os.name == "posix":
        os.setpgid(0, 0)  # what it starts can be ended with it
    _print_to(log)
    faulthandler.enable()
    logging.basicConfig(format="%(asctime)s %(name)s %(levelname)s %(message)s", force=True)
    code = 1
    try:
        _serve(pipe)
        code = 0
    except EOFError:  # whoever started it is gone
        code = 0
    except BaseException:
        logging.getLogger(__name__).exception("the engine ended")
    logging.shutdown()
    os._exit(code)  # threads may still be in compiled code, where an orderly end is none


def _serve(pipe: Connection) -> None:
    from handtrack_app.engine.open_session import COMMANDS  # seconds, if all is compiled
    from handtrack_app.engine.worker import Worker
    from handtrack_app.protocol import Call, Opened

    sending, asked, waits = threading.Lock(), threading.Event(), [_ALONE_S]

    def publish(message: object) -> None:
        if isinstance(message, Opened):
            message = replace(message, failure=_portable(message.failure))
        try:
            with sending:
                pipe.send(message)
        except OSError:  # nobody listens any more; `listen` sees that too
            pass
        except MemoryError:  # the next one may be smaller
            logging.getLogger(__name__).exception("could not send %s", type(message).__name__)

    publish(COMMANDS)
    plan = pipe.recv()
    assert isinstance(plan, EnginePlan)
    limit_memory(plan.memory)
    engine = Worker(plan, publish)
    # on a thread: what the handler breaks into may be the wait itself, with its lock held
    signal.signal(signal.SIGTERM, lambda *_: threading.Thread(target=asked.set).start())

    def listen() -> None:
        with suppress(EOFError, OSError, pickle.UnpicklingError):
            while isinstance(message := pipe.recv(), tuple):
                name, arguments, number = message
                engine.send(Call(name, arguments, COMMANDS[name], number))
            waits[0] = message
        asked.set()

    threading.Thread(target=listen, name="listen", daemon=True).start()
    engine.start()
    while not asked.wait(1.0):  # on some systems a signal is handled between two waits only
        pass
    engine.stop(waits[0])
    publish(engine.last_words)


def _print_to(log: Path) -> None:
    try:
        printed = os.open(log, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o600)
    except OSError:
        printed = os.open(os.devnull, os.O_WRONLY)
    for number in (1, 2):
        os.dup2(printed, number)
    os.close(printed)


def _portable(error: Exception | None) -> Exception | None:
    """Return an error, or one with the same words that another process can take."""
    if error is not None and not isinstance(error, HandtrackError):
        error.add_note(
            "".join(traceback.format_exception(error))
        )  # of a mistake: where it was made
    try:
        return pickle.loads(pickle.dumps(error))
    except Exception:  # whatever an error is made of
        if isinstance(error, HandtrackError):
            return HandtrackError(str(error))
        return RuntimeError(f"{type(error).__name__}: {error}")
