"""Pose: a slider for every parameter, grouped by finger; undo, reset, copy, save."""

from __future__ import annotations

import html
import math
from dataclasses import dataclass, field

import numpy as np
import viser

from handtrack.arrays import Floats, S
from handtrack_app.page.page import Page, UserEvent, number, put
from handtrack_app.page.panels.guesses import GuessesPanel
from handtrack_app.page.panels.nudging import NudgePanel
from handtrack_app.page.pins.pin_panel import PinPanel
from handtrack_app.protocol.commands import ForgetPose, SavePose, TakePose, Track
from handtrack_app.protocol.palette import (
    FINGER_COLOURS,
    FOUND,
    LIMB_COLOURS,
    PINNED,
    STATUS,
    limb_of,
)
from handtrack_app.protocol.score import ScoreSnapshot
from handtrack_app.protocol.snapshots import PoseSnapshot, SessionSnapshot

_ROW = 3  # groups in a row of buttons
_LIMBS = ("Trunk", "Head", "Left arm", "Right arm", "Left leg", "Right leg")
GROUPS = ("Hand", "Wrist", "Thumb", "Index", "Middle", "Ring", "Little", *_LIMBS)
"""folders; the first holds the root, of a body too"""
_ROOT_LABELS = {
    "root_tx": "x mm", "root_ty": "y mm", "root_tz": "z mm",
    "root_rx": "turn x °", "root_ry": "turn y °", "root_rz": "turn z °",
}  # fmt: skip
_MOTIONS = {"flex": "flex °", "abd": "spread °"}
_TURNS = {
    "flex": "flex\u00a0°", "abd": "aside\u00a0°", "twist": "twist\u00a0°", "lean": "lean\u00a0°",
    "elevate": "raise\u00a0°", "protract": "forward\u00a0°",
}  # fmt: skip
_KEEP: str = "choose …"
_REACH_MM = 500.0  # sliders of the hand's place reach this far from where it first was


def group_of(name: str) -> str:
    """Return the folder of a parameter."""
    if name.startswith("root_"):
        return "Hand"
    if (limb := limb_of(name)) is not None:
        return limb.capitalize()
    first = name.split("_", maxsplit=1)[0].capitalize()
    if first == "Spine":
        return "Trunk"
    return first if first in GROUPS else "Hand"


def label_of(name: str) -> str:
    """Return a parameter's label inside its folder."""
    if name in _ROOT_LABELS:
        return _ROOT_LABELS[name]
    first, *joint, motion = name.split("_")
    if limb_of(name) is not None or first == "spine":
        return " ".join([*(joint or [first]), _TURNS.get(motion, motion)])
    return " ".join([part.upper() for part in joint] + [_MOTIONS.get(motion, motion)])


def unit_of(name: str) -> float:
    """Return what a slider's unit is in metres or radians."""
    return 1e-3 if name.startswith("root_t") else math.pi / 180


