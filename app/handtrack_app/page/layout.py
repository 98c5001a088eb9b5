"""Where the panels stand: one at the right, with a rail of five entries, and the timeline below; messages, help and the keys."""

from __future__ import annotations

import html
import re
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import viser

from handtrack_app.page.html import bordered, dress, escaped, line, text, told
from handtrack_app.page.page import DONE, GUIDE, INFO, Client, Page, Part, put, remembered
from handtrack_app.page.panels.cloud import CloudPanel
from handtrack_app.page.panels.export import ExportPanel
from handtrack_app.page.panels.masks import MaskPanel
from handtrack_app.page.panels.pose import PosePanel, certainty_table, group_of
from handtrack_app.page.panels.review import NextStep, PlotsPanel, ReviewPanel
from handtrack_app.page.panels.settings import LimitsPanel, RefitSwitch, SettingsPanel
from handtrack_app.page.panels.tracking import LivePanel, TakesPanel, TrackingPanel
from handtrack_app.page.panels.view import (
    WIDTH,
    Room,
    SessionPanel,
    colours,
    head,
    leave_button,
)
from handtrack_app.page.scene.grips import GrabKeys
from handtrack_app.page.scene.stage import Stage
from handtrack_app.page.timeline import TimelinePanel
from handtrack_app.palette import ASIDE
from handtrack_app.protocol import (
    CloseSnapshot,
    CloudPicture,
    CloudSnapshot,
    CurvesSnapshot,
    Download,
    GuessesSnapshot,
    LiveSnapshot,
    Notice,
    PictureSnapshot,
    PoseSnapshot,
    ProgressSnapshot,
    RerunPage,
    ScoreSnapshot,
    SessionSnapshot,
    SurfaceSnapshot,
    TimelineChange,
    TimelineSnapshot,
    WorkSnapshot,
)

_ASIDE = bordered("<b>Before the last step.</b> Tab shows the pose as it is.", ASIDE[1])
"""seen whatever tab is open, as the panel with the pose's card may be folded"""

_PAUSE, _RESUME, _CANCEL = "Pause", "Resume", "Cancel"
"""of a job that runs; seen whatever tab is open, too"""
_TABS = (
    ("Pose", "Limits"), ("Pose", "Certainty"), ("Review", "Plots"), ("Track",), ("View",), ("More", "Export"),
    ("More", "Settings"), ("More", "Masks"), ("More", "Cloud"), ("More", "Messages"),
)  # fmt: skip
"""tabs, with those that they are in, for who looks for one by its name"""
_WAITS = escaped("This waits while tracked frames pass by: pause, or turn off Follow.")


