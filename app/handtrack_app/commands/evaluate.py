"""`handtrack evaluate`: standard metrics against the truth."""

from __future__ import annotations

import argparse
import json

from handtrack.diagnostics.metrics import evaluate
from handtrack.session.tables import read_npz
from handtrack.session.truth import read_truth


def run(args: argparse.Namespace) -> int:
    """Print the metrics, as a table or JSON."""
    metrics = evaluate(read_npz(args.poses), read_truth(args.truth))
    if args.json:
        print(json.dumps(metrics, indent=1))
        return 0
    for name, value in metrics.items():
        print(f"{name:22s} {value:.4g}" if isinstance(value, float) else f"{name:22s} {value}")
    return 0
