"""`handtrack batch`: many recordings, one process each, gone on with where it was left."""

from __future__ import annotations

import csv
import glob
import io
import json
import os
import shlex
import signal
import subprocess
import sys
import threading
import time
from argparse import Namespace
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    Executor,
    Future,
    ThreadPoolExecutor,
    wait,
)
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from functools import partial
from hashlib import blake2b
from html import escape
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import msgspec
import numpy as np
from tqdm import tqdm

from handtrack.errors import HandtrackError
from handtrack.files.atomic import replace_text, sync_folder
from handtrack.parallel import thread_count
from handtrack.session.layout import POSES_FILE, SESSION_FILE, TRACKS_FOLDER
from handtrack.session.session import Session
from handtrack.session.takes import files_read, versions_in_use
from handtrack_app.commands.output import Answer, print_status, progress_bar, stoppable

LEDGER_FILE = "ledger.jsonl"
_MADE = {TRACKS_FOLDER, "versions"}
"""folders of a session that tracking writes: they are no input"""


def recordings(patterns: Sequence[str], words: Sequence[str], out: Path) -> list[Outcome]:
    """Return the recordings that patterns name, each once and as begun, in order of their paths.

    A pattern is a session folder, its session.toml, or either with * ? [ ] and **. words: how `track` is asked. A folder
    without session.toml is a recording too, and will be refused by name. Raises HandtrackError where a pattern matches nothing.
    """
    folders: dict[Path, None] = {}
    for pattern in patterns:
        paths = [Path(p) for p in sorted(glob.glob(os.path.expanduser(pattern), recursive=True))]
        named = [path.parent if path.name == SESSION_FILE else path for path in paths]
        found = [folder.resolve() for folder in named if folder.is_dir()]
        found = [f for f in found if f != out and not (f / LEDGER_FILE).is_file()]
        if not found:
            raise HandtrackError(
                f"{pattern}: no session folder matches; expected folders with a {SESSION_FILE}, such as 'recordings/*', or "
                f"'recordings/**/{SESSION_FILE}' for all below a folder."
            )
        folders |= dict.fromkeys(found)
    ordered = sorted(folders)
    asked = [*words, *(f"{name} {version}" for name, version in sorted(versions_in_use().items()))]
    names = _names(ordered)
    return [Outcome(n, str(f), _digest(*asked, *_inputs(f))) for n, f in zip(names, ordered, strict=True)]  # fmt: skip


def _names(folders: Sequence[Path]) -> list[str]:
    """Return a file name for each folder: its path below what all share."""
    above = Path(os.path.commonpath([folder.parent for folder in folders])) if folders else Path()
    names = ["__".join(folder.relative_to(above).parts) for folder in folders]
    twice = {name for name in names if names.count(name) > 1}
    return [f"{n}-{_digest(str(f))[:6]}" if n in twice else n for n, f in zip(names, folders, strict=True)]  # fmt: skip


def _inputs(folder: Path) -> list[str]:
    """Return what stands for everything that is read of a session: contents of small files, sizes and times of large ones."""
    small = sorted(p for p in folder.iterdir() if p.suffix in (".toml", ".json", ".csv", ".npz") and p.is_file())  # fmt: skip
    report = [f"{path.name} {_digest(path.read_bytes())}" for path in small if path.stat().st_size < 1 << 20]  # fmt: skip
    try:
        read = files_read(Session.open(folder))
        return [*report, *(f"{what} {digest}" for what, digest in sorted(read.items()))]
    except (HandtrackError, OSError):  # it will be refused; again, as long as nothing in it changes
        return [*report, *_listing(folder)]


def _listing(folder: Path) -> list[str]:
    rows = []
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder)
        if name.parts[0] not in _MADE and not path.is_dir():
            stat = path.lstat()
            rows.append(f"{name} {stat.st_size} {stat.st_mtime_ns}")
    return rows


def _digest(*parts: str | bytes) -> str:
    total = blake2b(digest_size=16)
    for part in parts:
        total.update(part.encode() if isinstance(part, str) else part)
        total.update(b"\0")
    return total.hexdigest()


# ---- How one recording ended, and the ledger of all: one line of JSON each, appended whole


DONE, REFUSED, FAILED, INTERRUPTED, STARTED = "done", "refused", "failed", "interrupted", "started"
"""states: tracked to the end; bad input, which the same input would be again; ended otherwise; stopped; begun"""


