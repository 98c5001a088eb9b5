"""Where the panels stand: one at the right, with a rail of five entries, and the timeline below."""

from __future__ import annotations

from collections.abc import Callable

import viser

from handtrack_app.page.masks.mask_panel import MaskPanel
from handtrack_app.page.messages import Messages
from handtrack_app.page.page import Keys, Page, put
from handtrack_app.page.panels.cloud import CloudPanel
from handtrack_app.page.panels.constraints import LimitsPanel, SettingsPanel
from handtrack_app.page.panels.export import ExportPanel
from handtrack_app.page.panels.guesses import GuessesPanel
from handtrack_app.page.panels.live import LivePanel
from handtrack_app.page.panels.nudging import NudgePanel
from handtrack_app.page.panels.pose import PosePanel
from handtrack_app.page.panels.pose_card import certainty_table
from handtrack_app.page.panels.pose_words import group_of
from handtrack_app.page.panels.session import SessionPanel, head
from handtrack_app.page.panels.tracking import TrackingPanel
from handtrack_app.page.pins.pin_panel import PinPanel
from handtrack_app.page.posing.copy_panel import CopyPanel
from handtrack_app.page.posing.library import Library
from handtrack_app.page.posing.refit_switch import RefitSwitch
from handtrack_app.page.scene.handles import GrabKeys
from handtrack_app.page.scene.stage import Stage
from handtrack_app.page.style import dress
from handtrack_app.page.time.compared_hand import ComparedHand
from handtrack_app.page.time.next_step import NextStep
from handtrack_app.page.time.plots import PlotsPanel
from handtrack_app.page.time.review import ReviewPanel
from handtrack_app.page.time.takes import TakesPanel
from handtrack_app.page.time.timeline import TimelinePanel
from handtrack_app.page.views.help import Help
from handtrack_app.page.views.room import WIDTH, Room, colours
from handtrack_app.page.views.work_keys import add_work_keys
from handtrack_app.page.views.zoom_keys import ZoomKeys
from handtrack_app.protocol.palette import ASIDE
from handtrack_app.protocol.score import ScoreSnapshot
from handtrack_app.protocol.snapshots import (
    BEFORE,
    Notice,
    PoseSnapshot,
    ProgressSnapshot,
    SessionSnapshot,
    TimelineSnapshot,
    WorkSnapshot,
)

_ASIDE = (
    f"<div style='margin:0 .9em .4em;padding:.15em .6em;border-left:3px solid {ASIDE[1]};font-size:.85em'>"
    "<b>Before the last step.</b> Tab shows the pose as it is.</div>"
)
"""seen whatever tab is open, as the panel with the pose's card may be folded"""


