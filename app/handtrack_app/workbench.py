"""Wires the workbench: the worker, the page, its panels and its scene; no logic of its own."""

from __future__ import annotations

import logging
import socket
import sys
import threading
import webbrowser
from collections.abc import Callable, Hashable
from contextlib import ExitStack
from dataclasses import replace
from functools import partial

import viser

from handtrack.session.bundled import working_folder
from handtrack_app import protocol
from handtrack_app import viser_internals as internals
from handtrack_app.access.address import choose_port, host_warning, is_loopback
from handtrack_app.access.web_server import WebServer, show_in_browser, start_web_server
from handtrack_app.log import LOG_FILE, logging_to
from handtrack_app.page.layout import PageLayout
from handtrack_app.page.page import Page, UserState
from handtrack_app.page.scene.stage import Stage
from handtrack_app.page.timeline import Drawn, InFlight, Player
from handtrack_app.process.child import EngineChild, EnginePlan
from handtrack_app.process.engine_process import EngineProcess
from handtrack_app.protocol import Mailbox

log = logging.getLogger(__name__)
_PATIENCE_S = 20.0  # the browser opens at the latest after this; the page says what goes on
_STOP_S = 5.0  # what is done is on disk; an engine that is deep in a compilation, half a minute, is not waited for
_FIRST = (protocol.SessionSnapshot, protocol.PoseSnapshot, protocol.TimelineSnapshot)
_LIVE_STOP_S = 15.0  # a recording of running cameras is completed at the end


def _kind_of(snapshot: object) -> Hashable | None:
    """Return what a newer snapshot has in common with one that still waits, and that it replaces; None: it replaces none. Of progress
    each state is told: who waits for a job's beginning or end misses neither, however quick the job.
    """
    if isinstance(snapshot, protocol.Notice | protocol.Download | protocol.TimelineChange):
        return None
    is_progress = isinstance(snapshot, protocol.ProgressSnapshot)
    return type(snapshot), snapshot.state if is_progress else ""


