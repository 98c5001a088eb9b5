"""What a command answers: a sentence or two for people, or one JSON object for programs."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping


def answer(args: argparse.Namespace, table: Mapping[str, object], *lines: str) -> None:
    """Print the lines on stdout, or the table as JSON where `--json` is given. Notes go to stderr (`say`) either way."""
    text = json.dumps(table, indent=1, default=str) if args.json else "\n".join(lines)
    if text:
        print(text, flush=True)