class PageLayout:
    """Builds the panels once, and passes snapshots on to them."""

    def __init__(self, page: Page, stage: Stage, start_again: Callable[[], None]) -> None:
        """start_again: starts an engine that ended too often."""
        self.page, self.names = page, stage.names
        gui = page.gui
        colours(gui)
        dress(page.server)
        self.progress = ProgressSnapshot("opening", "Opening …")
        self.snapshot: SessionSnapshot | None = None
        self.saved = ""
        self.head = gui.add_html(head(None, self.progress))
        self.aside = gui.add_html(_ASIDE, visible=False)
        self.failure = gui.add_markdown("", visible=False)
        self.again = gui.add_button("Start again", icon=viser.Icon.REFRESH, visible=False)
        page.on(self.again, lambda _: start_again())
        self.messages = Messages(page)
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
        self.keys = Keys(gui, page.words)
        self.help = Help(page, self.keys)
        self.room = Room(page, self.keys)
        zoom = ZoomKeys(page, stage.looking.views, stage.looking.walls, self.keys)
        self.session = SessionPanel(
            page, view, stage.look, stage.looking.set_paint, self.keys, zoom, self.room
        )
        self.help.leave = self.session.leave
        self.tracking = TrackingPanel(page, track)
        add_work_keys(self.keys, page, self.tracking)
        self.live = LivePanel(page, track)
        self.takes = TakesPanel(page, track)
        refits = RefitSwitch(page, self.keys)
        self.compared = ComparedHand(page)
        self.guesses = GuessesPanel(page)
        stage.take_guess = self.guesses.take
        nudges = NudgePanel(page, stage.hand_middle, stage.looking.view_axes, self.keys)
        GrabKeys(page, self.keys, lambda: stage.root)
        pins = PinPanel(page, stage.grips, self.keys)
        copies = CopyPanel(page, self.keys, stage.looking.view_axes)
        joints = posing.add_tab("Joints")
        self.pose = PosePanel(page, card, joints, nudges, self.guesses, pins, copies)
        self.library = Library(page, self.pose.take)
        stage.grips.clicked = lambda bone: self.pose.open(group_of(bone))
        self.limits = LimitsPanel(page, posing.add_tab("Limits"), refits)
        with posing.add_tab("Certainty"):
            self.certainty = gui.add_html("")
        self.review = ReviewPanel(page, reviewing.add_tab("Queue"))
        self.review.add_keys(self.keys)
        self.plots = PlotsPanel(page, reviewing.add_tab("Plots"), lambda: self.timeline.window)
        self.export = ExportPanel(page, others.add_tab("Export"))
        self.settings = SettingsPanel(page, others.add_tab("Settings"), refits)
        self.masks = MaskPanel(page, others.add_tab("Masks"), stage, self.keys)
        self.cloud = CloudPanel(page, others.add_tab("Cloud"), stage.mark_box)
        self.help.marks = (
            lambda: page.state.version,
            lambda: (
                () if self.pose.pose is None else tuple(pin.pixel for pin in self.pose.pose.pins)
            ),
            lambda: self.review.at,
            lambda: self.plots.group.value,
            lambda: self.export.delivered,
        )
        self.messages.build(others.add_tab("Messages"))
        page.heard.append(self.messages.take)
        gui.main_panel.dock_right()
        gui.main_panel.set_width(WIDTH)

        below = gui.add_panel()
        timeline = below.add_tab("Timeline")
        with timeline:
            self.next = NextStep(page, self.tracking, self.guesses, self.review)
        self.review.moved = self.next.show
        self.timeline = TimelinePanel(page, timeline)
        self.timeline.add_keys(self.keys)
        self.timeline.moved = self.plots.draw
        below.float(x=16, y=-16, width=560)

    def fit(self, session: SessionSnapshot) -> None:
        """Make all panels fit a session."""
        self.snapshot = session
        self.page.words.fit(session)
        for panel in (
            self.session,
            self.pose,
            self.limits,
            self.tracking,
            self.live,
            self.settings,
            self.timeline,
            self.plots,
        ):
            panel.fit(session)
        self.head.content = head(session, self.progress, self.saved)

    def show_pose(self, pose: PoseSnapshot, newest: bool = True) -> None:
        """Show a pose in the panels. newest: what can be moved moves, too; no edit is under way."""
        self.pose.show(pose, newest)
        self.certainty.content = certainty_table(self.pose.names, pose.std)
        if not newest:
            return
        self.timeline.show_pose(pose)
        self.review.show_frame()
        self.tracking.show_frame()
        self.compared.show_frame(pose.frame)
        self.session.show_names(self.names)
        put(self.aside, visible=pose.origin == BEFORE)

    def show_score(self, score: ScoreSnapshot) -> None:
        """Show a pose's score in the panels."""
        self.pose.show_score(score)
        self.session.show_names(self.names)

    def show_timeline(self, strip: TimelineSnapshot) -> None:
        """Show the recording at a glance."""
        self.timeline.show_timeline(strip)
        self.messages.see_pose(strip.is_posed)
        self.review.show_timeline(strip)
        self.takes.show_timeline(strip)
        self.tracking.show_timeline(strip)
        self.next.show()

    def show_progress(self, progress: ProgressSnapshot) -> None:
        """Show what the worker is doing."""
        self.progress = progress
        failed = progress.state == "failed"
        put(self.again, visible=failed)
        put(self.failure, visible=failed and bool(self.failure.content))
        self.tracking.show(progress)
        self.guesses.show_progress(progress)
        self.next.show()
        put(self.head, content=head(self.snapshot, progress, self.saved))

    def show_work(self, work: WorkSnapshot) -> None:
        """Show the takes, and whether all that was done is saved."""
        self.takes.show(work)
        self.pose.show_work(work)
        self.saved = work.saved
        put(self.head, content=head(self.snapshot, self.progress, self.saved))

    def show_notice(self, notice: Notice) -> None:
        """Keep the reason of a session that cannot be opened on the page, also for those who come later."""
        if self.progress.state == "failed" and notice.level == "error":
            self.failure.content = f"**{notice.title}**\n\n{notice.text}"
            self.failure.visible = True