@dataclass
class PosePanel:
    """Handles of the pose tab."""

    page: Page
    tab: viser.GuiTabHandle
    nudges: NudgePanel
    guesses: GuessesPanel
    pins: PinPanel
    sliders: dict[str, viser.GuiSliderHandle[float]] = field(default_factory=dict)
    folders: dict[str, viser.GuiFolderHandle] = field(default_factory=dict)
    """by group; one is shown, so that all its sliders are on the screen"""
    rows: list[viser.GuiButtonGroupHandle] = field(default_factory=list)
    names: tuple[str, ...] = ()
    pose: PoseSnapshot | None = None
    score: ScoreSnapshot | None = None

    def __post_init__(self) -> None:
        page, gui = self.page, self.page.gui
        with self.tab:
            self.card = gui.add_html("")
            self.edit_buttons = gui.add_button_group(
                "Edit",
                ("Undo", "Redo"),
                hint="Poses, settings, limits, filters, size and takes, as far back as you like. Ctrl-Z, Ctrl-Shift-Z.",
            )
            take = gui.add_button_group("Pose from", ("Before", "First", "Tracked"))
            self.library = gui.add_dropdown(
                "Fingers as",
                (_KEEP,),
                initial_value=_KEEP,
                hint="Set the fingers to a pose of the library.",
            )
            fit = gui.add_button(
                "Fit to the images", icon=viser.Icon.FOCUS_2, color="gray",
                hint="Solves this frame from the pose you see. Undo brings your pose back.",
            )  # fmt: skip
            save = gui.add_button(
                "Save as first-frame pose", icon=viser.Icon.DEVICE_FLOPPY, color="gray",
                hint="Writes init.json into the session: tracking starts from this pose.",
            )  # fmt: skip
            self.guesses.build()
            self.pins.build()
            self.sliders_at = gui.add_html("").order
            self.nudges.build()
        page.on(fit, lambda _: self._fit())
        self.nudges.keys.add("Fit to the images", "F", page.from_user(lambda _: self._fit()))
        page.on(self.edit_buttons, lambda event: page.travel(event.target.value == "Undo"))
        page.on(take, lambda event: self._take(event.target.value))
        page.on(self.library, self._choose)
        page.on(save, lambda _: page.send(SavePose()))

    def _fit(self) -> None:
        state = self.page.state
        if state.tracking:
            return
        frame, version = state.frame, state.begin_edit()
        state.follow = True
        self.page.send(Track(frame, frame + 1, frame, version=version))

    def _take(self, choice: str) -> None:
        state = self.page.state
        version = state.begin_edit()
        if choice == "Tracked":
            self.page.send(ForgetPose(state.frame, version))
            return
        source = {"Before": "previous", "First": "start"}.get(choice, choice)
        self.page.send(TakePose(state.frame, source, version))

    def _choose(self, event: UserEvent) -> None:
        chosen = str(event.target.value)
        if chosen != _KEEP:
            self._take(chosen)
            self.library.value = _KEEP  # so that the same pose can be chosen again

    # ---- sliders

    def fit(self, session: SessionSnapshot) -> None:
        """Make the sliders fit a session: rebuilt when its parameters change, else only limits and couplings."""
        if session.parameter_names != self.names:
            self._rebuild(session)
        self.guesses.fit(session)
        self.library.label = "Pose as" if session.kind == "body" else "Fingers as"
        self.library.options = (_KEEP, *session.pose_names)
        for s, name in enumerate(session.parameter_names):
            slider, driven = self.sliders[name], name in session.driven
            slider.disabled = driven
            slider.hint = "Follows another joint under this coupling." if driven else name
            if s >= 6:
                low, high = session.interval[s] / unit_of(name)
                slider.min, slider.max = math.floor(low), math.ceil(high)

    def _rebuild(self, session: SessionSnapshot) -> None:
        for handle in (*self.folders.values(), *self.rows):
            handle.remove()
        self.folders, self.rows, self.sliders, self.names = {}, [], {}, session.parameter_names
        members = {g: [n for n in self.names if group_of(n) == g] for g in GROUPS}
        groups = [group for group in GROUPS if members[group]]
        with self.tab:
            for i in range(0, len(groups), _ROW):
                row = self.page.gui.add_button_group(
                    "Sliders of" if i == 0 else " ", tuple(groups[i : i + _ROW]), order=self.sliders_at,
                    hint="One group's sliders at a time: all of them are on the screen.",
                )  # fmt: skip
                self.page.on(row, lambda event: self.open(str(event.target.value)))
                self.rows.append(row)
            for group in groups:
                self._add_folder(group, members[group], session)
        self.open(next(g for g in ("Index", "Left arm", *groups) if g in self.folders))

    def open(self, group: str) -> None:
        """Show the sliders of a group: a finger, a limb, `Hand` or `Wrist`."""
        if group in self.folders:
            for name, folder in self.folders.items():
                put(folder, visible=name == group)

    def _add_folder(self, group: str, members: list[str], session: SessionSnapshot) -> None:
        gui = self.page.gui
        title = "Body" if group == GROUPS[0] and session.kind == "body" else group
        folder = self.folders[group] = gui.add_folder(title, order=self.sliders_at, visible=False)
        with folder:
            for name in members:
                s = self.names.index(name)
                low, high = session.interval[s] / unit_of(name)
                if not (math.isfinite(low) and math.isfinite(high)):
                    low, high = (
                        (-_REACH_MM, _REACH_MM) if name.startswith("root_t") else (-180.0, 180.0)
                    )
                start = float(np.clip(0.0, low, high))
                low, high = float(math.floor(low)), float(math.ceil(high))
                slider = gui.add_slider(label_of(name), low, high, 0.1, start)
                self.page.on(slider, lambda event, name=name: self._moved(name, event))
                self.sliders[name] = slider

    def _moved(self, name: str, event: UserEvent) -> None:
        slider = event.target
        value = number(self.page.said(slider), slider.min, slider.max)
        if value is None:
            slider.value = round(self.page.state.value_of(name) / unit_of(name), 1)
            return
        self.page.edit_pose({name: value * unit_of(name)}, f"slider {name}")

    def show(self, pose: PoseSnapshot) -> None:
        """Move the sliders to a pose, and say where it comes from."""
        for name, value in zip(self.names, pose.values, strict=True):
            slider = self.sliders[name]
            shown = round(float(value) / unit_of(name), 1)
            if name.startswith("root_t") and not slider.min + 50 <= shown <= slider.max - 50:
                slider.min, slider.max = (
                    min(slider.min, shown - _REACH_MM),
                    max(slider.max, shown + _REACH_MM),
                )
            shown = min(max(shown, slider.min), slider.max)
            if not math.isfinite(slider.value) or abs(slider.value - shown) > 0.051:
                slider.value = shown
        self.pose = pose
        self.card.content = pose_card(pose, self.score)
        self.pins.show(pose)

    def show_score(self, score: ScoreSnapshot) -> None:
        """Take a pose's score: it shows beside that pose alone."""
        self.score = score
        if self.pose is not None:
            put(self.card, content=pose_card(self.pose, score))


