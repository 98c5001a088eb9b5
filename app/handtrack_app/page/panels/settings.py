"""Constraints: model, coupling, weights of the terms, the person's shape, and limits as ranges; all live."""

from __future__ import annotations

import html
import math
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import viser

from handtrack.model.shape import ShapeNumber
from handtrack.setting import Setting
from handtrack.tracking.frame.settings import SETTINGS
from handtrack_app import viser_internals as internals
from handtrack_app.page.html import escaped, text
from handtrack_app.page.page import Page, Panel, Part, put
from handtrack_app.page.panels.pose import PLACE, groups_of, label_of, unit_of
from handtrack_app.protocol import (
    CLOUD,
    IMAGES,
    KEYPOINTS,
    SILHOUETTES,
    FileKind,
    PoseSnapshot,
    SessionSnapshot,
)

_OBSERVED_AS = {
    "silhouettes": SILHOUETTES, "cloud": CLOUD, "keypoints": KEYPOINTS, "edges": IMAGES, "intensity": IMAGES,
}  # fmt: skip
"""groups of settings → what they weigh"""
_OF_FINGERS = ("model.coupling", "model.forearm", "model.spread_")
"""settings without an effect on a model whose fingers have no joints of their own"""
_OPEN = 2  # folders of limits that are open at first
_FARTHEST = 3.0  # standard deviations of adults that the slider reaches
_GROUP = "<div style='font-weight:600;margin-top:.45em;text-transform:capitalize'>{}</div>"
_ROW = (
    "<div style='display:flex;gap:.8em;justify-content:space-between{}'><span>{}</span>"
    "<span style='text-align:right;font-variant-numeric:tabular-nums'>{}</span></div>"
)
_FAINT = ";opacity:.55"


@dataclass
class SettingWidget(Part):
    """A setting where the page builds now: a choice of words, a check box, a range of two numbers, or a slider, at 0 of which it is off,
    if it can be.
    """

    known: Setting
    act: Callable[[Any], object]
    """told of a value that a user chose"""

    def build(self) -> None:
        page, known, act = self.page, self.known, self.act
        if known.words:
            values = {word: value for value, word in known.words.items()}
            self.widget: Any = page.choice(known.label, values, act, known.help)
        elif known.slider is None:
            self.widget = page.check(known.label, False, act, known.help)
        elif known.many:
            low, high, step = known.slider
            ranges = page.gui.add_multi_slider(
                known.label, low, high, step, initial_value=(low, high), min_range=step, hint=known.help
            )  # fmt: skip
            self.widget = page.bind(
                ranges, lambda pair: act(tuple(in_file(known, n) for n in pair))
            )
        else:
            hint = f"{known.help} 0: off." if known.optional and not known.slider[0] else known.help
            low, high, step = known.slider
            slider = page.gui.add_slider(known.label, low, high, step, low, hint=hint)
            self.widget = page.bind(slider, lambda shown: act(in_file(known, shown)))

    def show(self, value: object) -> None:
        """Show the value in force, where it can be shown."""
        shown = on_page(self.known, value)
        if shown is not None:
            if isinstance(self.widget, viser.GuiSliderHandle):
                put(self.widget, min=min(self.widget.min, shown), max=max(self.widget.max, shown))
            put(self.widget, value=shown)


def on_page(known: Setting, value: Any) -> Any:
    """Return how a setting's value stands on the page; None if it cannot be shown."""
    if known.words:
        return known.words.get(str(value))
    if known.kind is bool:
        return value if isinstance(value, bool) else None
    if known.many:
        return tuple(round(part) for part in value)
    if isinstance(value, bool) or not isinstance(value, int | float):
        return known.slider[0] if known.slider and known.optional else None
    shown = value / known.page_unit
    return round(shown) if known.kind is int else round(shown, 4)


