"""The engine's own process: `python -m handtrack_app.process.child`, its commands on stdin, its snapshots on stdout.

It ends when it is asked to, when whoever started it is gone, and on SIGTERM: each time what was accepted is on disk and
the session free for others. What it or a library prints goes where its stderr leads: to the log.
"""

from __future__ import annotations

import faulthandler
import logging
import os
import pickle
import signal
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING

from handtrack.errors import HandtrackError
from handtrack_app.process.channel import Channel, Ended, FromEngine, Opened, Shown, Stop
from handtrack_app.process.memory import limit_memory
from handtrack_app.process.plan import EnginePlan
from handtrack_app.protocol.mailbox import Mailbox

if TYPE_CHECKING:
    from handtrack_app.process.engine_thread import EngineThread

log = logging.getLogger(__name__)
_ALONE_S = 15.0  # for each thread to end when nobody says how long: a recording of running cameras is completed


class EngineEnd:
    """Waits for the reason to end."""

    def __init__(self) -> None:
        self.timeout = _ALONE_S
        self._why = threading.Event()

    def come(self, timeout: float = _ALONE_S) -> None:
        """There is a reason. timeout: for each thread to end [s]."""
        self.timeout = timeout
        self._why.set()

    def wait(self) -> None:
        while not self._why.wait(1.0):  # on some systems a signal is handled between two waits only
            pass


def main() -> int:
    """Serve one plan until the end."""
    for name in ("SIGINT", "SIGHUP"):  # whoever started it is told, and says what is to be done
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    channel = _own_channel()
    faulthandler.enable()
    logging.basicConfig(format="%(asctime)s %(name)s %(levelname)s %(message)s")
    from handtrack_app.process.engine_thread import EngineThread  # seconds, if all is compiled
    from handtrack_app.protocol.snapshots import kind_of

    try:
        plan = channel.receive()
    except EOFError:
        return 0
    assert isinstance(plan, EnginePlan)
    limit_memory(plan.memory)
    end, outbox = EngineEnd(), Mailbox["FromEngine"](kind_of)
    # on a thread: what the handler breaks into may be the wait itself, with its lock held
    signal.signal(signal.SIGTERM, lambda *_: threading.Thread(target=end.come).start())
    engine = EngineThread(plan, outbox.put)
    told = threading.Thread(target=_tell, args=(channel, outbox), name="tell", daemon=True)
    for thread in (
        told,
        threading.Thread(target=_listen, args=(channel, engine, end), name="listen", daemon=True),
        threading.Thread(target=_say_opened, args=(engine, outbox.put), name="say", daemon=True),
    ):
        thread.start()
    engine.start()
    end.wait()
    engine.stop(end.timeout)
    outbox.put(Ended(tuple(engine.last_words)))
    told.join(_ALONE_S)
    return 0


def _own_channel() -> Channel:
    """Take stdin and stdout away from everybody else."""
    incoming, outgoing = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    os.dup2(2, 1)
    return Channel(incoming, outgoing)


def _listen(channel: Channel, engine: EngineThread, end: EngineEnd) -> None:
    try:
        while True:
            message = channel.receive()
            if isinstance(message, Stop):
                end.come(message.timeout)
            else:
                engine.send(message)
    except EOFError:
        end.come()


def _tell(channel: Channel, outbox: Mailbox[FromEngine]) -> None:
    message = None
    while not isinstance(message, Ended):
        message = outbox.take()
        try:
            channel.send(message)
        except OSError:  # nobody listens any more; `_listen` sees that too
            return
        except MemoryError:  # the next one may be smaller
            log.exception("could not tell %s", type(message).__name__)


def _say_opened(engine: EngineThread, put: Callable[[FromEngine], None]) -> None:
    failure = engine.wait_shown(threading.TIMEOUT_MAX)
    put(Shown(_portable(failure)))
    put(Opened(_portable(engine.wait_opened(None))))


def _portable(error: Exception | None) -> Exception | None:
    """Return an error, or one with the same words that another process can take."""
    try:
        return pickle.loads(pickle.dumps(error))
    except Exception:  # whatever an error is made of
        if isinstance(error, HandtrackError):
            return HandtrackError(str(error))
        return RuntimeError(f"{type(error).__name__}: {error}")


if __name__ == "__main__":
    code = main()
    logging.shutdown()
    os._exit(code)  # threads may still be in compiled code, where an orderly end is none
