"""`handtrack export`: a tracked sequence in another format."""

from __future__ import annotations

import argparse
from pathlib import Path

from handtrack.errors import HandtrackError
from handtrack.session.tables import EXPORTS, read_npz


def run(args: argparse.Namespace) -> int:
    """Write the converted file and name it."""
    if args.to not in EXPORTS:
        raise HandtrackError(f"--to {args.to}: known formats are {', '.join(EXPORTS)}.")
    write, suffix = EXPORTS[args.to]
    track = read_npz(args.poses)
    out: Path = args.out or args.poses.with_name(f"{args.poses.stem}{suffix}")
    if out.resolve() == args.poses.resolve():
        raise HandtrackError(f"export would write over its own input {out}; name another file with --out.")
    try:
        write(out, track)
    except OSError as error:
        raise HandtrackError(f"cannot write {out}: {error.strerror}. Name another place with --out.") from None
    print(f"{len(track.frame)} frames written to {out}")
    return 0