class PageLayout:
    """The head of the page; and its panels, once there is a session."""

    def __init__(self, page: Page, start_again: Callable[[], None]) -> None:
        """start_again: starts an engine that ended too often."""
        self.page, gui = page, page.gui
        colours(gui)
        dress(page.server)
        self.is_built = False
        self._behind: PoseSnapshot | None = None
        """what tabs behind others show"""
        self._waits = False
        self.saved = ""
        self.head = gui.add_html(head(page.state))
        page.reflect(self.head, content=lambda: head(page.state, self.is_built, self.saved))
        self.job = page.buttons(
            "Running", (_PAUSE, _CANCEL), self._steer, when=lambda: not page.state.is_free()
        )
        page.reflect(
            self.job, options=lambda: (_RESUME if page.state.is_paused() else _PAUSE, _CANCEL)
        )
        self.aside = page.offer(gui.add_html(_ASIDE), lambda: page.state.shows_before)
        page.button(
            "Start again", start_again, "refresh", color=None, when=lambda: page.state.progress.state == "failed"
        )  # fmt: skip
        self.messages = Messages(page)
        self.others = leave_button(page)
        self.room = Room(page)
        gui.main_panel.dock_right()
        gui.main_panel.set_width(WIDTH)
        page.subscribe(ProgressSnapshot, self.show_progress)
        page.subscribe(Notice, self.messages.take, self._show_notice)

    def build(self, stage: Stage, shown: PoseSnapshot) -> None:
        """Build the panels, which snapshots are shown in from now on."""
        page, gui, session = self.page, self.page.gui, self.page.state.session
        self.others.remove()
        card = gui.add_html("")
        gui.add_html("<div class='handtrack-rail'></div>")
        tabs, icon = gui.add_tab_group(), viser.Icon
        pose, review, track, view, more = (
            tabs.add_tab(name, icon=which)
            for name, which in (
                ("Pose", icon.HAND_STOP), ("Review", icon.LIST_CHECK), ("Track", icon.PLAYER_PLAY), ("View", icon.EYE),
                ("More", icon.DOTS),
            )
        )  # fmt: skip
        with pose:
            posing = gui.add_tab_group()
        with review:
            reviewing = gui.add_tab_group()
        with more:
            others = gui.add_tab_group()
        self.session = SessionPanel(page, view, stage, self.room)
        self.tracking = TrackingPanel(page, track)
        add_work_keys(page, self.tracking)
        if session.live:
            page.subscribe(LiveSnapshot, LivePanel(page, track).show)
        self.takes = TakesPanel(page, track)
        refits = RefitSwitch(page)
        GrabKeys(page, stage.root.control)
        joints = posing.add_tab("Joints")
        self.pose = PosePanel(page, joints, card, stage.grips, shown)
        self.guesses = self.pose.guesses
        stage.take_guess = self.guesses.take
        stage.grips.clicked = lambda bone: self.pose.open(group_of(bone))
        self.limits = LimitsPanel(page, posing.add_tab("Limits"), refits)
        with posing.add_tab("Certainty"):
            self.certainty = gui.add_html("")
        self.review = ReviewPanel(page, reviewing.add_tab("Queue"))
        page.offer(self.review.about, lambda: not self.messages.tells_of_recording)
        self.plots = PlotsPanel(page, reviewing.add_tab("Plots"), lambda: self.timeline.window)
        self.export = ExportPanel(page, others.add_tab("Export"))
        self.settings = SettingsPanel(page, others.add_tab("Settings"), refits)
        self.masks = MaskPanel(page, others.add_tab("Masks"), stage)
        self.cloud = CloudPanel(page, others.add_tab("Cloud"), stage.mark_box)
        marks = (
            lambda: self.pose.pose.version,
            lambda: tuple(pin.pixel for pin in self.pose.pose.pins),
            lambda: self.review.at,
            lambda: self.plots.group.value,
            lambda: self.export.delivered,
        )
        self.help = Help(page, self.session.leave, marks)
        self.messages.list_in(others.add_tab("Messages"))
        for names in _TABS:
            page.key(f"Open {names[-1]}", "", partial(page.open_tab, names=names), by_page=True)

        below = gui.add_panel()
        timeline = below.add_tab("Timeline")
        with timeline:
            self.next = NextStep(page, self.tracking, self.guesses, self.review)
        self.timeline = TimelinePanel(page, timeline)
        self.timeline.moved = self.plots.draw
        below.float(x=16, y=-16, width=560)

        subscribe = page.subscribe
        panels = (self.pose, self.limits, self.settings, self.plots)
        subscribe(
            SessionSnapshot,
            stage.fit,
            *(panel.fit for panel in (*panels, self.cloud, self.masks)),
        )
        subscribe(PictureSnapshot, stage.show_pictures, self.session.show_pictures, self.masks.show)
        subscribe(SurfaceSnapshot, stage.show_surface)
        subscribe(CloudSnapshot, stage.show_cloud, self.cloud.show)
        subscribe(CloudPicture, self.cloud.show_picture)
        subscribe(GuessesSnapshot, stage.show_guesses, self.guesses.show)
        subscribe(CurvesSnapshot, self.plots.show)
        subscribe(CloseSnapshot, self.review.show_pictures)
        subscribe(ScoreSnapshot, stage.show_score, self.pose.show_score)
        subscribe(WorkSnapshot, self.show_work)
        subscribe(TimelineSnapshot, self.show_timeline)
        subscribe(TimelineChange, lambda new: self.show_timeline(new.over(page.state.strip)))
        subscribe(Notice, self.review.warn)
        subscribe(RerunPage, self.tracking.show_rerun)
        subscribe(Download, self.export.deliver)
        page.watch(self._show_hidden)
        self.is_built = True

    def _steer(self, which: str) -> None:
        """Cancel the job that runs, let it wait, or let it go on: as a button says."""
        if which == _CANCEL:
            self.page.engine.cancel()
        else:
            self.page.engine.pause(which == _PAUSE)

    def show_pose(self, pose: PoseSnapshot, newest: bool = True) -> None:
        """Show a pose in the panels. newest: what can be moved moves, too; no edit is under way."""
        self.pose.show(pose, newest)
        if newest:
            self.timeline.show_pose(pose)

    def _show_hidden(self) -> None:
        """Show the pose in tabs behind others and closed groups, too, once no tracked frames pass by."""
        pose, waits = self.pose.pose, self.page.state.passes
        if pose is self._behind and waits == self._waits:
            return
        self._behind, self._waits = pose, waits
        put(self.certainty, content=_WAITS if waits else certainty_table(self.pose.names, pose.std))
        if not waits:
            self.limits.show(pose)
            self.pose.move_sliders(hidden=True)

    def show_timeline(self, strip: TimelineSnapshot) -> None:
        """Show the recording at a glance."""
        self.page.state.strip = strip
        self.timeline.show_timeline()
        self.messages.see_pose(strip.is_posed)
        self.review.show_timeline()

    def show_progress(self, progress: ProgressSnapshot) -> None:
        """Show what the worker is doing."""
        before, self.page.state.progress = self.page.state.progress, progress
        if self.is_built and progress.state == "tracking" != before.state and progress.total > 1:
            # what was found out about the recording holds until it, and not a single frame, is tracked anew
            put(self.review.about, content="")

    def show_work(self, work: WorkSnapshot) -> None:
        """Show the takes, and whether all that was done is saved."""
        self.takes.show(work)
        self.pose.show_work(work)
        self.saved = work.saved

    def _show_notice(self, notice: Notice) -> None:
        """Of what is done, show a notification for a while; all else stands in the panel, which is shown where it is hidden for an error."""
        level, title, text = notice.level, notice.title, notice.text
        for number, client in self.page.by_number.items():
            if level == "error" and client.taste.folded:
                self.room.fold(client)
            elif level == DONE and notice.client_id in (None, number):
                client.handle.add_notification(title, text, color="teal", auto_close_seconds=8.0)


