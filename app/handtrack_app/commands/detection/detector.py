"""`handtrack detector install`: a copy of the detector's weights for all sessions of this user."""

from __future__ import annotations

import argparse

from handtrack.detector.weights import LICENCE, SHA256, install_weights, weights_in_packages
from handtrack_app.commands.terminal.answer import answer


def run(args: argparse.Namespace) -> int:
    """Copy the file given, or one that an installed Python package carries; say its licence."""
    source = args.file or weights_in_packages()
    target = install_weights(source)
    answer(
        args,
        {"source": source, "output": target, "sha256": SHA256, "licence": LICENCE},
        f"{source} is installed as {target}; SHA-256 {SHA256}, as expected.",
        f"Licence of these weights: {LICENCE}.",
    )
    return 0
