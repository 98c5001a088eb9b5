"""`handtrack open` and `handtrack demo`: the workbench in the browser."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from handtrack.errors import HandtrackError
from handtrack.session.bundled import bundled_session, demo_session
from handtrack.session.layout import SESSION_FILE
from handtrack_app.access.address import choose_port
from handtrack_app.commands.output import check_new, print_status
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


def open_session(options: Namespace) -> int:
    """Serve the workbench, after the start page where a recording is to be chosen, until Ctrl-C."""
    if options.choose:
        return _serve_pages(options, None)
    folder = bundled_session() if options.session is None else options.session
    live = live_options(options)
    if live is None and not (folder / SESSION_FILE).is_file():
        from handtrack.session.session import Session

        Session.open(folder)  # says what is missing
    return _serve_pages(options, folder, live=live)


def open_demo(options: Namespace) -> int:
    """Serve the workbench on a recording that is tracked already, until Ctrl-C."""
    return _serve_pages(options, demo_session(), demo=True)


def _serve_pages(
    options: Namespace, folder: Path | None, demo: bool = False, live: LiveOptions | None = None
) -> int:
    """Serve the workbench, or the start page where no folder is chosen, in turns until Ctrl-C; the browser's page goes on."""
    if options.port is not None:
        choose_port(options.host, options.port)  # says what is wrong with it before anything starts
    use_one_arena()
    web, problem = None, ""
    while True:
        port, token = (options.port, None) if web is None else (web.port, web.token)
        if folder is None:
            from handtrack_app.start.start_page import choose_recording

            chosen = choose_recording(options.host, port, not options.no_browser, token, problem)
            if chosen is None:
                return 0
            folder, web = chosen
            continue
        try:
            take_over = not demo and options.take_over
            memory = memory_limit(options.memory)
            plan = EnginePlan(folder, live, options.rerun, take_over, memory=memory)
            web, problem = _serve(options, plan, demo, port, token), ""
        except HandtrackError as error:
            if web is None:
                raise
            problem = str(error)  # the page says so, and another may be chosen
        if web is None:
            return 0
        folder, demo, live = None, False, None


def _serve(
    options: Namespace, plan: EnginePlan, demo: bool, port: int | None, token: str | None
) -> WebServer | None:
    """Serve the workbench; return its web server where somebody wants another recording. token: of the page before."""
    print_status("handtrack: starting the workbench …")
    if not demo:
        remember(plan.folder)
    child = EngineChild(ENGINE_LOG)  # its imports take longest: they run beside those of the page
    try:
        from handtrack_app.workbench import run_workbench

        return run_workbench(plan, child, options.host, port, not options.no_browser, demo, token)
    finally:
        child.kill()


def live_options(options: Namespace) -> LiveOptions | None:
    """Return what was said of running cameras; None without --live. Raises HandtrackError."""
    if not options.live:
        if options.camera or options.record is not None:
            raise HandtrackError(
                "--camera and --record go with --live only: add it, or leave them out."
            )
        return None
    if options.session is None:
        raise HandtrackError(
            "--live needs calibrated cameras: name a session folder, or a folder with a calibration.toml, as in "
            "`handtrack open FOLDER --live`."
        )
    if options.record is not None:
        check_new(options.record, "--record")
    return LiveOptions(options.camera, options.tolerance_ms * 1e-3, options.record)
