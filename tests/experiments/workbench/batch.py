"""Benchmark: a laboratory's night: 200 small recordings, 20 of them broken in ten ways, in a batch that is killed 20 times."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from handtrack.simulation.simulate import Simulation, simulate

_RECORDINGS, _EACH_WAY, _KILLS, _JOBS = 200, 2, 20, 2
_COMPARED = 5
"""recordings that `handtrack track` tracks again, alone"""
_TIMED = 8
"""recordings for one job beside two"""
_PROGRAM = [sys.executable, "-m", "handtrack_app.cli"]


def _replaced(file: str, old: str, new: str) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        text = (folder / file).read_text()
        assert old in text, f"{file} has no {old}"
        (folder / file).write_text(text.replace(old, new, 1))

    return change


def _without(name: str) -> Callable[[Path], None]:
    return lambda folder: (folder / name).unlink()


BROKEN: dict[str, tuple[Callable[[Path], None], str]] = {
    "no session.toml": (_without("session.toml"), "session.toml"),
    "torn session.toml": (_replaced("session.toml", "[hand]", "[hand"), "session.toml"),
    "unknown key": (_replaced("session.toml", "side =", "sidee ="), "sidee"),
    "newer format": (_replaced("session.toml", "format = 1", "format = 9"), "format"),
    "unknown model": (_replaced("session.toml", 'model = "hand26"', 'model = "hand27"'), "hand27"),
    "camera not calibrated": (_replaced("session.toml", 'name = "cam1"', 'name = "cam9"'), "cam9"),
    "no calibration": (_without("calibration.toml"), "calibration.toml"),
    "torn calibration": (_replaced("calibration.toml", "matrix", "matrx"), "calibration.toml"),
    "no first pose": (_without("init.json"), "init.json"),
    "torn first pose": (_replaced("init.json", "{", ""), "init.json"),
}
"""how a recording may be broken: what breaks it, and a word that its cause must have"""


def batch() -> dict[str, Any]:
    """Return how many recordings were done and named, what kills cost, and how two jobs compare with one."""
    with tempfile.TemporaryDirectory(prefix="handtrack_batch_") as place:
        root = Path(place)
        broken = _made(root / "takes")
        words = [f"{root}/takes/*", "--jobs", str(_JOBS), "--resume", "--out", str(root / "out")]
        began = time.monotonic()
        kills = _killed(words, np.random.default_rng(0))
        final = _handtrack("batch", *words)
        seconds = time.monotonic() - began
        ledger = [json.loads(line) for line in (root / "out" / "ledger.jsonl").read_text().splitlines()]  # fmt: skip
        started = Counter(row["recording"] for row in ledger if row["state"] == "started")
        last = {row["recording"]: row for row in ledger}
        done = [name for name, row in last.items() if row["state"] == "done"]
        named = [name for name, word in broken.items() if word in last[name]["cause"]]
        equal = sum(_is_equal(root / "takes" / name, root / "alone.npz") for name in done[:_COMPARED])  # fmt: skip
        one, two = (_timed(root, done[:_TIMED], jobs) for jobs in (1, 2))
        return {
            "ratio": 1.8 * two / one,
            "ours_ms": 1e3 * two,
            "reference_ms": 1e3 * one / 1.8,
            "reference": f"1 / 1.8 of what one job takes for {_TIMED} recordings; ours: two jobs",
            "recordings": len(last),
            "done": len(done),
            "refused_and_named_by_cause": len(named),
            "kills": kills,
            "begun_again_in_all": sum(started.values()) - len(last),
            "begun_again_at_most_for_one_recording": max(started.values()) - 1,
            "exit_code": final.returncode,
            "results_equal_to_track": f"{equal} of {min(_COMPARED, len(done))}",
            "seconds": seconds,
            "two_jobs_times_one": one / two,
        }


def _made(folder: Path) -> dict[str, str]:
    """Make the recordings; return the word that each broken one's cause must have."""
    first = folder / "take000"
    simulate(first, Simulation(cameras=3, frames=3, size=(160, 120), images=False))
    for number in range(1, _RECORDINGS):
        shutil.copytree(first, folder / f"take{number:03d}")
    ways = [way for way in BROKEN.values() for _ in range(_EACH_WAY)]
    words = {}
    for row, (damage, word) in enumerate(ways):
        name = f"take{row * (_RECORDINGS // len(ways)):03d}"
        damage(folder / name)
        words[name] = word
    return words


def _killed(words: list[str], rng: np.random.Generator) -> int:
    """Begin the batch and kill it at a random moment, over and over; return how often it was killed."""
    kills = 0
    for _ in range(_KILLS):
        quiet = subprocess.DEVNULL
        running = subprocess.Popen([*_PROGRAM, "batch", *words], stdout=quiet, stderr=quiet)
        try:
            running.wait(rng.uniform(2.0, 25.0))
        except subprocess.TimeoutExpired:
            running.kill()
            running.wait()
            kills += 1
    return kills


def _timed(root: Path, names: list[str], jobs: int) -> float:
    """Return what a batch over some recordings takes [s]."""
    folders = [str(root / "takes" / name) for name in names]
    began = time.monotonic()
    _handtrack("batch", *folders, "--jobs", str(jobs), "--out", str(root / f"timed{jobs}"))
    return time.monotonic() - began


def _is_equal(folder: Path, alone: Path) -> bool:
    """Return whether `handtrack track` gives the bytes that the batch gave."""
    alone.unlink(missing_ok=True)
    _handtrack("track", str(folder), "--out", str(alone))
    return alone.read_bytes() == (folder / "tracks" / "poses.npz").read_bytes()


def _handtrack(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*_PROGRAM, *words], capture_output=True, text=True, check=False)