@dataclass(frozen=True)
class Outcome:
    """What became of a recording."""

    recording: str
    """name of its files in the output folder; each differs"""
    folder: str
    digest: str
    """of what is read of it, what was asked for, and the versions that do it: the same digest gives the same bytes"""
    state: str = STARTED
    exit_code: int | None = None
    seconds: float = 0.0
    frames: Mapping[str, int] = field(default_factory=dict)
    """by status"""
    p_off: float | None = None
    """mean over frames of the probability that some joint is more than 25 mm off; None where nothing is said"""
    warnings: list[str] = field(default_factory=list)
    cause: str = ""
    """why it was refused or failed"""
    output: str = ""
    ended: str = ""
    """when, ISO 8601, UTC"""

    @property
    def is_ended(self) -> bool:
        """Whether the same inputs would end the same way, so that nothing is to be done again."""
        return (self.state == DONE and Path(self.output).is_file()) or self.state == REFUSED

    @property
    def total(self) -> int:
        """How many frames were tracked, whatever came of them."""
        return sum(self.frames.values())

    def share(self, *statuses: str) -> float:
        """Return the share of frames of some statuses; 0 where there are none."""
        return sum(self.frames.get(status, 0) for status in statuses) / max(self.total, 1)

    @property
    def badness(self) -> tuple[float, ...]:
        """What reports are sorted by, worst first: what has no result; then lost frames, doubtful ones, doubt."""
        rank = {FAILED: 4, STARTED: 3, INTERRUPTED: 3, REFUSED: 2}.get(self.state, 0)
        return (rank, self.share("lost"), self.share("doubtful"), self.p_off or 0.0)


def read_ledger(file: Path) -> list[Outcome]:
    """Return what a ledger says, in its order; a line that was torn by a crash, or is nobody's, is left out."""
    results = list[Outcome]()
    for line in file.read_bytes().splitlines() if file.is_file() else ():
        with suppress(msgspec.MsgspecError):
            results.append(msgspec.json.decode(line, type=Outcome))
    return results


def latest(outcomes: list[Outcome]) -> dict[str, Outcome]:
    """Return the last outcome of each recording folder; a start counts where nothing came after it."""
    return {outcome.folder: outcome for outcome in outcomes}


def append(file: Path, outcome: Outcome) -> None:
    """Append a line, whole and on disk when this returns. Several programs may append to one file.

    A line that was torn before, by a full disk or a lost machine, is closed first.
    """
    line = json.dumps(asdict(outcome), ensure_ascii=False, sort_keys=True).encode() + b"\n"
    new = not file.exists()
    handle = os.open(file, os.O_RDWR | os.O_APPEND | os.O_CREAT, 0o666)
    try:
        size = os.fstat(handle).st_size
        if size and os.pread(handle, 1, size - 1) != b"\n":
            line = b"\n" + line
        os.write(handle, line)
        os.fsync(handle)
    finally:
        os.close(handle)
    if new:
        sync_folder(file.parent)


# ---- Tracks one recording in a process of its own, by the command that a person would give


_CHILD = "handtrack_app.commands.batch_child"
_CHILD_POLL_S = 0.2
_STOPPED = 130  # as after Ctrl-C
_STATES = {0: DONE, 2: REFUSED, _STOPPED: INTERRUPTED}
_HELD = "is being written to by"
"""in the sentence of a session that another program writes to; that may end"""
_OF_SIGNALS = {9: ": by the system when memory ran out, or by a user"}
_LONGEST = 20
"""lines of a log that are looked at for the cause"""


def track_one(
    words: Sequence[str],
    out: Path,
    threads: int,
    recording: Outcome,
    should_stop: Callable[[], bool] = lambda: False,
) -> Outcome:
    """Return how `handtrack track FOLDER …` ended; its log is a file in the output folder.

    words: the options. threads: that it may use. should_stop: asked all the time; then it is told to stop as by Ctrl-C.
    """
    began = time.monotonic()
    log = out / "logs" / f"{recording.recording}.log"
    log.parent.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, "-m", _CHILD, "track", recording.folder, *words, "--json"]
    where = os.pathsep.join(path for path in sys.path if path)
    environment = os.environ | {"HANDTRACK_THREADS": str(threads), "PYTHONPATH": where}
    with log.open("wb") as errors, TemporaryFile() as message:
        child = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=message, stderr=errors, env=environment)  # fmt: skip
        asked = False
        while child.poll() is None:
            if should_stop() and not asked:
                asked = True
                with suppress(OSError):
                    child.terminate()  # as Ctrl-C: it saves what it has
            with suppress(subprocess.TimeoutExpired):
                child.wait(_CHILD_POLL_S)
        if child.stdin is not None:
            child.stdin.close()
        message.seek(0)
        text = message.read().decode(errors="replace")
    # told to stop before it could listen: it has saved nothing, for it had begun nothing
    code = _STOPPED if asked and child.returncode == -signal.SIGTERM else child.returncode
    report = {}
    with suppress(ValueError):
        report = json.loads(text)
    state = _STATES.get(code, FAILED)
    cause = "" if code == 0 else _cause(log, code).removeprefix(f"{recording.folder}: ")
    if state == REFUSED and _HELD in cause:
        state = FAILED
    return replace(
        recording, state=state, exit_code=code, seconds=round(time.monotonic() - began, 3), frames=report.get("frames", {}),
        p_off=_p_off(Path(recording.folder) / POSES_FILE) if code == 0 else None,
        warnings=report.get("warnings", []), cause=cause, output=str(report.get("output", "")),
        ended=_now(),
    )  # fmt: skip


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


