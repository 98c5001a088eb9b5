"""`handtrack export`: a tracked sequence in another format."""

from __future__ import annotations

import argparse
from pathlib import Path

from handtrack.errors import HandtrackError
from handtrack.files.versions import keep_version
from handtrack.session.formats.tables import EXPORTS, read_npz
from handtrack_app.commands.terminal.output import output_file

_LATER = ("bvh", "glb", "trc", "mot", "urdf", "anipose", "html")


def run(args: argparse.Namespace) -> int:
    """Write the converted file and name it."""
    if args.to not in EXPORTS:
        why = "this version does not write it yet" if args.to in _LATER else "no such format"
        raise HandtrackError(f"--to {args.to}: {why}; known: {', '.join(EXPORTS)}.")
    write, suffix = EXPORTS[args.to]
    track = read_npz(args.poses)
    out: Path = args.out or args.poses.with_name(f"{args.poses.stem}{suffix}")
    output_file(out, (Path(f"poses{suffix}").suffix,), f"{args.to} exports are")
    if out.resolve() == args.poses.resolve():
        raise HandtrackError(
            f"--out {out}: that is the file that is read; nothing was written. Name another one."
        )
    try:
        previous = keep_version(out)
        write(out, track)
    except OSError as error:
        raise HandtrackError(
            f"--out {out}: cannot be written ({error.strerror}). Name another place with --out."
        ) from None
    kept = f"; the file before is kept as {previous}" if previous else ""
    print(f"{len(track)} frames written to {out}{kept}")
    return 0
