"""Where the panels stand: pose at the left, everything else at the right, the timeline below."""

from __future__ import annotations

import viser

from handtrack_app.page.masks.mask_panel import MaskPanel
from handtrack_app.page.page import Keys, Page, put
from handtrack_app.page.panels.cloud import CloudPanel
from handtrack_app.page.panels.constraints import LimitsPanel, SettingsPanel
from handtrack_app.page.panels.export import ExportPanel
from handtrack_app.page.panels.guesses import GuessesPanel
from handtrack_app.page.panels.live import LivePanel
from handtrack_app.page.panels.nudging import NudgePanel
from handtrack_app.page.panels.pose import PosePanel, certainty_table
from handtrack_app.page.panels.session import SessionPanel, head
from handtrack_app.page.panels.takes import TakesPanel
from handtrack_app.page.panels.timeline import TimelinePanel
from handtrack_app.page.panels.tracking import TrackingPanel
from handtrack_app.page.scene.stage import Stage
from handtrack_app.page.style import STYLE_SHEET
from handtrack_app.protocol.commands import StartAgain
from handtrack_app.protocol.palette import BRAND
from handtrack_app.protocol.snapshots import (
    Notice,
    PoseSnapshot,
    ProgressSnapshot,
    SessionSnapshot,
    TimelineSnapshot,
    WorkSnapshot,
)


class PageLayout:
    """Builds the panels once, and passes snapshots on to them."""

    def __init__(self, page: Page, stage: Stage) -> None:
        self.page = page
        gui = page.gui
        gui.configure_theme(
            dark_mode=True,
            show_logo=False,
            show_share_button=False,
            control_width="medium",
            brand_color=BRAND,
        )
        self.progress = ProgressSnapshot("opening", "Opening …")
        self.snapshot: SessionSnapshot | None = None
        self.saved = ""
        gui.add_html(STYLE_SHEET)
        self.head = gui.add_html(head(None, self.progress))
        self.failure = gui.add_markdown("", visible=False)
        self.again = gui.add_button("Start again", icon=viser.Icon.REFRESH, visible=False)
        page.on(self.again, lambda _: page.send(StartAgain()))
        tabs = gui.add_tab_group()
        self.keys = Keys(gui)
        self._add_keys(page)
        self.session = SessionPanel(
            page, tabs.add_tab("View"), stage.look, stage.looking.set_paint, self.keys
        )
        self.tracking = TrackingPanel(page, tabs.add_tab("Track"))
        self.live = LivePanel(page, self.tracking.tab)
        self.takes = TakesPanel(page, self.tracking.tab)
        self.cloud = CloudPanel(page, tabs.add_tab("Cloud"), stage.mark_box)
        self.masks = MaskPanel(page, tabs.add_tab("Masks"), stage)
        self.settings = SettingsPanel(page, tabs.add_tab("Settings"))
        self.export = ExportPanel(page, tabs.add_tab("Export"))
        gui.main_panel.dock_right()
        gui.main_panel.set_width(342)

        left = gui.add_panel()
        self.guesses = GuessesPanel(page)
        stage.take_guess = self.guesses.take
        nudges = NudgePanel(page, stage.hand_middle, stage.view_axes, self.keys)
        self.pose = PosePanel(page, left.add_tab("Pose"), nudges, self.guesses)
        self.limits = LimitsPanel(page, left.add_tab("Limits"))
        certainty = left.add_tab("Certainty")
        with certainty:
            self.certainty = gui.add_html("")
        left.dock_left()
        left.set_width(310)

        below = gui.add_panel()
        self.timeline = TimelinePanel(page, below.add_tab("Timeline"))
        below.float(x=16, y=-16, width=560)

    def _add_keys(self, page: Page) -> None:
        add, state = self.keys.add, page.state
        add("Undo", "Z", lambda _: page.travel(back=True), "cmd/ctrl")
        add("Redo", "Z", lambda _: page.travel(back=False), "cmd/ctrl+shift")
        add("Play or pause", "P", lambda _: page.play(not state.playing))
        add("Next frame", "N", lambda _: page.go_to(state.frame + 1))
        add("Previous frame", "B", lambda _: page.go_to(state.frame - 1))
        add("Next doubtful or lost frame", "N", lambda _: self.tracking.go_to_odd(), "shift")

    def fit(self, session: SessionSnapshot) -> None:
        """Make all panels fit a session."""
        self.snapshot = session
        for panel in (
            self.session,
            self.pose,
            self.limits,
            self.tracking,
            self.live,
            self.settings,
            self.timeline,
        ):
            panel.fit(session)
        self.head.content = head(session, self.progress, self.saved)

    def show_pose(self, pose: PoseSnapshot) -> None:
        """Show a pose in the panels."""
        self.pose.show(pose)
        self.timeline.show_frame(pose.frame)
        self.certainty.content = certainty_table(self.pose.names, pose.std)

    def show_timeline(self, strip: TimelineSnapshot) -> None:
        """Show the recording at a glance."""
        self.timeline.show_timeline(strip)
        self.tracking.show_timeline(strip)

    def show_progress(self, progress: ProgressSnapshot) -> None:
        """Show what the worker is doing."""
        self.progress = progress
        failed = progress.state == "failed"
        put(self.again, visible=failed)
        put(self.failure, visible=failed and bool(self.failure.content))
        self.tracking.show(progress)
        self.guesses.show_progress(progress)
        put(self.head, content=head(self.snapshot, progress, self.saved))

    def show_work(self, work: WorkSnapshot) -> None:
        """Show the takes, and whether all that was done is saved."""
        self.takes.show(work)
        self.saved = work.saved
        put(self.head, content=head(self.snapshot, self.progress, self.saved))

    def show_notice(self, notice: Notice) -> None:
        """Keep the reason of a session that cannot be opened on the page, also for those who come later."""
        if self.progress.state == "failed" and notice.level == "error":
            self.failure.content = f"**{notice.title}**\n\n{notice.text}"
            self.failure.visible = True