# ---- What was said to the user: it stays to be read; and what is to be done or known stands until it is put away


_COLOURS = {GUIDE: "#56b4e9", INFO: "#56b4e9", DONE: "#009e73", "warning": "#e69f00", "error": "#d55e00"}  # fmt: skip
_FRAME, _LINK = re.compile(r"\b(frame) (\d+)", re.I), r"<a href='#' data-frame='\2'>\1 \2</a>"
"""the style's script goes to the frame of such a link"""
_MOST = 100  # messages that are kept
_NONE = escaped("No messages yet.")


@dataclass
class Messages(Part):
    """The note in the head of the main panel, and the tab with all messages."""

    is_posed: bool = False
    """there is a pose: guidance to the first one has done its work"""
    _all: deque[Notice] = field(default_factory=lambda: deque(maxlen=_MOST))
    _standing: list[Notice] = field(default_factory=list)
    _lock: threading.Lock = field(default_factory=threading.Lock)
    said: viser.GuiHtmlHandle | None = None
    """of all messages, once there is a session"""

    def build(self) -> None:
        """Add the note where the page builds now."""
        gui = self.gui
        self.page.button("Put away", self.put_away, when=lambda: bool(self._standing))
        self.note = self.page.offer(gui.add_html(""), lambda: bool(self._standing))

    def list_in(self, tab: viser.GuiTabHandle) -> None:
        """Add the list of all messages to a tab."""
        with tab:
            self.said = self.gui.add_html("")
        self._show()

    def take(self, notice: Notice) -> None:
        """Keep what is said; the same again takes the place of the older one, and an answer to what was tried stands until the next."""
        with self._lock:
            if not self._all or self._all[0] != notice:
                self._all.appendleft(notice)
            self._standing = [
                one for one in self._standing if one.title != notice.title and one.level != INFO
            ]
            if notice.level != DONE and not (notice.level == GUIDE and self.is_posed):
                self._standing.append(notice)
        self._show()

    def put_away(self) -> None:
        """Let the newest stand no more."""
        with self._lock:
            del self._standing[-1:]
        self._show()

    @property
    def tells_of_recording(self) -> bool:
        """Whether the head says what was found out about the recording."""
        return bool(self._standing) and self._standing[-1].of_recording

    def see_pose(self, is_posed: bool) -> None:
        """Take whether any frame has a pose: guidance goes then."""
        if is_posed != self.is_posed:
            with self._lock:
                self.is_posed = is_posed
                self._standing = [n for n in self._standing if not (n.level == GUIDE and is_posed)]
            self._show()

    def _show(self) -> None:
        with self._lock:
            said, standing = list(self._all), list(self._standing)
        if self.said is not None:
            put(self.said, content="".join(_words(one) for one in said) or _NONE)
        more = line(f"{len(standing) - 1} more: tab Messages")
        if standing:
            put(self.note, content=_words(standing[-1], more if len(standing) > 1 else ""))


