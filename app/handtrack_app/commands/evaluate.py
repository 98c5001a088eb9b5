"""`handtrack evaluate`: standard metrics against the truth."""

from __future__ import annotations

import argparse
import json

from handtrack.diagnostics.metrics import evaluate
from handtrack.errors import HandtrackError
from handtrack.session.formats.given_truth import read_given_truth
from handtrack.session.formats.tables import read_npz
from handtrack_app.commands.terminal.progress import say

_FAR_MM = 1000.0


def run(args: argparse.Namespace) -> int:
    """Print the metrics, as a table or JSON."""
    track = read_npz(args.poses)
    truth, note = read_given_truth(args.truth, track.side)
    if note:
        say(f"note: {note}")
    try:
        metrics = evaluate(track, truth)
    except HandtrackError as error:
        raise HandtrackError(f"{args.poses} and {args.truth}: {error}") from None
    median = metrics["mpjpe_median_mm"]
    if median is not None and median > _FAR_MM:
        say(
            f"note: result and truth are {median / 1000:.3g} m apart (median). Is {args.truth} in metres, and in the world of "
            "the calibration?"
        )
    if args.json:
        print(json.dumps(metrics, indent=1, allow_nan=False))
        return 0
    for name, value in metrics.items():
        shown = "-" if value is None else f"{value:.4g}" if isinstance(value, float) else str(value)
        print(f"{name:24s} {shown}")
    return 0
