"""`handtrack sample`: a recording that comes with the program, as files."""

from __future__ import annotations

import argparse

from handtrack.errors import unknown_name
from handtrack.session.bundled import TWO_VIDEOS, sample_names, write_sample
from handtrack_app.commands.terminal.answer import answer
from handtrack_app.commands.terminal.output import check_new, new_folder


def run(args: argparse.Namespace) -> int:
    """Write the sample into a new folder and name what is in it."""
    if args.name not in sample_names():  # before anything is made
        raise unknown_name("sample", args.name, sample_names())
    check_new(args.to, "--to")
    with new_folder(args.to) as folder:
        files = [path.relative_to(folder) for path in write_sample(args.name, folder)]
    shown = ", ".join(map(str, files[:6])) + (" …" if len(files) > 6 else "")
    words = [f"{len(files)} files in {args.to}: {shown}"]
    if args.name != TWO_VIDEOS:
        words.append(f"Open it with: handtrack open {args.to}")
    answer(args, {"sample": args.name, "folder": args.to, "files": files}, *words)
    return 0
