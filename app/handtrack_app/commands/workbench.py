"""`handtrack open` and `handtrack demo`: the workbench in the browser."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from handtrack.errors import HandtrackError
from handtrack.session.bundled import bundled_session, demo_session
from handtrack.session.layout import SESSION_FILE
from handtrack_app.access.address import FIRST_PORT, choose_port
from handtrack_app.commands.terminal.output import check_new, say
from handtrack_app.log import ENGINE_LOG
from handtrack_app.process.child import (
    EngineChild,
    EnginePlan,
    LiveOptions,
    memory_limit,
    use_one_arena,
)
from handtrack_app.start.recent import remember

if TYPE_CHECKING:
    from handtrack_app.access.web_server import WebServer


def run(args: argparse.Namespace) -> int:
    """Serve the workbench until Ctrl-C."""
    if args.command == "start":
        return _start(args)
    demo = args.command == "demo"
    folder = demo_session() if demo else bundled_session() if args.session is None else args.session
    live = None if demo else live_options(args)
    if live is None and not (folder / SESSION_FILE).is_file():
        from handtrack.session.session import Session

        Session.open(folder)  # says what is missing
    if args.port is not None:
        choose_port(args.host, args.port)  # says what is wrong with it before anything starts
    use_one_arena()
    web = _serve(args, folder, demo, live)
    return 0 if web is None else _start(args, web)


def _start(args: argparse.Namespace, web: WebServer | None = None) -> int:
    """Serve start page and workbench in turns until Ctrl-C. web: of the page before; the browser's page goes on there."""
    from handtrack_app.start.start_page import choose_recording

    port = FIRST_PORT if args.port is None else args.port
    use_one_arena()
    told = ""
    while True:
        port, token = (port, None) if web is None else (web.port, web.token)
        chosen = choose_recording(args.host, port, not args.no_browser, token, told)
        if chosen is None:
            return 0
        folder, web = chosen
        try:
            web = _serve(args, folder, web=web)
            told = ""
        except HandtrackError as error:  # the page says so, and another may be chosen
            told = str(error)
        if web is None:
            return 0


def _serve(
    args: argparse.Namespace,
    folder: Path,
    demo: bool = False,
    live: LiveOptions | None = None,
    web: WebServer | None = None,
) -> WebServer | None:
    """Serve the workbench; return its web server where somebody wants another recording. web: of the page before."""
    memory = memory_limit(args.memory)
    say("handtrack: starting the workbench …")
    if not demo:
        remember(folder)
    child = EngineChild(ENGINE_LOG)  # its imports take longest: they run beside those of the page
    take_over = not demo and getattr(args, "take_over", False)
    plan = EnginePlan(folder, live, args.rerun, take_over, memory=memory)
    port = FIRST_PORT if args.port is None else args.port
    port, token = (port, None) if web is None else (web.port, web.token)
    try:
        from handtrack_app.workbench import run_workbench

        return run_workbench(plan, child, args.host, port, not args.no_browser, demo, token)
    finally:
        child.kill()


def live_options(args: argparse.Namespace) -> LiveOptions | None:
    """Return what was said of running cameras; None without --live. Raises HandtrackError."""
    if not args.live:
        if args.camera or args.record is not None:
            raise HandtrackError(
                "--camera and --record go with --live only: add it, or leave them out."
            )
        return None
    if args.session is None:
        raise HandtrackError(
            "--live needs calibrated cameras: name a session folder, or a folder with a calibration.toml, as in "
            "`handtrack open FOLDER --live`."
        )
    if args.record is not None:
        check_new(args.record, "--record")
    return LiveOptions(args.camera, args.tolerance_ms * 1e-3, args.record)