def _words(notice: Notice, more: str = "") -> str:
    colour = _COLOURS.get(notice.level, "gray")
    title, text = (_FRAME.sub(_LINK, told(words)) for words in (notice.title, notice.text))
    text = f"<div>{text}</div>" if text else ""
    is_answer = notice.level != GUIDE and not notice.of_recording
    kind = f"handtrack-note{' handtrack-answer' * is_answer}"
    return bordered(f"<b>{title}</b>{text}{more}", colour, kind)


# ---- One page of help, and a tour of five things to do for who comes for the first time; both for one page alone, and left at once


_KEPT_AS = "handtrack.toured"  # in the browser's storage
_LEAVE = "Leave"
_GESTURES = (
    ("Drag", "Turns the orbit view; moves the image of a camera view"),
    ("Wheel", "Zooms"),
    (
        "Drag the {kind}",
        "In a camera view: pins a joint or segment; the {middle} moves the whole {kind}",
    ),
    (
        "Shift drag",
        "On the {kind}: in a camera view turns it, as the right button does; in the orbit view pulls a joint or segment",
    ),
    ("Arrows, arcs", "On the handle: move and turn the {kind}"),
    ("Shift Tab", "Goes to the buttons, the last first; from there Tab goes on, Esc leaves them"),
)
TOUR = (
    (
        "Move a {part}",
        "In the tab Pose, move a slider. The numbers above it follow, and Ctrl Z takes it back.",
    ),
    (
        "Pin a joint",
        "Press 1 for a camera view, then drag a joint to its place in the image.",
    ),
    (
        "Review",
        "Shift Z shows the interval of lowest confidence. <b>Accept and next</b>, in the tab Review, accepts it.",
    ),
    ("Plot", "Review, then Plots: choose what to see over time."),
    ("Export", "More, then Export: download joint angles and positions."),
)
"""what is to be done, and how"""