class Workbench:
    """A session in the browser. `start` returns at once; the page fills while the session opens."""

    def __init__(
        self,
        plan: EnginePlan,
        engine: Callable[[Callable[[protocol.Snapshot], None]], EngineProcess],
        host: str = "127.0.0.1",
        port: int = 8080,
        demo: bool = False,
        open_pages: bool = False,
        token: str | None = None,
    ) -> None:
        """engine: makes what does as the plan says, and tells it. demo: play what is tracked once it is open, and offer the tour. open_pages: open
        rerun's viewer in the browser, too. token: of the page before.
        """
        self._open_pages, self._is_demo = open_pages, demo
        self.folder, self.host, self.wanted_port = plan.folder, host, port
        self.state = UserState()
        self._snapshots: Mailbox[protocol.Snapshot | Drawn] = Mailbox(_kind_of)
        self._held: protocol.PoseSnapshot | None = None
        """of a frame that is played, until the page has drawn the one before"""
        self.worker = engine(self._snapshots.put)
        self._ends_within_s = _STOP_S if plan.live is None else _LIVE_STOP_S
        self._ready, self._stopping = threading.Event(), threading.Event()
        self._wanted: dict[str, tuple[object, ...]] = {}
        self.engine = self.worker.engine
        self._plays_first = demo
        self._watch: Callable[[], object] = self._see_first
        """called now and then, by the thread that shows snapshots"""
        self._token = token
        self.left = threading.Event()
        """somebody wants another recording"""
        self.web: WebServer
        self.server: viser.ViserServer

    @property
    def url(self) -> str:
        """The address of the page, with the token that lets in."""
        return self.web.url

    # ---- life

    def start(self) -> Workbench:
        """Serve the page and begin to open the session."""
        self.web = start_web_server(self.host, self.wanted_port, token=self._token)
        self.server = self.web.server
        internals.send_whole(self.server)
        self.page = Page(
            self.server,
            self.state,
            self.engine,
            self.redraw,
            self.go_to,
            self.left.set,
            self.web.messages.sent_value,
        )
        self.web.messages.own = self.page.own_widgets
        self.layout = PageLayout(self.page, self.worker.start_again)
        self.in_flight = InFlight(self.page, self._snapshots.put)
        self.server.on_client_disconnect(lambda _: self.in_flight.clear())
        self.player = Player(self.state, self._ask_for, self.in_flight, self.redraw)
        self.page.greet(self.layout.room.welcome)
        self._thread = threading.Thread(target=self._show_snapshots, name="view", daemon=True)
        self._thread.start()
        self.player.start()
        self.worker.start()
        return self

    def stop(self) -> None:
        """End everything."""
        self._stopping.set()
        self.player.stop()
        self.worker.stop(self._ends_within_s)
        self._snapshots.close()
        self._thread.join(5.0)
        self.web.close()

    def wait_ready(self, timeout: float = 120.0) -> bool:
        """Return whether the session can be worked in and all of the page shows it, waiting for that."""
        return self._ready.wait(timeout)

    # ---- from the page

    def go_to(self, frame: float) -> None:
        """Show a frame, from whatever number came."""
        state = self.state
        with state.lock:
            target = state.clamp_frame(frame)
            if target != state.frame:
                state.frame, state.awaited, state.follow = target, target, False
                self.engine.show_frame(target)  # what another thread asks for later comes later
        self.layout.timeline.show_frame(state.frame)

    def _ask_for(self, frame: int) -> None:
        """Ask for a frame that is played. The page stays at the one shown until all of it comes."""
        target = self.state.clamp_frame(frame)
        self.in_flight.begin(target)
        self.engine.show_frame(target, is_played=True)

    def redraw(self) -> None:
        """Apply changed display options."""
        self.stage.apply()
        for name, wanted in self.stage.wanted().items():
            if self._wanted.get(name) != wanted:
                self._wanted[name] = wanted
                getattr(self.engine, name)(*wanted)

    # ---- from the worker

    def _show_snapshots(self) -> None:
        while not self._stopping.is_set():
            snapshot = self._snapshots.take(0.2)
            try:
                if snapshot is None:  # what two threads showed at once is shown again
                    self.page.refresh()
                else:
                    self.page.show(snapshot)
            except Exception:  # one snapshot that cannot be shown must not end the page
                log.exception("could not show %s", type(snapshot).__name__)
            self._watch()

    def _see_first(self) -> None:
        """Build scene and panels once all has come that they begin with."""
        first = [self.page.early.get(kind) for kind in _FIRST]
        if None not in first:
            with self.server.atomic():
                self._build(*first)  # type: ignore[arg-type]
            self.page.show_early()

    def _see_ready(self) -> None:
        if self.state.progress.state not in ("opening", "failed"):
            self._ready.set()

    def _build(
        self,
        session: protocol.SessionSnapshot,
        pose: protocol.PoseSnapshot,
        strip: protocol.TimelineSnapshot,
    ) -> None:
        """Build scene and panels, and have snapshots shown in them."""
        subscribe, server, state = self.page.subscribe, self.server, self.state
        state.kind, state.session, state.strip = session.kind, session, strip
        subscribe(protocol.SessionSnapshot, self._show_session)
        self.stage = Stage(self.page, pose)
        self.layout.build(self.stage, pose)
        subscribe(protocol.PoseSnapshot, self._take_pose)
        subscribe(Drawn, self._show_held)
        subscribe(protocol.ProgressSnapshot, self._show_progress)
        subscribe(protocol.RerunPage, self._show_rerun)
        self._watch = self.stage.clear_late
        self.page.watch(self._see_ready)
        self.layout.help.offers_tour = self._is_demo
        self.page.greet(self.layout.help.welcome)
        # who comes can take hold of the hand; the picture of who goes is painted no more
        for hear in (server.on_client_connect, server.on_client_disconnect):
            hear(lambda _: self.redraw())

    def _show_session(self, session: protocol.SessionSnapshot) -> None:
        with self.state.lock:
            if self.state.names != session.parameter_names:
                self.state.values = ()
            self.state.session, self.state.awaited = session, None
        self.player.fps = session.fps

    def _take_pose(self, pose: protocol.PoseSnapshot) -> None:
        if pose.beside is None:  # somebody went elsewhere, or another engine began
            self._held = None
            self._show_pose(pose)
            self.in_flight.clear()
            return
        self._held = pose if self.in_flight.is_drawing else None
        if self._held is None:
            self._show_pose(pose)

    def _show_held(self, _: Drawn) -> None:
        held, self._held = self._held, None
        if held is not None:
            self._show_pose(held)

    def _show_progress(self, progress: protocol.ProgressSnapshot) -> None:
        tracking = progress.state in ("tracking", "preparing")
        if self.state.tracking != tracking:
            self.state.tracking = tracking
            self.redraw()
        if self._plays_first and progress.state == "idle":  # the demo is open
            self._plays_first = False
            is_tracked = bool((self.state.strip.status >= 0).any())
            self.state.playing = is_tracked and not self.state.version  # nobody edits yet

    def _show_rerun(self, rerun: protocol.RerunPage) -> None:
        print(f"handtrack: residuals are at {rerun.url}", flush=True)
        if self._open_pages:
            webbrowser.open(rerun.url)

    def _show_pose(self, pose: protocol.PoseSnapshot) -> None:
        if len(pose.values) != len(self.state.names):
            return  # of a model that is about to be told, with this pose again
        with self.state.lock:
            newest = pose.version >= self.state.version and not self.state.is_late(pose.frame)
            if newest:
                self.state.frame, self.state.awaited = pose.frame, None
                self.state.shows_before = pose.origin == protocol.BEFORE
                if not self.state.shows_before:  # edits go on from what is
                    self.state.values_at = pose.frame
                    self.state.values = tuple(pose.values.tolist())
        clients = list(self.server.get_clients().values())
        with (
            ExitStack() as block
        ):  # hand, card, sliders and pictures are of one pose, in motion too
            for one in (self.server, *clients):
                block.enter_context(one.atomic())
            self.stage.show_pose(pose, move_handle=newest)
            self.layout.show_pose(pose, newest)
            for picture in pose.beside or ():
                self.page.show(picture)
            if pose.beside is not None:
                self.in_flight.show(pose.frame)
        for one in (*clients, self.server):
            one.flush()


