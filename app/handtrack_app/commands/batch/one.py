"""Tracks one recording in a process of its own, by the command that a person would give."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from handtrack.files.atomic import replace_text
from handtrack.session.layout import POSES_FILE
from handtrack_app.commands.batch.outcome import DONE, FAILED, INTERRUPTED, REFUSED, Outcome
from handtrack_app.commands.batch.plan import Recording

_CHILD = "handtrack_app.commands.batch.child"
_POLL_S = 0.2
_STOPPED = 130  # as after Ctrl-C
_STATES = {0: DONE, 2: REFUSED, _STOPPED: INTERRUPTED}
_HELD = "is being written to by"
"""in the sentence of a session that another program writes to; that may end"""
_OF_SIGNALS = {9: ": by the system, where memory was short, or by somebody"}
_LONGEST = 20
"""lines of a log that are looked at for the cause"""


def track_one(
    recording: Recording,
    words: Sequence[str],
    out: Path,
    threads: int,
    should_stop: Callable[[], bool] = lambda: False,
) -> Outcome:
    """Return how `handtrack track FOLDER …` ended; its outcome and its log are files in the output folder.

    words: the options. threads: that it may use. should_stop: asked all the time; then it is told to stop as by Ctrl-C.
    """
    began = time.monotonic()
    log = out / "logs" / f"{recording.name}.log"
    log.parent.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, "-m", _CHILD, "track", str(recording.folder), *words, "--json"]
    where = os.pathsep.join(path for path in sys.path if path)
    environment = os.environ | {"HANDTRACK_THREADS": str(threads), "PYTHONPATH": where}
    with log.open("wb") as errors, log.with_suffix(".json").open("w+b") as told:
        child = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=told, stderr=errors, env=environment)  # fmt: skip
        asked = False
        while child.poll() is None:
            if should_stop() and not asked:
                asked = True
                with suppress(OSError):
                    child.terminate()  # as Ctrl-C: it saves what it has
            with suppress(subprocess.TimeoutExpired):
                child.wait(_POLL_S)
        if child.stdin is not None:
            child.stdin.close()
        told.seek(0)
        text = told.read().decode(errors="replace")
    log.with_suffix(".json").unlink()
    # told to stop before it could listen: it has saved nothing, for it had begun nothing
    code = _STOPPED if asked and child.returncode == -signal.SIGTERM else child.returncode
    outcome = _outcome(recording, code, text, log, time.monotonic() - began)
    file = out / "outcomes" / f"{recording.name}.json"
    file.parent.mkdir(parents=True, exist_ok=True)
    replace_text(file, json.dumps(outcome.table(), indent=1, ensure_ascii=False) + "\n")
    return outcome


def _outcome(recording: Recording, code: int, text: str, log: Path, seconds: float) -> Outcome:
    told = {}
    with suppress(ValueError):
        told = json.loads(text)
    state = _STATES.get(code, FAILED)
    cause = "" if code == 0 else _cause(log, code).removeprefix(f"{recording.folder}: ")
    if state == REFUSED and _HELD in cause:
        state = FAILED
    output = str(told.get("output", "")) if isinstance(told, dict) else ""
    return Outcome(
        recording.name, str(recording.folder), recording.digest, state, code, round(seconds, 3),
        told.get("frames", {}), _p_off(recording.folder / POSES_FILE) if code == 0 else None,
        told.get("warnings", []), cause, output, datetime.now(UTC).isoformat(timespec="seconds"),
    )  # fmt: skip


def _cause(log: Path, code: int) -> str:
    """Return what the program said last, in one line."""
    if code < 0:
        return f"it was ended by signal {-code}{_OF_SIGNALS.get(-code, '')}"
    lines = log.read_text(errors="replace").splitlines()[-_LONGEST:]
    said = [line for line in lines if line.startswith("handtrack track: ")]
    return (said or lines or ["it said nothing"])[-1].removeprefix("handtrack track: ")


def _p_off(file: Path) -> float | None:
    try:
        with np.load(file) as poses:
            chance = poses["p_off_25mm"]
    except (OSError, KeyError, ValueError):
        return None
    known = chance[np.isfinite(chance)]
    return float(known.mean().round(4)) if len(known) else None
