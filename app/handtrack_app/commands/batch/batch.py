"""`handtrack batch`: many recordings, one process each, gone on with where it was left."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from tqdm import tqdm

from handtrack.errors import HandtrackError
from handtrack_app.commands.batch.outcome import (
    DONE,
    INTERRUPTED,
    Outcome,
    append,
    latest,
    read_ledger,
)
from handtrack_app.commands.batch.plan import LEDGER_FILE, Recording, recordings
from handtrack_app.commands.batch.pools import Work, on_dask, on_this_machine, threads_each
from handtrack_app.commands.batch.report import in_words, write_report
from handtrack_app.commands.terminal.progress import say, stoppable

_OK, _SOME, _INTERRUPTED = 0, 3, 130


def run(args: argparse.Namespace) -> int:
    """Track all; return 0, 3 where recordings have no result or lost too many frames, 130 when interrupted."""
    if args.jobs < 1:
        raise HandtrackError(f"--jobs {args.jobs}: expected 1 or more recordings at a time.")
    if not 0 <= args.most_lost <= 1:
        raise HandtrackError(f"--most-lost {args.most_lost:g}: expected a share, 0 to 1.")
    out = args.out.resolve()
    ledger = out / LEDGER_FILE
    before = latest(read_ledger(ledger))
    if before and not args.resume:
        raise HandtrackError(
            f"--out {args.out}: there is a batch of {len(before)} recordings. --resume goes on with it, and leaves out what is "
            "done; name another folder to begin anew."
        )
    words = track_words(args)
    plan = recordings(args.pattern, words, out)
    todo = [one for one in plan if not _is_settled(one, before)]
    out.mkdir(parents=True, exist_ok=True)
    if len(todo) < len(plan):
        same = len(plan) - len(todo)
        say(
            f"{same} of {len(plan)} recordings are left as they are: same inputs, settings, version."
        )
    work = Work(words, out, threads_each(args.jobs))
    with stoppable() as stop:
        came = (
            on_this_machine(todo, work, args.jobs, stop, lambda begun: append(ledger, begun))
            if args.dask is None
            else on_dask(args.dask, todo, work, stop)
        )
        _collect(came, ledger, len(todo))
        stopped = stop()
    known = latest(read_ledger(ledger))
    write_report(out, list(known.values()))
    own = [known[str(one.folder)] for one in plan if str(one.folder) in known]
    _tell(args, own, out)
    if stopped or any(one.state == INTERRUPTED for one in own):
        say("handtrack batch: interrupted; --resume goes on.")
        return _INTERRUPTED
    poor = [o for o in own if o.state != DONE or o.share("lost") > args.most_lost]
    return _SOME if poor else _OK


def track_words(args: argparse.Namespace) -> list[str]:
    """Return the options of `handtrack track` that a batch hands on to each recording."""
    words = [word for pair in args.set for word in ("--set", pair)]
    for name in ("init", "frames", "use", "seed"):
        value = getattr(args, name)
        words += [] if value is None else [f"--{name}", str(value)]
    return words + ["--yes"] * args.yes


def _is_settled(one: Recording, before: dict[str, Outcome]) -> bool:
    known = before.get(str(one.folder))
    return known is not None and known.digest == one.digest and known.is_settled


def _collect(came: Iterable[Outcome], ledger: Path, count: int) -> None:
    """Enter outcomes into the ledger as they come, and show how far it is."""
    interval = 0.2 if sys.stderr.isatty() else 5.0
    with tqdm(total=count, desc="batch", unit="recording", mininterval=interval, dynamic_ncols=True, disable=not count) as bar:  # fmt: skip
        say_: Callable[[str], None] = lambda text: tqdm.write(text, file=sys.stderr)  # noqa: E731
        for outcome in came:
            append(ledger, outcome)
            if outcome.state != DONE:
                say_(f"{outcome.recording}: {outcome.state}: {outcome.cause}")
            bar.update()


def _tell(args: argparse.Namespace, own: Sequence[Outcome], out: Path) -> None:
    files = {"report": str(out / "report.html"), "table": str(out / "report.csv"), "ledger": str(out / LEDGER_FILE)}  # fmt: skip
    if args.json:
        print(json.dumps({"recordings": [o.table() for o in own], **files}, indent=1), flush=True)
    else:
        print(f"{in_words(own)}. Report: {out / 'report.html'}", flush=True)
