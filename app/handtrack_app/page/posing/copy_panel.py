"""Copy, paste and mirror in the tab Pose: of the whole pose, or of the finger or limb whose sliders are open."""

from __future__ import annotations

import html
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import viser

from handtrack.arrays import D3, Floats
from handtrack_app.page.page import Keys, Page, put
from handtrack_app.page.posing.copied_pose import ALL, CopiedPose, read_copied, save_copied
from handtrack_app.page.posing.mirrored import mirrored
from handtrack_app.protocol.snapshots import PoseSnapshot, SessionSnapshot

if TYPE_CHECKING:
    from handtrack_app.viser_internals import KeyModifier

COPY, PASTE, MIRROR = "Copy", "Paste", "Mirror"
_NOTHING = "Nothing was copied yet that fits here: show a pose and press Copy first."
_HINT = (
    "Copies the pose you see; pastes its joints into the frame shown, also of another recording. From a left to a right hand it is "
    "mirrored by itself. 'Mirror': left and right, as you see them, change places. Alt C, Alt V, Alt M; with its place: Alt P."
)
_PART_HINT = "Of what has its sliders open: its joints alone, also into another {part}, or where the whole is. Alt Shift C, Alt Shift V."


@dataclass
class CopyPanel:
    """Handles of the rows."""

    page: Page
    keys: Keys
    axes: Callable[[viser.ClientHandle | None], Floats[D3, D3] | None]
    """the axes of a page's view, view (x right, y down, z ahead) → world"""
    group: str = ""
    """whose sliders are open"""
    session: SessionSnapshot | None = None
    pose: PoseSnapshot | None = None
    whole: viser.GuiButtonGroupHandle = field(init=False)
    part: viser.GuiButtonGroupHandle = field(init=False)
    line: viser.GuiHtmlHandle = field(init=False)

    def build(self) -> None:
        """Add the rows where the page builds now, and the keys."""
        gui, page = self.page.gui, self.page
        with gui.add_folder("Copy, paste, mirror", expand_by_default=False):
            self.whole = gui.add_button_group("Hand", (COPY, PASTE, MIRROR), hint=_HINT)
            self.part = gui.add_button_group("Finger", (COPY, PASTE), hint=_PART_HINT)
            self.line = gui.add_html("")
        page.words.on(self.whole, label="{Kind}")
        page.words.on(self.part, hint=_PART_HINT)
        acts = {COPY: self.copy, PASTE: self.paste}
        page.on(
            self.whole,
            lambda event: (
                self.mirror(event.client) if event.value == MIRROR else acts[event.value](ALL)
            ),
        )
        page.on(self.part, lambda event: acts[event.value](self.group))
        keys: tuple[tuple[str, str | None, KeyModifier | None, Callable[[], None]], ...] = (
            ("Copy the pose", "C", "alt", lambda: self.copy(ALL)),
            ("Paste the pose that was copied", "V", "alt", lambda: self.paste(ALL)),
            ("Paste it, where it was", "P", "alt", lambda: self.paste(ALL, with_place=True)),
            ("Copy the open {part}", "C", "alt+shift", lambda: self.copy(self.group)),
            ("Paste into the open {part}", "V", "alt+shift", lambda: self.paste(self.group)),
        )  # fmt: skip
        for words, key, modifier, act in keys:
            self.keys.add(words, key, page.from_user(lambda _, act=act: act()), modifier)
        mirror = page.from_user(lambda event: self.mirror(event.client))
        self.keys.add("Mirror the pose: left and right change places", "M", mirror, "alt")

    def fit(self, session: SessionSnapshot) -> None:
        """Take a session's model."""
        self.session = session
        self._say()

    def open(self, group: str) -> None:
        """The sliders of a group are open."""
        self.group = group
        put(self.part, label=group)

    def copy(self, part: str) -> None:
        """Copy the pose that is seen, or a group of it."""
        session, pose = self.session, self.pose
        if session is None or pose is None or len(pose.values) != len(session.parameter_names):
            return
        values = dict(zip(session.parameter_names, pose.values.tolist(), strict=True))
        whole = CopiedPose(ALL, session.folder, pose.frame, values)
        own = values if part == ALL else whole.pasted(session.parameter_names, part)
        save_copied(CopiedPose(part, session.folder, pose.frame, own))
        self._say()

    def paste(self, part: str, with_place: bool = False) -> None:
        """Give what was copied to the frame shown, or to a group of it."""
        copied, state = read_copied(), self.page.state
        changes = {} if copied is None else copied.pasted(state.names, part, with_place)
        if changes:
            self.page.edit_pose(changes, "Paste")
        else:
            self.page.notify("info", "Nothing to paste", _NOTHING)
        self._say()

    def mirror(self, client: viser.ClientHandle | None) -> None:
        """Let left and right of the pose change places, as a page sees them."""
        state, pose, axes = self.page.state, self.pose, self.axes(client)
        if axes is None or pose is None or not state.values:
            return
        values = np.array(state.values)
        self.page.edit_pose(mirrored(state.names, values, axes[:, 0], pose.middle), "Mirror")

    def _say(self) -> None:
        """Say what was copied."""
        copied, words = read_copied(), ""
        if copied is not None and self.session is not None:
            what = self.session.kind.capitalize() if copied.part == ALL else copied.part
            words = f"Copied: {html.escape(what)} of frame {copied.frame}"
            if copied.session != self.session.folder:
                words += ", another recording"
            words = f"<div style='padding:0 .9em .3em;font-size:.8em;opacity:.75'>{words}</div>"
        put(self.line, content=words)
