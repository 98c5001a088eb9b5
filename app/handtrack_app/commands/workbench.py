"""`handtrack open` and `handtrack demo`: the workbench in the browser."""

from __future__ import annotations

import argparse
from pathlib import Path

from handtrack.session.bundled import bundled_session
from handtrack.session.layout import SESSION_FILE
from handtrack_app.commands.terminal.progress import say
from handtrack_app.page.access import FIRST_PORT, choose_port


def run(args: argparse.Namespace) -> int:
    """Serve the workbench until Ctrl-C."""
    demo = args.command == "demo"
    folder = bundled_session() if demo or args.session is None else args.session
    if not (folder / SESSION_FILE).is_file():
        _refuse(folder)
    if args.port is not None:
        choose_port(args.host, args.port)  # says what is wrong with it before anything starts
    say("handtrack: starting the workbench …")
    from handtrack_app.workbench import run_workbench

    run_workbench(
        folder,
        host=args.host,
        port=FIRST_PORT if args.port is None else args.port,
        open_browser=not args.no_browser,
        rerun=args.rerun,
        demo=demo,
    )
    return 0


def _refuse(folder: Path) -> None:
    from handtrack.session.session import Session

    Session.open(folder)
