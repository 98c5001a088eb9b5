"""`handtrack warmup`: compile ahead what tracking would compile at its first frame."""

from __future__ import annotations

import argparse
import time

from handtrack.simulation.warm_up import warm_up
from handtrack_app.commands.terminal.answer import answer
from handtrack_app.commands.terminal.progress import say


def run(args: argparse.Namespace) -> int:
    """Track a small frame of every kind; numba keeps what it compiles for later runs."""
    begun = time.perf_counter()
    for kind in warm_up():
        say(f"compiled for {kind}")
    seconds = time.perf_counter() - begun
    words = f"ready after {seconds:.0f} s; kept for this machine and this version"
    answer(args, {"seconds": round(seconds, 1)}, words)
    return 0
