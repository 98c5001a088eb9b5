"""`handtrack bench`: each figure beside its reference, measured in one run."""

from __future__ import annotations

import argparse
import json

from handtrack.bench.registry import BENCHMARKS, benchmark
from handtrack_app.commands.terminal.progress import say


def run(args: argparse.Namespace) -> int:
    """Print a table, or JSON as contracts §3."""
    chosen = [args.name] if args.name else [n for n, b in BENCHMARKS.items() if b.quick]
    figures: dict[str, dict[str, object]] = {}
    for name in chosen:
        measure = benchmark(name)
        say(f"{name} …")
        figures[name] = measure()
    if args.json:
        print(json.dumps(figures, indent=1))
        return 0
    for name, figure in figures.items():
        print(name)
        for key, value in figure.items():
            shown = f"{value:.4g}" if isinstance(value, float) else value
            print(f"  {key:24s} {shown}")
    return 0