def _cause(log: Path, code: int) -> str:
    """Return what the program said last, in one line."""
    if code < 0:
        return f"it was ended by signal {-code}{_OF_SIGNALS.get(-code, '')}"
    lines = log.read_text(errors="replace").splitlines()[-_LONGEST:]
    said = [line for line in lines if line.startswith("handtrack track: ")]
    return (said or lines or ["no output"])[-1].removeprefix("handtrack track: ")


def _p_off(file: Path) -> float | None:
    try:
        with np.load(file) as poses:
            chance = poses["p_off_25mm"]
    except (OSError, KeyError, ValueError):
        return None
    known = chance[np.isfinite(chance)]
    return float(known.mean().round(4)) if len(known) else None


# ---- Where recordings are tracked: so many at once on this machine, or on a dask cluster


_POLL_S = 0.5
_RETRIES = 2
"""of a recording whose dask worker was lost"""


Track = Callable[[Outcome, Callable[[], bool]], Outcome]
"""tracks a recording, until it is to stop"""


def track_all(
    pool: Executor, over: Any, todo: Sequence[Outcome], track_it: Track, should_stop: Callable[[], bool]
) -> Iterator[Outcome]:  # fmt: skip
    """Yield outcomes as they come. Once it is to stop, `over` is set: what runs is stopped, and the others are not begun.

    over: an event that all hear that work for the pool.
    """
    left = {pool.submit(_tracked, one, track_it, over): one for one in todo}
    while left:
        if should_stop():
            over.set()
        for future in wait(left, _POLL_S, FIRST_COMPLETED).done:
            outcome = _ended(future, left.pop(future))
            if outcome is not None:
                yield outcome


def _tracked(one: Outcome, track_it: Track, over: Any) -> Outcome | None:
    """Return how a recording's tracking ended; None where nothing is to be begun any more."""
    return None if over.is_set() else track_it(one, over.is_set)


def _ended(future: Future[Outcome | None], one: Outcome) -> Outcome | None:
    """Return the outcome of a recording; a failed one where its worker was lost too often, or cannot run handtrack."""
    try:
        return future.result()
    except Exception as error:
        cause = f"{type(error).__name__}: {error}"
    return replace(one, state=FAILED, cause=cause, ended=_now())


@contextmanager
def on_dask(address: str) -> Iterator[tuple[Executor, Any]]:
    """Give the workers of a dask cluster, which see the same folders and have handtrack installed, and an event that they hear.

    Raises HandtrackError where dask.distributed is not installed, or nobody answers at the address.
    """
    try:
        dask = import_module("dask.distributed")
    except ImportError:
        raise HandtrackError(
            "--dask: dask.distributed is not installed: `pip install distributed`, or handtrack with the extra `cluster`. "
            "--jobs N works without it, on this machine."
        ) from None
    try:
        client = dask.Client(address, timeout=20)
    except (OSError, TimeoutError, ValueError) as error:
        raise HandtrackError(
            f"--dask {address}: no scheduler answers there ({error}); expected an address as `dask scheduler` prints it, such "
            "as tcp://node1:8786."
        ) from None
    with client:
        yield client.get_executor(pure=False, retries=_RETRIES), dask.Event()


# ---- What became of all recordings, worst first: report.html to look at, report.csv to count with