def score_rows(score: ScoreSnapshot, with_energy: bool = True) -> list[tuple[str, str]]:
    """Return energy and overlap by camera, each with how it differs from the pose that was fitted last."""
    fitted = score.fitted_overlap or {}
    rows = []
    if score.energy and with_energy:
        energy = sum(score.energy.values())
        rows.append(("energy", f"{energy:.1f}{_change(energy, score.fitted_energy, 1)}"))
    for camera, share in score.overlap.items():
        rows.append((f"overlap {camera}", f"{share:.2f}{_change(share, fitted.get(camera), 2)}"))
    return rows


def _change(now: float, before: float | None, digits: int) -> str:
    moved = 0.0 if before is None else round(now - before, digits)
    return f" ({moved:+.{digits}f})" if moved else ""


def pose_card(pose: PoseSnapshot, score: ScoreSnapshot | None = None) -> str:
    """Return the lines above the sliders: frame, where the pose comes from, error against the truth, its score.

    score: of this pose, or of another, which is passed over.
    """
    word, colour = STATUS.get(pose.status, STATUS[-1])
    if pose.origin == "carried":
        word = "not tracked yet"
    elif pose.origin == "found":
        word, colour = FOUND
    elif pose.origin == "pinned":
        word, colour = PINNED
    facts = []
    if math.isfinite(pose.error_mm):
        facts.append(("mean joint error", f"{pose.error_mm:.1f} mm"))
    known = score is not None and (score.frame, score.values) == (pose.frame, tuple(pose.values))
    if math.isfinite(pose.energy):
        facts.append(("energy", f"{pose.energy:.1f}"))
    if known and score is not None:
        facts += score_rows(score, with_energy=not math.isfinite(pose.energy))
    rows = "".join(
        f"<div style='display:flex;justify-content:space-between'><span style='opacity:.65'>{html.escape(k)}</span>"
        f"<b>{html.escape(v)}</b></div>"
        for k, v in facts
    )
    if pose.accepted:
        rows += (
            "<div style='margin-top:.2em'><b>Accepted</b>: tracking and refining leave it.</div>"
        )
    if pose.note:
        rows += f"<div style='opacity:.8;line-height:1.3;margin-top:.2em'>{html.escape(pose.note)}</div>"
    return (
        "<div style='padding:.35em .9em .2em;font-size:.85em;line-height:1.6'>"
        "<div style='display:flex;justify-content:space-between;align-items:center'>"
        f"<b style='font-size:1.15em'>Frame {pose.frame}</b>"
        f"<span style='background:{colour};color:{_ink(colour)};border-radius:1em;padding:0 .7em;font-size:.9em'>"
        f"{html.escape(word)}</span></div>{rows}</div>"
    )