def in_file(known: Setting, shown: float) -> float | int | bool:
    """Return a setting for its slider's value; False at 0 of what can be switched off."""
    if known.optional and shown <= 0:
        return False
    if known.kind is float:
        return round(float(shown) * known.page_unit, 6)
    is_odd = known.slider is not None and known.slider[2] == 2
    return 2 * int(shown // 2) + 1 if is_odd else round(shown)


@dataclass
class SavedSettings(Part):
    """What is not in session.toml yet, with buttons to save it and to go back."""

    kind: FileKind
    what: str
    """is saved, in words"""
    back_hint: str
    named: str = "{}"
    """how each is named"""

    def build(self) -> None:
        page, engine, kind = self.page, self.engine, self.kind
        self.words = page.gui.add_html("")
        page.reflect(self.words, visible=self._is_needed, content=self._words)
        self.save = page.button(
            "Save to session.toml", partial(engine.save_to_file, kind), "device-floppy",
            f"Changes only {self.what}; the previous file stays in versions/.", when=self._is_needed,
        )  # fmt: skip
        self.back = page.button(
            "Back to session.toml", partial(engine.restore_from_file, kind), "restore", self.back_hint,
            when=self._is_needed,
        )  # fmt: skip

    def _is_needed(self) -> bool:
        return bool(self.state.session.unsaved[self.kind])

    def _words(self) -> str:
        names = ", ".join(map(self.named.format, self.state.session.unsaved[self.kind]))
        return escaped(f"Not in session.toml yet: {names}.")


@dataclass
class SettingsPanel(Panel):
    """A widget for every setting that the tracker has and people change."""

    refits: RefitSwitch
    controls: dict[str, SettingWidget] = field(default_factory=dict)
    explanations: dict[str, viser.GuiHtmlHandle] = field(default_factory=dict)
    """by setting: a sentence on the value that holds"""

    def fit(self, session: SessionSnapshot) -> None:
        """Show the values in force, and which of them session.toml does not have."""
        for name, one in self.controls.items():
            value = session.settings.get(name)
            one.show(value)
            changed = " •" if name in session.unsaved["setting"] else ""
            put(one.widget, label=one.known.label + changed)
            if name in self.explanations:
                words = html.escape(one.known.explanations.get(str(value), ""))
                put(self.explanations[name], content=text(words))
        self.shape.fit(session)

    def build(self) -> None:
        page, gui, session = self.page, self.gui, self.state.session
        self.refits.build()
        self.saved = SavedSettings(
            page, "setting", "these settings in the table [tracking]", "Undo brings the changes back."
        )  # fmt: skip
        for title, settings in CONTROLS.items():
            known = [s for s in settings if s.name in session.settings]
            known = [s for s in known if s.about in ("", session.kind)]
            known = [s for s in known if on_page(s, session.settings[s.name]) is not None]
            if known:
                folder = gui.add_folder(title, expand_by_default=title in OPEN)
                with page.offer(folder, lambda known=known: any(map(self._counts, known))):
                    for setting in known:
                        self._add(setting)
        self.shape = ShapePanel(page)

    def _counts(self, setting: Setting) -> bool:
        """Return whether recording and model have what a setting is about, or somebody changed it all the same."""
        session = self.state.session
        lacking = session.kind == "hand" and "index_dip_flex" not in session.parameter_names
        about = _OBSERVED_AS.get(setting.name.partition(".")[0])
        changed = setting.name in session.unsaved["setting"]
        if lacking and setting.name.startswith(_OF_FINGERS):
            return changed
        return about is None or about in session.observed or changed

    def _add(self, setting: Setting) -> None:
        set_it = self.engine.set_setting
        page, counts = self.page, partial(self._counts, setting)
        self.controls[setting.name] = control = SettingWidget(
            page, setting, lambda value: set_it(setting.name, value, setting.label)
        )
        page.offer(control.widget, counts)
        if setting.explanations:
            self.explanations[setting.name] = page.offer(self.gui.add_html(""), counts)


@dataclass
class ShapePanel(Part):
    """A list of all numbers; the one that is chosen has a slider."""

    def build(self) -> None:
        """Add the widgets where the page builds now."""
        page, gui, session = self.page, self.gui, self.state.session
        with gui.add_folder("Shape", expand_by_default=False) as self.folder:
            page.button(
                "Fit the size", page.engine.fit_size, "ruler-measure",
                f"Fits the {session.kind}'s size to frames of this recording. With scale = fit in session.toml, the first tracking does this before.",
                when=lambda: self.state.session.can_be_found,
            )  # fmt: skip
            labels = [row.label for row in session.shape]
            self.chosen = page.choice("Number", labels, lambda _: self._show_slider(), "The number of the shape to set by hand. With scale = fit in session.toml, tracking starts from it and may change it.")  # fmt: skip
            self.slider = page.bind(
                gui.add_slider(" ", -1.0, 1.0, 0.1, initial_value=0.0), self._set
            )
            self.list = gui.add_html("")

    def fit(self, session: SessionSnapshot) -> None:
        """Show the shape in force."""
        labels = tuple(row.label for row in session.shape)
        if tuple(self.chosen.options) != labels:
            self.chosen.options = labels
        put(self.list, content=shape_list(session.shape, session.kind))
        self._show_slider()

    @property
    def _row(self) -> ShapeNumber | None:
        named = (row for row in self.state.session.shape if row.label == self.chosen.value)
        return next(named, None)

    def _show_slider(self) -> None:
        row = self._row
        if row is not None:
            reach = max(_FARTHEST * row.sigma, abs(row.value))
            put(self.slider, min=-reach, max=reach, label=row.unit, value=row.value)

    def _set(self, value: float) -> None:
        row = self._row
        if row is not None:
            self.engine.set_shape(row.name, value, f"Shape: {row.label}")


def shape_list(rows: Sequence[ShapeNumber], kind: str) -> str:
    """Return the numbers by groups: what was measured or set stands out from what is as in the mean."""
    shown = [f"Relative to the mean {kind}, ± one standard deviation. Faint: not measured."]
    for group, members in groupby(rows, lambda row: row.group):
        shown.append(_GROUP.format(html.escape(group)))
        for row in members:
            faint = not (row.is_measured or (row.std is None and row.value))
            shown.append(
                _ROW.format(_FAINT if faint else "", html.escape(row.label), html.escape(row.words))
            )
    return text("".join(shown), faint=False)


@dataclass
class LimitsPanel(Panel):
    """A range for every joint, grouped by finger."""

    refits: RefitSwitch
    ranges: dict[str, viser.GuiMultiSliderHandle[float]] = field(default_factory=dict)
    folders: list[viser.GuiFolderHandle] = field(default_factory=list)
    names: tuple[str, ...] = ()

    def build(self) -> None:
        gui = self.gui
        gui.add_html(
            escaped(
                "How far each joint may bend, in "
                "degrees. The orange tick is the present angle; it waits while tracked frames pass by. The solver stays inside, and so do the pose sliders."
            )
        )
        self.refits.build()
        self.back = self.page.button(
            "Restore the model's limits", self._restore, "restore",
            "Restores the joints marked •.", when=lambda: bool(self._changed_names),
        )  # fmt: skip

    def fit(self, session: SessionSnapshot) -> None:
        """Build the ranges for a session's joints, then show the limits in force."""
        if session.parameter_names != self.names:
            for folder in self.folders:
                folder.remove()
            self.names, self.ranges, self.folders = session.parameter_names, {}, []
            with self.tab:
                groups = groups_of(self.names)
                groups.pop(PLACE, None)
                for number, (group, members) in enumerate(groups.items()):
                    self._add_folder(group, members, session, is_open=number < _OPEN)
        for name, ranges in self.ranges.items():
            low, high = degrees(session.interval[self.names.index(name)])
            # the range itself shows no numbers: they stand in its label
            words = f"{label_of(name).removesuffix('°').rstrip()} {low:.0f}\u2060…\u2060{high:.0f}°"
            changed = " •" if name in self._changed_names else ""
            put(ranges, value=(low, high), label=words.replace("-", "−") + changed)

    def show(self, pose: PoseSnapshot) -> None:
        """Mark the present angle of every joint between its limits."""
        # where the model has just become another, the pose of that comes next
        for name, value in zip(self.names, pose.values.tolist(), strict=False):
            if name in self.ranges:
                internals.mark(self.ranges[name], float(round(math.degrees(value))))

    @property
    def _changed_names(self) -> set[str]:
        """The joints whose interval the user set; of others the model's holds."""
        session = self.state.session
        changed = (session.interval != session.own_interval).any(axis=1)
        return {name for name, one in zip(session.parameter_names, changed, strict=True) if one}

    def _add_folder(
        self, group: str, members: Sequence[str], session: SessionSnapshot, is_open: bool
    ) -> None:
        folder = self.gui.add_folder(group, expand_by_default=is_open)
        self.folders.append(folder)
        with folder:
            for name in members:
                low, high = degrees(session.own_interval[self.names.index(name)])
                ranges = self.gui.add_multi_slider(
                    label_of(name), low - 40.0, high + 40.0, 1.0, initial_value=(low, high), min_range=1.0
                )  # fmt: skip
                self.ranges[name] = self.page.bind(ranges, partial(self._changed, name))

    def _changed(self, name: str, interval: tuple[float, float]) -> None:
        unit = unit_of(name)
        self.engine.set_limits(name, (interval[0] * unit, interval[1] * unit))

    def _restore(self) -> None:
        for name in self._changed_names & self.ranges.keys():
            self.engine.set_limits(name, None, "Limits of the model")


def degrees(interval: Sequence[float]) -> tuple[float, float]:
    """Return an interval [rad] in whole degrees."""
    low, high = np.rint(np.rad2deg(interval)).tolist()
    return low, high


# ---- Which settings of the tracker the page draws, folder by folder; what each is like stands where it is declared


OPEN = ("Model", "Weights")
"""folders that are open at first"""
TOLD: dict[str, Any] = tomllib.loads(Path(__file__).with_name("settings.toml").read_text("utf-8"))
CONTROLS: dict[str, tuple[Setting, ...]] = {
    folder: tuple(SETTINGS[name] for name in names) for folder, names in TOLD["folders"].items()
}


# ---- The switch of refitting while tuning, on each tab whose widgets change what a frame is fitted by


_HINT = "Refits this frame after each change of a setting, limit or filter; the card shows the change in cost and overlap. Ctrl-Z undoes the change and its fit together; Tab shows the previous pose."


@dataclass
class RefitSwitch:
    """Handles of the switch; they show one state."""

    page: Page
    on: bool = False
    boxes: list[viser.GuiCheckboxHandle] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.page.key("Refit while tuning: on, off", "alt+R", lambda: self.turn(not self.on))

    def build(self) -> None:
        """Add a switch where the page builds now."""
        box = self.page.check("Refit as I tune", self.on, self.turn, _HINT)
        self.boxes.append(self.page.reflect(box, value=lambda: self.on))

    def turn(self, on: bool) -> None:
        """Turn it on or off."""
        self.on = on
        self.page.engine.refit_while_tuning(on)