_COLUMNS = (
    "recording", "state", "frames", "tracked", "doubtful", "lost", "keyframe", "p_off_25mm", "seconds",
    "cause", "warnings", "folder", "output", "open",
)  # fmt: skip
_STYLE = """
:root { color-scheme: light dark; font: 15px/1.45 system-ui, sans-serif }
body { margin: 2rem auto; max-width: 78rem; padding: 0 1rem }
h1 { font-size: 1.4rem; margin: 0 0 .3rem } p { margin: .3rem 0 1rem }
input { font: inherit; padding: .35rem .6rem; width: 22rem; max-width: 100% }
table { border-collapse: collapse; width: 100%; margin-top: 1rem }
th { text-align: left; font-weight: 600; border-bottom: 2px solid #8888; padding: .3rem .6rem }
td { border-bottom: 1px solid #8884; padding: .45rem .6rem; vertical-align: top }
td.number { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap }
.bar { display: flex; width: 8rem; height: .8rem; border-radius: 2px; overflow: hidden; background: #8883; margin-top: .3rem }
.tracked { background: #2b9348 } .doubtful { background: #e9a100 } .lost { background: #d00000 }
.state { font-weight: 600 } .failed, .refused { color: #d00000 } .interrupted, .started { color: #b57a00 }
.cause { overflow-wrap: anywhere } details { color: #777 } small { color: #777 }
button { font: inherit; padding: .15rem .6rem; cursor: pointer }
code { font-size: .85em; overflow-wrap: anywhere }
"""
_SCRIPT = """
for (const button of document.querySelectorAll("button")) button.onclick = async () => {
  try { await navigator.clipboard.writeText(button.dataset.command); }
  catch { const area = document.createElement("textarea"); area.value = button.dataset.command;
          document.body.append(area); area.select(); document.execCommand("copy"); area.remove(); }
  button.textContent = "copied"; setTimeout(() => button.textContent = "copy", 1500);
};
document.querySelector("input").oninput = event => {
  const wanted = event.target.value.toLowerCase();
  for (const row of document.querySelectorAll("tbody tr")) row.hidden = !row.textContent.toLowerCase().includes(wanted);
};
"""


def write_report(out: Path, outcomes: Sequence[Outcome]) -> None:
    """Write report.html and report.csv into a folder, the worst recording first."""
    rows = sorted(outcomes, key=lambda o: (tuple(-b for b in o.badness), o.recording))
    replace_text(out / "report.csv", _csv(rows))
    replace_text(out / "report.html", _html(rows))


def in_words(outcomes: Sequence[Outcome]) -> str:
    """Return how many recordings ended how, and how many frames came of them."""
    states = [outcome.state for outcome in outcomes]
    counts = ", ".join(f"{states.count(state)} {state}" for state in sorted(set(states)))
    total = sum(outcome.total for outcome in outcomes)
    lost = sum(outcome.frames.get("lost", 0) for outcome in outcomes)
    doubtful = sum(outcome.frames.get("doubtful", 0) for outcome in outcomes)
    return f"{len(states)} recordings: {counts}; {total} frames, {doubtful} of low confidence, {lost} lost"


def open_command(outcome: Outcome) -> str:
    """Return the command that opens a recording in the workbench."""
    return f"handtrack open {shlex.quote(outcome.folder)}"


def _csv(rows: Sequence[Outcome]) -> str:
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(_COLUMNS)
    for row in rows:
        counts = [row.frames.get(name, 0) for name in _COLUMNS[3:7]]
        table.writerow(
            [row.recording, row.state, row.total, *counts, row.p_off, row.seconds, row.cause, " | ".join(row.warnings),
             row.folder, row.output, open_command(row)]
        )  # fmt: skip
    return text.getvalue()


