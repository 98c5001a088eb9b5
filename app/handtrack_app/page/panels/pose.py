"""Pose: a slider for every parameter, grouped by finger; undo, reset, copy, save."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import viser

from handtrack_app.page.page import Page, UserEvent, number, put
from handtrack_app.page.panels.guesses import GuessesPanel
from handtrack_app.page.panels.nudging import NudgePanel
from handtrack_app.page.panels.pose_card import pose_card
from handtrack_app.page.panels.pose_words import (
    group_of,
    groups_of,
    label_of,
    length_unit,
    unit_of,
)
from handtrack_app.page.pins.pin_panel import PinPanel
from handtrack_app.page.posing.copy_panel import CopyPanel
from handtrack_app.protocol.score import ScoreSnapshot
from handtrack_app.protocol.snapshots import PoseSnapshot, SessionSnapshot, WorkSnapshot

_ROW = 18  # letters of the groups in a row of buttons, in a panel of usual width
_MOST_IN_ROW = 3
_FLIP = "Before/after"
_NOW: str = "now"
_KEEP: str = "choose …"
_REACH = 500.0  # sliders of the place reach this far from where it first was, in its unit


@dataclass
class PosePanel:
    """Handles of the pose tab."""

    page: Page
    card: viser.GuiHtmlHandle
    """stands where it is seen whatever tab is open"""
    tab: viser.GuiTabHandle
    nudges: NudgePanel
    guesses: GuessesPanel
    pins: PinPanel
    copies: CopyPanel
    sliders: dict[str, viser.GuiSliderHandle[float]] = field(default_factory=dict)
    folders: dict[str, viser.GuiFolderHandle] = field(default_factory=dict)
    """by group; one is shown, so that all its sliders are on the screen"""
    rows: list[viser.GuiButtonGroupHandle] = field(default_factory=list)
    names: tuple[str, ...] = ()
    length: tuple[str, float] = ("mm", 1e-3)
    """unit of a place, and what it is in metres"""
    titles: dict[str, str] = field(default_factory=dict)
    """of the library: what a pose is called → its name"""
    pose: PoseSnapshot | None = None
    score: ScoreSnapshot | None = None

    def __post_init__(self) -> None:
        page, gui = self.page, self.page.gui
        with self.tab:
            self.edit_buttons = gui.add_button_group(
                "Edit",
                ("Undo", "Redo", _FLIP),
                hint="Poses, settings, limits, filters, size and takes, as far back as you like: Ctrl-Z, Ctrl-Y. 'Before/after' "
                "only shows the pose before the last step, and back. Key: Tab.",
            )
            self.history: viser.GuiDropdownHandle[str] = gui.add_dropdown(
                "History", (_NOW,), initial_value=_NOW,
                hint="The last steps by name. Choose one to go back to just before it, or, of those undone (↷), to make it again.",
            )  # fmt: skip
            self.sliders_at = gui.add_html("").order
            take = gui.add_button_group("Pose from", ("Before", "First", "Tracked"))
            self.library = gui.add_dropdown(
                "Fingers as",
                (_KEEP,),
                initial_value=_KEEP,
                hint="Set all but the place to a pose of the library.",
            )
            pictures = gui.add_button(
                "Poses in pictures", icon=viser.Icon.PHOTO, color="gray",
                hint="The whole library as it looks; a click takes a pose.",
            )  # fmt: skip
            fit = gui.add_button(
                "Fit frame", icon=viser.Icon.FOCUS_2, color="gray",
                hint="Solves this frame from the pose you see. Undo brings your pose back.",
            )  # fmt: skip
            save = gui.add_button(
                "Save as first-frame pose", icon=viser.Icon.DEVICE_FLOPPY, color="gray",
                hint="Writes init.json into the session: tracking starts from this pose.",
            )  # fmt: skip
            self.guesses.build()
            self.pins.build()
            self.copies.build()
            self.nudges.build()
        page.on(fit, lambda _: self._fit())
        self.nudges.keys.add("Fit frame", "F", page.from_user(lambda _: self._fit()))
        page.on(self.edit_buttons, lambda event: self._edit(str(event.value)))
        page.on(self.history, lambda event: self._go_back(str(event.value)))
        page.on(take, lambda event: self.take(event.value))
        page.on(self.library, self._choose)
        page.on(pictures, self._ask)
        self.nudges.keys.add("Poses in pictures", "L", page.from_user(self._ask), "alt")
        page.on(save, lambda _: page.engine.save_pose())

    def _edit(self, which: str) -> None:
        if which == _FLIP:
            self.page.flip()
        else:
            self.page.travel(which == "Undo")

    def show_work(self, work: WorkSnapshot) -> None:
        """Name the steps that can be undone, and those that were."""
        again = [f"↷ {n}: {words}" for n, words in enumerate(work.undone, 1)][::-1]
        steps = (*again, _NOW, *(f"↶ {n}: {words}" for n, words in enumerate(work.past, 1)))
        if self.history.options != steps:
            self.history.options = steps
        put(self.history, value=_NOW)

    def _go_back(self, chosen: str) -> None:
        if chosen != _NOW:
            self.history.value = _NOW
            sign, number = chosen.partition(":")[0].split()
            self.page.travel(sign == "↶", int(number))

    def _fit(self) -> None:
        state = self.page.state
        if state.tracking:
            return
        frame, version = state.frame, state.begin_edit()
        state.follow = True
        self.page.engine.track(frame, frame + 1, frame, version=version)

    def take(self, choice: str) -> None:
        """Take the frame's pose from elsewhere: a pose of the library, or as a button says."""
        state = self.page.state
        version = state.begin_edit()
        if choice == "Tracked":
            self.page.engine.forget_pose(state.frame, version)
            return
        source = {"Before": "previous", "First": "start"}.get(choice, choice)
        self.page.engine.take_pose(state.frame, source, version)

    def _choose(self, event: UserEvent) -> None:
        chosen = str(event.value)
        if chosen != _KEEP:
            self.take(self.titles[chosen])
            self.library.value = _KEEP  # so that the same pose can be chosen again

    def _ask(self, event: UserEvent) -> None:
        self.page.engine.want_library(event.client.client_id)

    # ---- sliders

    def fit(self, session: SessionSnapshot) -> None:
        """Make the sliders fit a session: rebuilt when its parameters change, else only limits and couplings."""
        if session.parameter_names != self.names:
            self._rebuild(session)
        self.guesses.fit(session)
        self.copies.fit(session)
        self.nudges.fit(session)
        self.pins.fit(session)
        self.library.label = "Pose as" if session.kind == "body" else "Fingers as"
        self.titles = {pose.title: pose.name for pose in session.poses}
        self.library.options = (_KEEP, *self.titles)
        for s, name in enumerate(session.parameter_names):
            slider, driven = self.sliders[name], name in session.driven
            slider.disabled = driven
            slider.hint = "Follows another joint under this coupling." if driven else name
            if s >= 6:
                low, high = session.interval[s] / self._unit(name)
                slider.min, slider.max = math.floor(low), math.ceil(high)

    def _rebuild(self, session: SessionSnapshot) -> None:
        for handle in (*self.folders.values(), *self.rows):
            handle.remove()
        self.folders, self.rows, self.sliders, self.names = {}, [], {}, session.parameter_names
        self.length = length_unit(session.reach_m)
        groups = groups_of(self.names)
        with self.tab:
            for i, named in enumerate(_rows(list(groups))):
                row = self.page.gui.add_button_group(
                    "Edit joints of" if i == 0 else " ", named, order=self.sliders_at,
                    hint="One group's sliders at a time: all of them are on the screen.",
                )  # fmt: skip
                self.page.on(row, lambda event: self.open(str(event.value)))
                self.rows.append(row)
            for group, members in groups.items():
                self._add_folder(group, members, session)
        self.open(next(g for g in ("Index", "Left arm", *groups) if g in self.folders))

    def _unit(self, name: str) -> float:
        return unit_of(name, self.length[1])

    def open(self, group: str) -> None:
        """Show the sliders of a group: a finger, a limb, the place."""
        if group in self.folders:
            for name, folder in self.folders.items():
                put(folder, visible=name == group)
            self.copies.open(group)

    def _add_folder(self, group: str, members: Sequence[str], session: SessionSnapshot) -> None:
        gui = self.page.gui
        folder = self.folders[group] = gui.add_folder(group, order=self.sliders_at, visible=False)
        with folder:
            for name in members:
                s = self.names.index(name)
                low, high = session.interval[s] / self._unit(name)
                if not (math.isfinite(low) and math.isfinite(high)):
                    low, high = (-_REACH, _REACH) if name.startswith("root_t") else (-180.0, 180.0)
                start = float(np.clip(0.0, low, high))
                low, high = float(math.floor(low)), float(math.ceil(high))
                slider = gui.add_slider(label_of(name, self.length[0]), low, high, 0.1, start)
                self.page.on(slider, lambda event, name=name: self._moved(name, event))
                self.sliders[name] = slider

    def _moved(self, name: str, event: UserEvent) -> None:
        slider = event.target
        value = number(event.value, slider.min, slider.max)
        if value is None:
            slider.value = round(self.page.state.value_of(name) / self._unit(name), 1)
            return
        words = f"{group_of(name)} {label_of(name, '').removesuffix('°').strip()}"
        # nobody tells when a slider is let go: moves of it, and nothing else between, are one drag
        self.page.edit_pose({name: value * self._unit(name)}, words, f"slider {name}", True)

    def show(self, pose: PoseSnapshot, newest: bool = True) -> None:
        """Say where a pose comes from, and move the sliders to it.

        newest: no edit is under way to another; else the sliders stay where whoever edits has them.
        """
        for name, value in zip(self.names, pose.values, strict=True) if newest else ():
            slider = self.sliders[name]
            shown = round(float(value) / self._unit(name), 1)
            if name.startswith("root_t") and not slider.min + 50 <= shown <= slider.max - 50:
                slider.min, slider.max = (
                    min(slider.min, shown - _REACH),
                    max(slider.max, shown + _REACH),
                )
            shown = min(max(shown, slider.min), slider.max)
            if not math.isfinite(slider.value) or abs(slider.value - shown) > 0.051:
                slider.value = shown
        self.pose = self.copies.pose = pose
        if self.page.state.playing:
            pose = replace(pose, note="")  # what comes and goes would move all below it
        self.card.content = pose_card(pose, self.score)
        self._show_pins(pose)

    def show_score(self, score: ScoreSnapshot) -> None:
        """Take a pose's score: it shows beside that pose alone."""
        self.score = score
        if self.pose is not None:
            put(self.card, content=pose_card(self.pose, score))
            self._show_pins(self.pose)

    def _show_pins(self, pose: PoseSnapshot) -> None:
        score = self.score
        known = score is not None and score.is_of(pose.frame, pose.values)
        self.pins.show(pose, score if known else None)


def _rows(groups: list[str]) -> list[tuple[str, ...]]:
    """Return the groups in rows of buttons that fit into the panel."""
    rows: list[tuple[str, ...]] = [()]
    for group in groups:
        if len("".join((*rows[-1], group))) > _ROW or len(rows[-1]) == _MOST_IN_ROW:
            rows.append(())
        rows[-1] = (*rows[-1], group)
    return rows
