"""`handtrack open` and `handtrack demo`: the workbench in the browser."""

from __future__ import annotations

import argparse
import sys

from handtrack.session.bundled import bundled_session


def run(args: argparse.Namespace) -> int:
    """Serve the workbench until Ctrl-C."""
    demo = args.command == "demo"
    folder = None if demo else args.session
    if folder is None:
        folder = bundled_session("open_fist_open")
    print("handtrack: starting the workbench …", file=sys.stderr)
    from handtrack_app.workbench import run_workbench

    run_workbench(
        folder,
        host=args.host,
        port=args.port,
        open_browser=not args.no_browser,
        rerun=args.rerun,
        demo=demo,
    )
    return 0