def _html(rows: Sequence[Outcome]) -> str:
    body = "\n".join(map(_row, rows))
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>handtrack batch</title><style>{_STYLE}</style></head><body>
<h1>handtrack batch</h1><p>{escape(in_words(rows))}. The worst first: those without a result, then by lost frames, those of low confidence, and
the probability of large errors.</p>
<input placeholder="show only those with …" aria-label="show only those with">
<table><thead><tr><th>recording</th><th>frames</th><th>lost</th><th>low confidence</th><th title="mean probability that a joint's
error exceeds 25 mm">P(error)</th><th>s</th><th>notes</th><th>workbench</th></tr></thead>
<tbody>
{body}
</tbody></table><script>{_SCRIPT}</script></body></html>
"""


def _row(row: Outcome) -> str:
    bar = "".join(
        f'<i class="{name}" style="flex:{row.frames[name]}"></i>'
        for name in ("tracked", "doubtful", "lost") if row.frames.get(name)
    )  # fmt: skip
    state = "" if row.state == DONE else f'<span class="state {row.state}">{row.state}</span> '
    warnings = "".join(f"<div>{escape(text)}</div>" for text in row.warnings)
    notes = f"<details><summary>{len(row.warnings)} notes</summary>{warnings}</details>" if row.warnings else ""  # fmt: skip
    shares = [f"{100 * row.share(name):.0f} %" if row.total else "–" for name in ("lost", "doubtful")]  # fmt: skip
    off = "–" if row.p_off is None else f"{row.p_off:.2f}"
    numbers = "".join(f'<td class="number">{value}</td>' for value in (*shares, off, f"{row.seconds:.0f}"))  # fmt: skip
    return (
        f"<tr><td><b>{escape(row.recording)}</b><br><small>{escape(row.folder)}</small></td>"
        f'<td class="number">{row.total or "–"}<div class="bar">{bar}</div></td>{numbers}'
        f'<td class="cause">{state}{escape(row.cause)}{notes}</td>'
        f'<td><button data-command="{escape(open_command(row))}">copy</button></td></tr>'
    )


# ---- `handtrack batch`: many recordings, one process each, gone on with where it was left


_OK, _SOME, _INTERRUPTED = 0, 3, 130


def run(options: Namespace) -> Answer:
    """Track all; return 0, 3 where recordings have no result or lost too many frames, 130 when interrupted."""
    out = options.out.resolve()
    ledger = out / LEDGER_FILE
    before = latest(read_ledger(ledger))
    if before and not options.resume:
        raise HandtrackError(
            f"--out {options.out}: there is a batch of {len(before)} recordings. --resume goes on with it, and leaves out what is "
            "done; name another folder to begin anew."
        )
    if out.is_file():
        raise HandtrackError(f"--out {options.out} is a file. Name a folder with --out.")
    words = track_words(options)
    plan = recordings(options.pattern, words, out)
    known = [before.get(one.folder) for one in plan]
    todo = [
        one
        for one, then in zip(plan, known, strict=True)
        if then is None or then.digest != one.digest or not then.is_ended
    ]
    out.mkdir(parents=True, exist_ok=True)
    if len(todo) < len(plan):
        same = len(plan) - len(todo)
        print_status(
            f"{same} of {len(plan)} recordings are left as they are: same inputs, settings, version."
        )
    track_it: Track = partial(track_one, words, out, max(thread_count() // options.jobs, 1))

    def begin_here(recording: Outcome, should_stop: Callable[[], bool]) -> Outcome:
        append(ledger, recording)
        return track_it(recording, should_stop)

    with ExitStack() as stack:
        stop = stack.enter_context(stoppable())
        if options.dask is None:
            pool, over = stack.enter_context(ThreadPoolExecutor(options.jobs)), threading.Event()
        else:
            pool, over = stack.enter_context(on_dask(options.dask))
        stack.callback(over.set)
        bar = stack.enter_context(
            progress_bar(len(todo), "batch", unit="recording", disable=not todo)
        )
        for outcome in track_all(
            pool, over, todo, begin_here if options.dask is None else track_it, stop
        ):
            append(ledger, outcome)
            if outcome.state != DONE:
                words = f"{outcome.recording}: {outcome.state}: {outcome.cause}"
                tqdm.write(words, file=sys.stderr)
            bar.update()
        stopped = stop()
    ended = latest(read_ledger(ledger))
    write_report(out, list(ended.values()))
    own = [ended[one.folder] for one in plan if one.folder in ended]
    files = {"report": str(out / "report.html"), "table": str(out / "report.csv"), "ledger": str(ledger)}  # fmt: skip
    report = {"recordings": [asdict(outcome) for outcome in own], **files}
    poor = [o for o in own if o.state != DONE or o.share("lost") > options.most_lost]
    code = _SOME if poor else _OK
    if stopped or any(one.state == INTERRUPTED for one in own):
        print_status("handtrack batch: interrupted; --resume goes on.")
        code = _INTERRUPTED
    return Answer(report, [f"{in_words(own)}. Report: {out / 'report.html'}"], code)


def track_words(options: Namespace) -> list[str]:
    """Return the options of `handtrack track` that a batch hands on to each recording."""
    words = [word for pair in options.set for word in ("--set", pair)]
    for name in ("init", "frames", "use", "seed"):
        value = getattr(options, name)
        words += [] if value is None else [f"--{name}", str(value)]
    return words + ["--yes"] * options.yes