def _ink(colour: str) -> str:
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return "#111" if 0.3 * red + 0.59 * green + 0.11 * blue > 130 else "#fff"


def certainty_table(names: tuple[str, ...], std: Floats[S] | None) -> str:
    """Return how well each parameter is seen, as a table of fingers by joints."""
    if std is None or len(std) != len(names):
        return (
            "<div style='padding:.6em .9em;font-size:.85em;opacity:.75'>Track this frame to see how well "
            "each joint is seen.</div>"
        )
    cells: dict[str, list[str]] = {}
    for name, value in zip(names, std.tolist(), strict=True):
        row = {"root_t": "Place mm", "root_r": "Turn"}.get(name[:6], group_of(name))
        cells.setdefault(row, []).append(_cell(name, value))
    heads = {"Place mm": ("x", "y", "z"), "Thumb": ("flex", "spread", "2nd", "3rd")}
    rows = ""
    for group, row in cells.items():
        if group in heads:
            titles = "".join(
                f"<td style='text-align:center;opacity:.6'>{title}</td>" for title in heads[group]
            )
            rows += f"<tr><td></td>{titles}</tr>"
        rows += f"<tr><td style='padding:.15em .4em .15em 0;white-space:nowrap'>{_dot(group)}{group}</td>{''.join(row)}</tr>"
    return (
        "<div style='padding:.4em .9em;font-size:.8em;line-height:1.5'>"
        "<div style='opacity:.75;margin-bottom:.4em'>Standard deviation of each joint in this frame. "
        "Yellow is badly seen; <b>unseen</b> cannot be told from these images.</div>"
        "<table style='width:100%;table-layout:fixed;border-spacing:2px;border-collapse:separate'>"
        f"<colgroup><col style='width:6.2em'></colgroup>{rows}</table></div>"
    )


def _dot(group: str) -> str:
    colours = FINGER_COLOURS | LIMB_COLOURS
    red, green, blue = colours.get(group.lower(), colours["palm"])
    return (
        f"<span style='display:inline-block;width:.7em;height:.7em;border-radius:50%;margin-right:.4em;"
        f"background:rgb({red},{green},{blue})'></span>"
    )


def _cell(name: str, std: float) -> str:
    shown = std / unit_of(name)
    unit = "" if name.startswith("root_t") else "°"
    text = (
        "unseen"
        if not math.isfinite(std)
        else f"{shown:.1f}{unit}"
        if shown < 10
        else f"{shown:.0f}{unit}"
    )
    share = 1.0 if not math.isfinite(std) else min(shown / 20.0, 1.0)
    low, high = np.array([47, 75, 110]), np.array([240, 228, 66])
    red, green, blue = (low + share * (high - low)).astype(int)
    ink = "#111" if share > 0.45 else "#fff"
    title = html.escape(f"{name}: ± {text}")
    return (
        f"<td title='{title}' style='background:rgb({red},{green},{blue});color:{ink};border-radius:3px;"
        f"text-align:center;padding:.1em .2em'>{text}</td>"
    )
