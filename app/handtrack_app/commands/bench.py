"""`handtrack bench`: each figure beside its reference, measured in one run."""

from __future__ import annotations

import argparse
import importlib
import json
import sys

from handtrack.errors import unknown_name


def run(args: argparse.Namespace) -> int:
    """Print a table, or JSON as contracts §3."""
    from handtrack.bench.registry import BENCHMARKS

    if args.name is not None and args.name not in BENCHMARKS:
        raise unknown_name("benchmark", args.name, tuple(BENCHMARKS))
    chosen = [args.name] if args.name else [n for n, b in BENCHMARKS.items() if b.quick]
    figures = {}
    for name in chosen:
        benchmark = BENCHMARKS[name]
        print(f"{name} …", file=sys.stderr)
        module = importlib.import_module(benchmark.module)
        figures[name] = getattr(module, benchmark.function)()
    if args.json:
        print(json.dumps(figures, indent=1))
        return 0
    for name, figure in figures.items():
        print(f"{name}")
        for key, value in figure.items():
            print(f"  {key:24s} {value:.4g}" if isinstance(value, float) else f"  {key:24s} {value}")
    return 0