@logging_to(LOG_FILE)
def run_workbench(
    plan: EnginePlan,
    child: EngineChild | None,
    host: str,
    port: int | None,
    open_browser: bool,
    demo: bool,
    token: str | None,
) -> WebServer | None:
    """Serve the workbench until Ctrl-C, or until somebody wants another recording: then return its web server, closed. Raises HandtrackError for a host or port that cannot be used.

    plan: a bundled session is opened as the user's own copy. child: the engine's process, if that is started already. port: the one
    asked for, None: the first that is free. demo: play once it is open. token: of the page before, which comes again.
    """
    warning = host_warning(host)
    if warning:
        print(f"handtrack: {warning}", file=sys.stderr)
    chosen = choose_port(host, port)
    own, live = replace(plan, folder=working_folder(plan.folder)), plan.live
    engine = partial(EngineProcess, own, child=child)
    bench = Workbench(own, engine, host, chosen, demo, open_browser, token).start()
    try:
        failure = bench.worker.wait_shown(_PATIENCE_S)
        if failure is not None:
            raise failure
        print(f"handtrack: {bench.folder.name} is open at {bench.url} (Ctrl-C ends)", flush=True)
        if not is_loopback(host):
            print(f"From other machines: {bench.web.url_by(socket.gethostname())}", flush=True)
        if own.folder != plan.folder or demo:
            print(f"This is your own copy; poses and tracks go to {own.folder}", flush=True)
        if open_browser and token is None:
            show_in_browser(bench.web)
        failure = bench.worker.wait_opened(None)
        if failure is not None:
            raise failure
        if live is not None and live.record is not None:
            bench.engine.record(True, str(live.record))
        while not bench.left.wait(0.5):
            pass  # waiting without end lost the first Ctrl-C in some runs (Python 3.11 on Linux)
        return bench.web
    except KeyboardInterrupt:
        return None
    finally:
        bench.stop()
        for words in bench.worker.last_words:
            print(words, flush=True)