@dataclass
class Help(Part):
    """Help and tour of the pages."""

    leave: Callable[[Client], None]
    """leaves a camera's view"""
    marks: tuple[Callable[[], object], ...]
    """for each step of the tour what differs once it is done"""
    offers_tour: bool = False
    """to who comes for the first time"""

    def build(self) -> None:
        self.page.watch(self._go_on)
        key = self.page.key
        key("Help: all keys", "shift+H", self.show, by_page=True)
        key("Tour: five things to do", "", self.tour, by_page=True)
        key("Close the dialog, or leave the camera", "escape", self.escape, by_page=True)

    def escape(self, client: Client) -> None:
        """Close the dialog; where none is open, leave the camera that is looked through."""
        if not self.page.close_dialog(client):
            self.leave(client)

    def welcome(self, client: Client) -> None:
        """Offer the tour to a page whose browser knows of none."""
        if self.offers_tour:
            remembered(client.handle, _KEPT_AS, lambda kept: kept is None and self.tour(client))

    def show(self, client: Client) -> None:
        """Show all keys."""
        with self.page.dialog(client, "Keys and gestures"):
            search = client.handle.gui.add_text("Search", "")
            listed = client.handle.gui.add_html(self.table())

        @search.on_update
        def _(event: viser.GuiEvent[viser.GuiTextHandle]) -> None:
            if client.dialog is not None:  # what was typed last may come after its end
                put(listed, content=self.table(event.target.value))

    def table(self, wanted: str = "") -> str:
        """Return gestures and keys, or those of them that hold some words."""
        phrase = self.page.phrase
        known = (*_GESTURES, *self.page.keys, ("Ctrl K", "All commands, by name"))
        rows = "".join(
            f"<div><kbd>{html.escape(phrase(how))}</kbd><span>{html.escape(phrase(what))}</span></div>"
            for how, what in known
            if wanted.strip().lower() in f"{phrase(how)} {phrase(what)}".lower()
        )
        return f"<div class='handtrack-keys' tabindex='0'>{rows or 'No match.'}</div>"

    def tour(self, client: Client) -> None:
        """Begin the tour."""
        self._step(client, 0)

    def _step(self, client: Client, number: int) -> None:
        before, client.tour = client.tour, None
        if before is not None:
            before[0].remove()
        gui = client.handle.gui
        if number >= len(TOUR):
            client.handle.local_storage.set_item(_KEPT_AS, "yes")
            return
        title, words = (self.page.phrase(one) for one in TOUR[number])
        with gui.add_folder(f"{number + 1} of {len(TOUR)}: {title}", order=0.2) as folder:
            gui.add_html(text(words, faint=False))
            go_on = gui.add_button_group("Tour", ("Skip", _LEAVE))
        go_on.on_click(
            lambda event: self._step(
                client, len(TOUR) if event.target.value == _LEAVE else number + 1
            )
        )
        client.tour = folder, number, self.marks[number]()

    def _go_on(self) -> None:
        """Go on where a step of the tour was done."""
        for client in self.page.clients:
            if (tour := client.tour) is not None and self.marks[tour[1]]() != tour[2]:
                self._step(client, tour[1] + 1)


# ---- Keys, and entries of the palette, for the work itself: frames, tracking, keyframes, saving, export


_TEN = 10


def add_work_keys(page: Page, tracking: TrackingPanel) -> None:
    """Add them; each does what a button of the page does. Not W, A, S, D, Q, E, with whatever else: viser walks by them."""
    state = page.state
    for words, keys, act in (
        ("Undo", "cmd/ctrl+Z", partial(page.travel, back=True)),
        ("Redo", "cmd/ctrl+shift+Z", partial(page.travel, back=False)),
        ("Redo", "cmd/ctrl+Y", partial(page.travel, back=False)),
        ("Before/after: the pose before the last step", "tab", page.flip),
        ("Play or pause", "space", lambda: page.play(not state.playing)),
        ("Next frame", "arrowright", lambda: page.go_to(state.frame + 1)),
        ("Previous frame", "arrowleft", lambda: page.go_to(state.frame - 1)),
        (
            "Hide or show the model",
            "H",
            lambda: page.draw("hidden", not state.display.hidden),
        ),
        ("Ten frames on", "shift+arrowright", lambda: page.go_to(state.frame + _TEN)),
        ("Ten frames back", "shift+arrowleft", lambda: page.go_to(state.frame - _TEN)),
        ("First frame", "home", lambda: page.go_to(state.strip.start)),
        ("Last frame", "end", lambda: page.go_to(state.strip.stop - 1)),
        (
            "Set keyframe: this pose",
            "M",
            lambda: page.engine.take_pose(state.frame, "shown", state.begin_edit()),
        ),
        (
            "Remove keyframe: the tracked pose again",
            "shift+M",
            lambda: page.engine.forget_pose(state.frame, state.begin_edit()),
        ),
        ("Track: from here on", "shift+T", partial(tracking.start, "forward ▶")),
        ("Track: from here back", "shift+B", partial(tracking.start, "◀ backward")),
        ("Track: all frames", "", partial(tracking.start, "all")),
        ("Track: pause or resume", "shift+P", tracking.pause_or_go_on),
        ("Track: cancel", "shift+C", page.engine.cancel),
        ("Refine all frames together", "shift+R", page.engine.refine),
        ("Save the track", "shift+V", page.engine.save_track),
        ("Save this pose as the first frame's", "", page.engine.save_pose),
    ):
        page.key(words, keys, act)
