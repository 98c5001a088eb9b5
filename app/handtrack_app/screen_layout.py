"""Where the panels stand: pose at the left, everything else at the right, the timeline below."""

from __future__ import annotations

from handtrack_app.messages import Notice, PoseSnapshot, ProgressSnapshot, SessionSnapshot
from handtrack_app.panels.cloud import CloudPanel
from handtrack_app.panels.constraints import LimitsPanel, SettingsPanel
from handtrack_app.panels.export import ExportPanel
from handtrack_app.panels.guesses import GuessesPanel
from handtrack_app.panels.nudging import NudgePanel
from handtrack_app.panels.page import Page
from handtrack_app.panels.pose import PosePanel, certainty_table, travel
from handtrack_app.panels.session import SessionPanel, head
from handtrack_app.panels.style_sheet import STYLE_SHEET
from handtrack_app.panels.timeline import TimelinePanel
from handtrack_app.panels.tracking import TrackingPanel
from handtrack_app.scene.palette import BRAND
from handtrack_app.scene.stage import Stage


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
        gui.add_html(STYLE_SHEET)
        self.head = gui.add_html(head(None, self.progress))
        tabs = gui.add_tab_group()
        self.session = SessionPanel(page, tabs.add_tab("View"), stage.look)
        self.tracking = TrackingPanel(page, tabs.add_tab("Track"))
        self.cloud = CloudPanel(page, tabs.add_tab("Cloud"), stage.mark_box)
        self.settings = SettingsPanel(page, tabs.add_tab("Settings"))
        self.export = ExportPanel(page, tabs.add_tab("Export"))
        gui.main_panel.dock_right()
        gui.main_panel.set_width(342)

        left = gui.add_panel()
        self.guesses = GuessesPanel(page)
        stage.take_guess = self.guesses.take
        nudges = NudgePanel(page, stage.hand_middle, stage.axes_looked_along)
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
        self._commands()

    def _commands(self) -> None:
        gui, page = self.page.gui, self.page
        undo = gui.add_command("Undo pose edit", hotkey="Z", modifier="cmd/ctrl")
        redo = gui.add_command("Redo pose edit", hotkey="Z", modifier="cmd/ctrl+shift")
        play = gui.add_command("Play or pause", hotkey="P")
        onward = gui.add_command("Next frame", hotkey="N")
        back = gui.add_command("Previous frame", hotkey="B")
        undo.on_trigger(lambda _: travel(page, True))
        redo.on_trigger(lambda _: travel(page, False))
        play.on_trigger(lambda _: page.play(not page.state.playing))
        onward.on_trigger(lambda _: page.go_to(page.state.frame + 1))
        back.on_trigger(lambda _: page.go_to(page.state.frame - 1))

    def fit(self, session: SessionSnapshot) -> None:
        """Make all panels fit a session."""
        self.snapshot = session
        for panel in (
            self.session,
            self.pose,
            self.limits,
            self.tracking,
            self.settings,
            self.timeline,
        ):
            panel.fit(session)
        self.head.content = head(session, self.progress)

    def show_pose(self, pose: PoseSnapshot) -> None:
        """Show a pose in the panels."""
        self.pose.show(pose)
        self.timeline.show_frame(pose.frame)
        self.certainty.content = certainty_table(self.pose.names, pose.std)

    def show_progress(self, progress: ProgressSnapshot) -> None:
        """Show what the worker is doing."""
        self.progress = progress
        self.tracking.show(progress)
        self.guesses.show_progress(progress)
        self.head.content = head(self.snapshot, progress)

    def show_notice(self, notice: Notice) -> None:
        """Keep the reason of a session that cannot be opened on the page, also for those who come later."""
        if self.progress.state == "failed" and notice.level == "error":
            self.page.gui.add_markdown(f"**{notice.title}**\n\n{notice.text}")
