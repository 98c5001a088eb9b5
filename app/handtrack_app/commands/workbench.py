"""`handtrack open` and `handtrack demo`: the workbench in the browser."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from handtrack.errors import HandtrackError
from handtrack.session.bundled import bundled_session, demo_session
from handtrack.session.layout import SESSION_FILE
from handtrack_app.access.address import choose_port
from handtrack_app.commands.terminal.output import check_new, print_status
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
        return _choose(options)
    folder = bundled_session() if options.session is None else options.session
    live = live_options(options)
    if live is None and not (folder / SESSION_FILE).is_file():
        from handtrack.session.session import Session

        Session.open(folder)  # says what is missing
    return _open(options, folder, live=live)


def open_demo(options: Namespace) -> int:
    """Serve the workbench on a recording that is tracked already, until Ctrl-C."""
    return _open(options, demo_session(), demo=True)


def _open(
    options: Namespace, folder: Path, demo: bool = False, live: LiveOptions | None = None
) -> int:
    if options.port is not None:
        choose_port(options.host, options.port)  # says what is wrong with it before anything starts
    use_one_arena()
    web = _serve(options, folder, demo, live)
    return 0 if web is None else _choose(options, web)


def _choose(options: Namespace, web: WebServer | None = None) -> int:
    """Serve start page and workbench in turns until Ctrl-C. web: of the page before; the browser's page goes on there."""
    from handtrack_app.start.start_page import choose_recording

    use_one_arena()
    problem = ""
    while True:
        port, token = (options.port, None) if web is None else (web.port, web.token)
        chosen = choose_recording(options.host, port, not options.no_browser, token, problem)
        if chosen is None:
            return 0
        folder, web = chosen
        try:
            web = _serve(options, folder, web=web)
            problem = ""
        except HandtrackError as error:  # the page says so, and another may be chosen
            problem = str(error)
        if web is None:
            return 0


def _serve(
    options: Namespace,
    folder: Path,
    demo: bool = False,
    live: LiveOptions | None = None,
    web: WebServer | None = None,
) -> WebServer | None:
    """Serve the workbench; return its web server where somebody wants another recording. web: of the page before."""
    memory = memory_limit(options.memory)
    print_status("handtrack: starting the workbench …")
    if not demo:
        remember(folder)
    child = EngineChild(ENGINE_LOG)  # its imports take longest: they run beside those of the page
    plan = EnginePlan(folder, live, options.rerun, not demo and options.take_over, memory=memory)
    port, token = (options.port, None) if web is None else (web.port, web.token)
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
