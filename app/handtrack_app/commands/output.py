"""Files and folders that a command writes: checked before anything is computed, made whole or not at all."""

from __future__ import annotations

import json
import os
import signal
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, closing, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from tqdm import tqdm

from handtrack.errors import HandtrackError
from handtrack.files.atomic import filling
from handtrack_app.engine.compile_watch import CompileWatch

if TYPE_CHECKING:
    from handtrack.tracking.frame.control import Observer


def output_file(
    out: Path,
    suffixes: tuple[str, ...],
    what: str,
    makes_folders: bool = False,
    option: str = "--out",
) -> Path:
    """Return the file, which can be written. Raises HandtrackError; writes nothing.

    what: a few words for the error, such as `results are`. A device, such as /dev/stdout, may have any name.
    """
    if out.exists() and not out.is_file() and not out.is_dir():
        return out
    if out.suffix.lower() not in suffixes:
        raise HandtrackError(
            f"{option} {out}: {what} {' or '.join(suffixes)} files; expected such a name."
        )
    if out.is_dir():
        raise HandtrackError(f"{option} {out}: that is a folder; expected the name of a file.")
    if not (makes_folders or out.parent.exists()):
        raise HandtrackError(f"{option} {out}: cannot be written: there is no folder {out.parent}.")
    standing = next(path for path in (out.parent, *out.parent.resolve().parents) if path.exists())
    try:
        handle, name = tempfile.mkstemp(dir=standing, prefix=".handtrack_", suffix=".part")
        os.close(handle)
        os.unlink(name)
    except OSError as error:
        raise HandtrackError(
            f"{out}: cannot be written: {standing}: {error.strerror}. Nothing was done; name another place with {option}."
        ) from None
    return out


def check_new(folder: Path, option: str = "--out") -> None:
    """Raise HandtrackError unless a folder can be made at `folder`: nothing there, or an empty folder."""
    if folder.exists() and not folder.is_dir():
        raise HandtrackError(
            f"{option} {folder} is a file; nothing was written. Name a new folder with {option}."
        )
    if folder.is_dir() and any(folder.iterdir()):
        raise HandtrackError(
            f"{option} {folder} is not empty; nothing was written. Name a new folder with {option}."
        )


@contextmanager
def new_folder(folder: Path) -> Iterator[Path]:
    """Give a folder to fill; it becomes `folder` when the block ends well, and goes otherwise.

    Raises HandtrackError when something is there already, or nothing can be written there.
    """
    check_new(folder)
    target = folder.resolve()
    made = [path for path in target.parents if not path.exists()]  # the innermost first
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with filling(target) as part:
            yield part
        made = []
    except OSError as error:
        raise HandtrackError(
            f"--out {folder}: writing there failed ({error.strerror or error}); nothing was kept. "
            "Name another folder with --out."
        ) from None
    finally:
        for parent in made:
            with suppress(OSError):
                parent.rmdir()


# ---- What a command answers: a sentence or two for people, or one JSON object for programs


class Answer(NamedTuple):
    """What a command returns, to be printed. Notes go to stderr (`note`)."""

    report: Mapping[str, object]
    """for programs: one object of JSON"""
    lines: Sequence[str]
    """for people"""
    code: int = 0
    """the exit code"""

    def print(self, as_json: bool) -> int:
        """Print it on stdout; return the exit code. as_json: `--json` was given."""
        text = json.dumps(self.report, indent=1, default=str) if as_json else "\n".join(self.lines)
        if text:
            print(text, flush=True)
        return self.code


# ---- Questions to whoever sits at the terminal; where nobody does, nothing is asked


def can_ask() -> bool:
    """Return whether both ends are a terminal, so that somebody can read the question and answer it."""
    return sys.stdin.isatty() and sys.stderr.isatty()


def question(text: str, proposal: str) -> str:
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


INTERRUPTED = 130
"""exit code after Ctrl-C"""


# ---- Progress with ETA on stderr, what is compiled, and a Ctrl-C that stops cleanly


_SIGNALS = [getattr(signal, n) for n in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, n)]


def progress_bar(total: float, what: str, **how: Any) -> tqdm:
    """Return a bar of frames on stderr, drawn anew every few seconds where that is no terminal. how: otherwise, as of tqdm."""
    interval_s = 0.2 if sys.stderr.isatty() else 5.0
    how = {"unit": "frame", "mininterval": interval_s, "dynamic_ncols": True, **how}
    return tqdm(total=total, desc=what, **how)


@contextmanager
def share_bar(what: str) -> Iterator[Observer]:
    """Give what shows how far something without frames is; the bar comes with the first share."""
    from handtrack.tracking.frame.control import Observer  # slow to import

    bars: list[tqdm] = []

    class Bar(Observer):
        def progress(self, share: float, words: str = "", stage: str = "") -> None:
            if not bars:
                shape = "{desc}: {percentage:3.0f}%|{bar}| {elapsed}<{remaining}{postfix}"
                bars.append(progress_bar(1.0, what, bar_format=shape))
            bars[0].set_postfix_str(words, refresh=False)
            bars[0].update(share - bars[0].n)

    try:
        yield Bar()
    finally:
        for bar in bars:
            bar.close()


def print_status(text: str) -> None:
    """Print a line about what goes on, on stderr."""
    print(text, file=sys.stderr, flush=True)


def note(*texts: str) -> None:
    """Print what is to be known beside the answer, on stderr, each once."""
    for text in dict.fromkeys(texts):
        print_status(f"note: {text}")


class Stop:
    """Whether the user or the system wants this program to stop; called, it answers. Set by `stoppable`."""

    def __init__(self) -> None:
        self.asked = False
        self.shielded = False
        """while true, no Ctrl-C breaks in: results are being saved"""

    def __call__(self) -> bool:
        return self.asked

    @property
    def code(self) -> int:
        """The exit code of a command that did all it could."""
        return INTERRUPTED if self.asked else 0

    def interrupt(self, *_: object) -> None:
        """Handle one Ctrl-C, or a signal that stands for it."""
        if self.asked and not self.shielded:
            raise KeyboardInterrupt
        if not self.asked:
            with suppress(OSError):  # the terminal may have been closed
                # print is not safe in a handler
                os.write(2, b"\nstopping ... (Ctrl-C again: at once)\n")
        self.asked = True


@contextmanager
def stoppable() -> Iterator[Stop]:
    """Give a Stop that turns true at the first Ctrl-C; the second one raises KeyboardInterrupt at once.

    So do SIGTERM (`timeout`, a cluster's scheduler, a container that is stopped) and SIGHUP (a terminal that is closed).
    """
    stop = Stop()
    before = {number: signal.getsignal(number) for number in _SIGNALS}
    for number, handler in before.items():
        if handler is not signal.SIG_IGN or number == signal.SIGINT:  # `nohup` ignores SIGHUP
            signal.signal(number, stop.interrupt)
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def saying_compiling() -> AbstractContextManager[object]:
    """Within the block, say once that kernels are compiled, if any are: that takes a while, the first time."""
    words = "compiling kernels for this machine; only the first time, about half a minute …"
    watch = CompileWatch(lambda _: print_status(words) if watch.count == 1 else None)
    return closing(watch)
