"""Pose: a slider for every parameter, grouped by finger; undo, reset, copy, save."""

from __future__ import annotations

import html
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
import viser

from handtrack.arrays import D3, Floats, S
from handtrack.detector.weights import DOWNLOAD_MB, has_weights
from handtrack_app.page.html import chip, escaped, line, rgb, row, table, text
from handtrack_app.page.page import Panel, Part, put
from handtrack_app.page.scene.grips import Grips, near_joint_m
from handtrack_app.palette import (
    ASIDE,
    FINGER_COLOURS,
    GHOSTS,
    LIMB_COLOURS,
    PINNED,
    REFITTED,
    SEARCH_RESULT,
    STATUS,
    light_of,
    limb_of,
)
from handtrack_app.protocol import (
    BEFORE,
    IMAGES,
    GuessesSnapshot,
    PinCard,
    PoseSnapshot,
    ScoreSnapshot,
    SessionSnapshot,
    WorkSnapshot,
)

_ROW = 17  # letters of the groups in a row of buttons, in a panel of usual width
_MOST_IN_ROW = 3
_FLIP = "Before/after"
_NOW: str = "now"
_KEEP: str = "choose …"
_REACH = 500.0  # sliders of the place reach this far from where it first was, in its unit


@dataclass
class PosePanel(Panel):
    """Handles of the pose tab."""

    card: viser.GuiHtmlHandle
    """stands where it is seen whatever tab is open"""
    grips: Grips
    pose: PoseSnapshot
    sliders: dict[str, viser.GuiSliderHandle[float]] = field(default_factory=dict)
    folders: dict[str, viser.GuiFolderHandle] = field(default_factory=dict)
    """by group; one is shown, so that all its sliders are on the screen"""
    rows: list[viser.GuiButtonGroupHandle] = field(default_factory=list)
    names: tuple[str, ...] = ()
    length: tuple[str, float] = ("mm", 1e-3)
    """unit of a place, and what it is in metres"""
    score: ScoreSnapshot | None = None
    copied: dict[str, float] = field(default_factory=dict)
    """joint parameters [m, rad]"""

    def build(self) -> None:
        page, gui, session = self.page, self.gui, self.state.session
        self.edit_buttons = page.buttons(
            "Edit", ("Undo", "Redo", _FLIP), self._edit,
            "Poses, settings, limits, filters, size and takes, as far back as you like: Ctrl-Z, Ctrl-Y. 'Before/after' "
            "only shows the pose before the last step, and back. Key: Tab.",
        )  # fmt: skip
        self.history = page.choice(
            "History", (_NOW,), self._go_back,
            "The last steps. Choose one to undo it and all after it, or an undone one (↷) to redo it.",
        )  # fmt: skip
        self.sliders_at = gui.add_html("").order
        page.buttons("Pose from", ("Before", "First", "Tracked"), self.take)
        self.library = page.choice(
            "Pose as" if session.kind == "body" else "Fingers as", (_KEEP, *session.poses),
            lambda chosen: self._choose(session.poses.get(chosen)),
            "Sets the joint angles to a pose of the library.",
        )  # fmt: skip
        page.offer(self.library, self._is_in_library)
        page.button(
            "Fit frame", self._fit, "focus-2",
            "Fits the model to this frame, starting from the pose you see. Undo returns to that pose.",
        )  # fmt: skip
        page.button(
            "Save as first-frame pose", page.engine.save_pose, "device-floppy",
            "Writes the pose you see to the session's init.json. Tracking will start from it, at this frame.",
        )  # fmt: skip
        self.guesses = GuessesPanel(page)
        self.pins = PinPanel(page, self.grips)
        page.buttons(
            "Pose", ("Copy", "Paste"), lambda name: self.copy() if name == "Copy" else self.paste(),
            "Copies the pose you see; pastes its joints into the frame shown. Alt C, Alt V.",
        )  # fmt: skip
        self.copied_from = gui.add_html("")
        page.key("Fit frame", "F", self._fit)
        page.key("Copy the pose", "alt+C", self.copy)
        page.key("Paste the pose that was copied", "alt+V", self.paste)

    def _edit(self, which: str) -> None:
        if which == _FLIP:
            self.page.flip()
        else:
            self.page.travel(which == "Undo")

    def show_work(self, work: WorkSnapshot) -> None:
        """Name the steps that can be undone, and those that were."""
        again = [f"↷ {n}: {words}" for n, words in enumerate(work.undone, 1)][::-1]
        steps = (*again, _NOW, *(f"↶ {n}: {words}" for n, words in enumerate(work.past, 1)))
        put(self.history, options=steps, value=_NOW)

    def _go_back(self, chosen: str) -> None:
        if chosen != _NOW:
            self.history.value = _NOW
            sign, number = chosen.partition(":")[0].split()
            self.page.travel(sign == "↶", int(number))

    def _fit(self) -> None:
        state = self.state
        if state.tracking:
            return
        frame, version = state.frame, state.begin_edit()
        state.follow = True
        self.engine.track(frame, frame + 1, frame, version=version)

    def take(self, choice: str) -> None:
        """Take the frame's pose from elsewhere: a pose of the library, or as a button says."""
        state = self.state
        version = state.begin_edit()
        if choice == "Tracked":
            self.engine.forget_pose(state.frame, version)
            return
        source = {"Before": "previous", "First": "start"}.get(choice, choice)
        self.engine.take_pose(state.frame, source, version)

    def _is_in_library(self) -> bool:
        """Return whether the model has the joints of the library's poses, as simpler hands have not."""
        session = self.state.session
        return session.kind == "body" or "Index" in groups_of(session.parameter_names)

    def _choose(self, name: str | None) -> None:
        if name is not None:
            self.take(name)
            self.library.value = _KEEP  # so that the same pose can be chosen again

    def copy(self) -> None:
        """Copy the pose that is seen."""
        if len(self.pose.values) == len(self.names):  # else it is of a model that is left
            self.copied = dict(zip(self.names, self.pose.values.tolist(), strict=True))
            put(self.copied_from, content=escaped(f"Copied: frame {self.pose.frame}"))

    def paste(self) -> None:
        """Give the joints of what was copied to the frame shown; it stays where it is."""
        changes = {name: self.copied[name] for name in self.names[6:] if name in self.copied}
        if changes:
            self.page.edit_pose(changes, "Paste")
        else:
            nothing = "No copied pose fits here. Show a pose and press Copy first."
            self.page.notify("info", "Nothing to paste", nothing)

    # ---- sliders

    def fit(self, session: SessionSnapshot) -> None:
        """Make the sliders fit a session: rebuilt when its parameters change, else only limits and couplings."""
        if session.parameter_names != self.names:
            self._rebuild(session)
        for s, name in enumerate(session.parameter_names):
            slider, driven = self.sliders[name], name in session.driven
            slider.disabled = driven
            slider.hint = "Follows another joint under this coupling." if driven else name
            if s >= 6:
                low, high = session.interval[s] / self._unit(name)
                slider.min, slider.max = math.floor(low), math.ceil(high)

    def _rebuild(self, session: SessionSnapshot) -> None:
        groups, length = groups_of(session.parameter_names), length_unit(session.reach_m)
        kept = set(session.parameter_names) if length == self.length else set()
        for buttons in self.rows:
            buttons.remove()
        # what stays is not made anew: the page would apply an update after the removal that followed
        for name in set(self.sliders) - kept:
            self.sliders.pop(name).remove()
        for group in set(self.folders) - set(groups):
            self.folders.pop(group).remove()
        self.rows, self.names, self.length = [], session.parameter_names, length
        with self.tab:
            for i, named in enumerate(_rows(list(groups))):
                row = self.gui.add_button_group(
                    "Edit joints of" if i == 0 else " ", named, order=self.sliders_at,
                    hint="The joints whose sliders are shown.",
                )  # fmt: skip
                self.rows.append(self.page.bind(row, self.open))
            for group, members in groups.items():
                self._add_folder(group, members)
        self.open(next(g for g in ("Index", "Left arm", *groups) if g in self.folders))

    def _unit(self, name: str) -> float:
        return unit_of(name, self.length[1])

    def open(self, group: str) -> None:
        """Show the sliders of a group: a finger, a limb, the place."""
        if group in self.folders:
            for name, folder in self.folders.items():
                put(folder, visible=name == group)
            self.move_sliders()

    def _add_folder(self, group: str, members: Sequence[str]) -> None:
        gui = self.gui
        if group not in self.folders:
            below = self.sliders_at + 0.5  # the rows of groups, which are made anew oftener
            self.folders[group] = gui.add_folder(group, order=below, visible=False)
        with self.folders[group]:
            for name in members:
                if name in self.sliders:
                    continue
                # of joints, `fit` narrows it to their limits
                most = _REACH if name.startswith("root_t") else 180.0
                slider = gui.add_slider(label_of(name, self.length[0]), -most, most, 0.1, 0.0)
                words = f"{group} {label_of(name, '').removesuffix('°').strip()}"
                self.page.on(slider, partial(self._moved, name, self._unit(name), words))
                self.sliders[name] = slider

    def _moved(self, name: str, unit: float, words: str, _: object, value: float) -> None:
        # nobody tells when a slider is let go: moves of it, and nothing else between, are one drag
        self.page.edit_pose({name: value * unit}, words, f"slider {name}", True)

    def show(self, pose: PoseSnapshot, newest: bool = True) -> None:
        """Say where a pose comes from, and move the sliders to it.

        newest: no edit is under way to another; else the sliders stay where whoever edits has them.
        """
        self.pose = pose
        if newest:
            self.move_sliders()
        self._show_card(pose)

    def move_sliders(self, hidden: bool = False) -> None:
        """Move the sliders of the group that is open to the pose; or those of all others."""
        if len(self.pose.values) != len(self.names):
            return  # of a model that is left
        for name, value in zip(self.names, self.pose.values, strict=True):
            if self.folders[group_of(name)].visible == hidden:
                continue
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

    def show_score(self, score: ScoreSnapshot) -> None:
        """Take a pose's score: it shows beside that pose alone."""
        self.score = score
        self._show_card(self.pose)

    def _show_card(self, pose: PoseSnapshot) -> None:
        score = self.score
        if score is not None and not score.is_of(pose.frame, pose.values):
            score = None
        if self.state.playing:  # what comes and goes would move all below it
            put(self.card, content=pose_card(replace(pose, note="")))
        else:
            put(self.card, content=pose_card(pose, score))
        self.pins.show(pose, score)


def _rows(groups: list[str]) -> list[tuple[str, ...]]:
    """Return the groups in rows of buttons that fit into the panel."""
    rows: list[tuple[str, ...]] = [()]
    for group in groups:
        if len("".join((*rows[-1], group))) > _ROW or len(rows[-1]) == _MOST_IN_ROW:
            rows.append(())
        rows[-1] = (*rows[-1], group)
    return rows


# ---- The card of a pose: frame, where it comes from, its score; and how well each of its joints is seen


_ORIGINS = {
    "carried": ("not tracked yet", STATUS[-1][1]),
    "found": SEARCH_RESULT,
    "pinned": PINNED,
    "refitted": REFITTED,
    BEFORE: ASIDE,
}
"""of poses that no status tells of: word and colour"""
_BEFORE_WORDS = line(
    "You look at what was <b>before the last step</b>. Nothing is changed; <kbd>Tab</kbd> shows what is."
)


_MOST_CAMERAS = 3
"""whose overlaps are listed: of any more, they would move all that is below"""


def score_rows(score: ScoreSnapshot, with_cost: bool) -> str:
    """Return cost and overlap by camera, each with how it differs from the pose that was fitted last; of many cameras the lowest, and
    all in a tooltip.
    """
    fitted, rows = score.fitted_overlap or {}, ""
    if score.energy and with_cost:
        cost = sum(score.energy.values())
        rows += row("cost", f"{cost:.1f}{_change(cost, score.fitted_cost, 1)}")
    each = {c: f"{c}\u00a0{s:.2f}{_change(s, fitted.get(c), 2)}" for c, s in score.overlap.items()}
    everyone = ", ".join(each.values())
    if len(each) > _MOST_CAMERAS:
        lowest = sorted(each, key=lambda c: score.overlap[c])[:_MOST_CAMERAS]
        rows += row("lowest overlaps", ", ".join(each[c] for c in lowest), everyone)
    elif each:
        rows += row("overlap", everyone)
    return rows


def _change(now: float, before: float | None, digits: int) -> str:
    moved = 0.0 if before is None else round(now - before, digits)
    return f" ({moved:+.{digits}f})" if moved else ""


def status_of(pose: PoseSnapshot) -> tuple[str, str]:
    """Return where a pose comes from, in a word, and the word's colour."""
    return _ORIGINS.get(pose.origin, STATUS.get(pose.status, STATUS[-1]))


def pose_card(pose: PoseSnapshot, score: ScoreSnapshot | None = None) -> str:
    """Return the lines above the sliders: frame, where the pose comes from, error against the truth, its score."""
    word, colour = status_of(pose)
    rows = ""
    if math.isfinite(pose.error_mm):
        rows += row("mean joint error", f"{pose.error_mm:.1f} mm")
    if math.isfinite(pose.energy):
        rows += row("cost", f"{pose.energy:.1f}")
    if score is not None:
        rows += score_rows(score, with_cost=not math.isfinite(pose.energy))
    if pose.origin == BEFORE:
        rows += _BEFORE_WORDS
    if pose.accepted:
        rows += line("<b>Accepted</b>: tracking and refining leave it.")
    if pose.note:
        what, bracket, more = html.escape(pose.note).partition(" (")
        detail = f"<span class='handtrack-detail'>{bracket}{more}</span>"
        rows += line(f"<span title='{html.escape(pose.note)}'>{what}{detail}</span>")
    return text(
        "<div style='display:flex;justify-content:space-between;align-items:center'>"
        f"<b class='handtrack-frame' style='font-size:1.1em'>Frame {pose.frame}</b>"
        f"<span style='background:{colour};color:{ink_on(list(bytes.fromhex(colour[1:])))};border-radius:1em;padding:0 .7em'>"
        f"{html.escape(word)}</span></div>{rows}",
        faint=False,
        kind="handtrack-score",
    )


def ink_on(ground: Sequence[int] | Floats[D3]) -> str:
    """Return the text's colour on a ground of red, green and blue, 0 … 255: one of the two has a contrast above 4.5 (WCAG 2.2)."""
    return "#000" if light_of(ground) @ (0.2126, 0.7152, 0.0722) > 0.179 else "#fff"


def certainty_table(names: tuple[str, ...], std: Floats[S] | None) -> str:
    """Return how well each parameter is seen, as a table of fingers by joints."""
    if std is None or len(std) != len(names):
        return text("Track this frame to see how well each joint is observed.")
    cells: dict[str, list[str]] = {}
    for name, value in zip(names, std.tolist(), strict=True):
        row = "Rotation" if name.startswith("root_r") else group_of(name)
        cells.setdefault(row, []).append(_cell(name, value))
    heads = {PLACE: ("x mm", "y mm", "z mm"), "Thumb": ("flex", "abd.", "2nd", "3rd")}
    rows, colours = "", FINGER_COLOURS | LIMB_COLOURS
    for group, row in cells.items():
        if group in heads:
            titles = "".join(
                f"<td style='text-align:center;opacity:.85'>{title}</td>" for title in heads[group]
            )
            rows += f"<tr><td></td>{titles}</tr>"
        dot = chip(rgb(colours.get(group.lower(), colours["palm"])))
        rows += f"<tr><td style='padding:.15em .4em .15em 0;white-space:nowrap'>{dot}{group}</td>{''.join(row)}</tr>"
    return text(
        "Standard deviation of each joint in this frame. Yellow is uncertain; <b>∞</b> is not determined by these images."
    ) + text(
        "<table style='width:100%;table-layout:fixed;border-spacing:2px;border-collapse:separate'>"
        f"<colgroup><col style='width:6.2em'></colgroup>{rows}</table>",
        faint=False,
    )


def _cell(name: str, std: float) -> str:
    shown = std / unit_of(name)
    text = f"{shown:.{int(shown < 10)}f}{'' if name.startswith('root_t') else '°'}"
    if not math.isfinite(std):
        text = "∞"
    low, high = np.array([47, 75, 110]), np.array([240, 228, 66])
    ground = low + np.fmin(shown / 20.0, 1.0) * (high - low)
    title = html.escape(f"{name}: ± {text}")
    return (
        f"<td title='{title}' style='background:{rgb(ground)};color:{ink_on(ground)};border-radius:3px;"
        f"text-align:center;padding:.1em .2em'>{text}</td>"
    )


# ---- Guesses: find the hand without a first pose, and take one of the poses that explain a frame


_HERE, _ANYWHERE = "this frame", "best frame"
_FIND_HINTS = {
    "hand": "Searches silhouettes, clouds and detected joints for an open or half-open hand. Needs no first pose.",
    "body": "Searches detected joints. Needs no first pose.",
}
_TITLES = {"found": "Detected poses", "carried": "Trajectory hypotheses"}


@dataclass
class GuessesPanel(Part):
    """Handles of the search and of the ranked list."""

    guesses: GuessesSnapshot | None = None

    def build(self) -> None:
        """Add the widgets where the page builds now."""
        gui, page, kind = self.gui, self.page, self.state.kind
        self.find = page.buttons(
            f"Detect {kind}", (_HERE, _ANYWHERE), lambda name: self.search(name == _ANYWHERE), _FIND_HINTS[kind],
            lambda: self.state.session.can_be_found and self.state.is_free(),
        )  # fmt: skip
        self.fetch = page.button(
            f"Install detector ({DOWNLOAD_MB} MB)", lambda: self.search(fetch=True), "download",
            "Two networks that find a hand in the images of two cameras, whatever its posture, are not installed yet. This fetches them "
            "by pip, once for all recordings. Google's, Apache License 2.0.", when=self._can_fetch,
        )  # fmt: skip
        self.cancel = page.button(
            "Cancel the search", page.engine.cancel, "player-stop", color="red", when=self._is_searching
        )  # fmt: skip
        self.folder = page.offer(
            gui.add_folder("Other poses"), lambda: bool(self.guesses and self.guesses.guesses)
        )
        with self.folder:
            self.list = gui.add_html("")
            self.takes = page.buttons(
                "Take", ("1",), lambda rank: self.take(int(rank) - 1), "Set this frame's pose to one of these."
            )  # fmt: skip
            page.toggle(
                "Ghosts",
                "ghosts",
                "Draw these poses in the scene, each in the colour of its number.",
            )

    def search(self, anywhere: bool = False, fetch: bool = False) -> None:
        """Detect the model in the frame shown, or in the surest of several."""
        state = self.state
        state.playing = False
        self.engine.find_hand(None if anywhere else state.frame, fetch)

    def take(self, rank: int) -> None:
        """Take one of the list."""
        known, state = self.guesses, self.state
        if known is not None and rank < len(known.guesses):
            self.engine.take_guess(known.frame, rank, state.begin_edit())

    def show(self, guesses: GuessesSnapshot) -> None:
        """Show the list of a frame; take the surest of what was just found."""
        self.guesses = guesses
        ranks = tuple(str(rank + 1) for rank in range(len(guesses.guesses)))
        if ranks:
            put(self.takes, options=ranks)
        self.list.content = _table(guesses)
        if guesses.is_new:
            self.take(0)

    def _is_searching(self) -> bool:
        progress = self.state.progress
        return progress.state == "preparing" and progress.job == "finding"

    def _can_fetch(self) -> bool:
        """Return whether a detector helps here, and there is none."""
        session = self.state.session
        helps = session.kind == "hand" and IMAGES in session.observed and len(session.cameras) > 1
        return helps and self.state.is_free() and not has_weights()


def _percent(share: float) -> str:
    return f"{100 * min(share, 0.99):.0f} %" if share >= 0.01 else "below 1 %"


def _table(guesses: GuessesSnapshot) -> str:
    """Return what is known of each pose of the list."""
    rows = "".join(
        f"<div style='display:flex;gap:.5em'><span style='flex:none;width:.7em;height:.7em;margin-top:.35em;"
        f"border-radius:50%;background:rgb{GHOSTS[rank]}'></span><span><b>{rank + 1}: "
        f"{_percent(guess.share)}</b> {html.escape(guess.words)}</span></div>"
        for rank, guess in enumerate(guesses.guesses)
    )
    title = _TITLES.get(guesses.kind, "")
    return text(f"<b>{title}, frame {guesses.frame}</b>{rows}", faint=False)


# ---- Pins: what holds the rest of the hand, which pins a frame has, and buttons to drop them


FITTED, LEAST = "fit to images", "keep"
_NO_PINS = (
    "<div class='handtrack-text handtrack-faint'>Open a camera view (key 1, 2 …) and drag a "
    "joint or a segment to where the picture has it. The same joint in a second camera fixes the point.</div>"
)


@dataclass
class PinPanel(Part):
    """Handles of the folder."""

    grips: Grips
    pins: tuple[PinCard, ...] = ()
    _before: tuple[int, float] | None = None
    """a frame, and the cost of its pose before the pins"""

    def build(self) -> None:
        """Add the folder where the page builds now."""
        gui, page = self.gui, self.page
        with gui.add_folder("Pins"):
            self.held = page.choice(
                "Other joints", (FITTED, LEAST), self._hold,
                "While you drag a joint: fit the other joints to the images, or change them as little as possible.",
            )  # fmt: skip
            self.list = gui.add_html(_NO_PINS)
            page.button(
                "Remove the last pin", self._drop_last, "pin",
                "Removes the pin that was placed last. Ctrl-Z undoes the last drag instead.", when=lambda: bool(self.pins),
            )  # fmt: skip
            page.button(
                "Drop all pins of this frame", lambda: self._drop(None), "pinned-off",
                "The tracked pose shows again.", when=lambda: bool(self.pins),
            )  # fmt: skip
        page.key("Remove the last pin", "Backspace", self._drop_last)
        fit_or_keep = "Pins: fit other joints to the images, or keep them"
        page.key(fit_or_keep, "shift+X", self._switch)

    def show(self, pose: PoseSnapshot, score: ScoreSnapshot | None) -> None:
        """Show the pins of a frame. score: of this pose, or None while it is not known."""
        cost = None if score is None or not score.energy else sum(score.energy.values())
        if not pose.pins and cost is not None:
            self._before = pose.frame, cost
        gain = None
        if cost is not None and self._before is not None and self._before[0] == pose.frame:
            gain = cost - self._before[1]
        self.pins = pose.pins
        near_m = near_joint_m(self.state.session)
        put(self.list, content=pin_list(pose.pins, near_m, gain) if pose.pins else _NO_PINS)

    def _hold(self, choice: str) -> None:
        self.grips.by_images = choice == FITTED

    def _switch(self) -> None:
        self.held.value = LEAST if self.grips.by_images else FITTED
        self._hold(self.held.value)

    def _drop_last(self) -> None:
        if self.pins:
            self._drop(len(self.pins) - 1)

    def _drop(self, which: int | None) -> None:
        state = self.state
        version = state.begin_edit()
        self.engine.drop_pins(state.frame, which, version, self.grips.by_images)


def pin_list(pins: tuple[PinCard, ...], near_m: float, gain: float | None = None) -> str:
    """Return the pins of a frame as a table: what, where, and by how much the pose misses it. near_m: a pin that is missed by more
    contradicts something; gain: of the cost, by the pins, where it is known.
    """
    rows = "".join(
        f"<tr class='{'handtrack-error' if pin.off_m > near_m else ''}'><td>{html.escape(pin.words)}</td>"
        f"<td>{html.escape(pin.camera)}</td><td class='handtrack-number'>{pin.off_px:.1f} px</td></tr>"
        for pin in pins
    )
    mean = sum(pin.off_px for pin in pins) / len(pins)
    parts = dict.fromkeys(group_of(pin.words.replace(" ", "_")).lower() for pin in pins)
    head = f"{', '.join(parts)}: {len(pins)} pin{'' if len(pins) == 1 else 's'}, {mean:.1f} px"
    head += "" if gain is None else f", cost {gain:+.0f}".replace("-", "−")
    if any(pin.off_m > near_m for pin in pins):
        head += ". The red ones contradict the others or the joint limits."
    return text(head, faint=False) + table(rows)


# ---- Joint parameters as the page names them: by group, in words, in degrees and millimetres


_LIMBS = ("Trunk", "Head", "Left arm", "Right arm", "Left leg", "Right leg")
PLACE, OTHERS = "Position", "Others"
_ORDER = (PLACE, "Wrist", "Thumb", "Index", "Middle", "Ring", "Little", *_LIMBS, OTHERS)
_LARGE_M = 0.5
"""what reaches farther is placed by centimetres, else by millimetres: a body's 1.75 m are as many of these as a hand's 190 mm of those"""
_MOTIONS = {"flex": "flex °", "abd": "abduction °"}
_TURNS = {
    "flex": "flex\u00a0°", "abd": "abduction\u00a0°", "twist": "twist\u00a0°", "lean": "lean\u00a0°",
    "elevate": "elevation\u00a0°", "protract": "protraction\u00a0°",
}  # fmt: skip


def length_unit(reach_m: float) -> tuple[str, float]:
    """Return the unit in which a model is placed, and what it is in metres. reach_m: how far the model extends."""
    return ("cm", 1e-2) if reach_m > _LARGE_M else ("mm", 1e-3)


def groups_of(names: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Return a model's parameters by folder, in the order of the folders."""
    groups = {group: tuple(n for n in names if group_of(n) == group) for group in _ORDER}
    return {group: members for group, members in groups.items() if members}


def group_of(name: str) -> str:
    """Return the folder of a parameter."""
    if name.startswith("root_"):
        return PLACE
    if (limb := limb_of(name)) is not None:
        return limb.capitalize()
    first = name.split("_", maxsplit=1)[0].capitalize()
    if first == "Spine":
        return "Trunk"
    return first if first in _ORDER else OTHERS


def label_of(name: str, length: str = "mm") -> str:
    """Return a parameter's label inside its folder. length: the unit of a place."""
    if name.startswith("root_t"):
        return f"{name[-1]} {length}"
    if name.startswith("root_r"):
        return f"turn {name[-1]} °"
    first, *joint, motion = name.split("_")
    if limb_of(name) is not None or first == "spine":
        return " ".join([*(joint or [first]), _TURNS.get(motion, motion)])
    return " ".join([part.upper() for part in joint] + [_MOTIONS.get(motion, motion)])


def unit_of(name: str, length: float = 1e-3) -> float:
    """Return what a slider's unit is in metres or radians. length: of a place [m]."""
    return length if name.startswith("root_t") else math.pi / 180


_JOINTS = {
    "cmc": "CMC", "mcp": "MCP", "pip": "PIP", "dip": "DIP", "ip": "IP",
}  # fmt: skip
_LONG_MOTIONS = {
    "flex": "flexion", "abd": "abduction", "twist": "axial rotation", "dev": "deviation", "lean": "lateral flexion",
    "elevate": "elevation", "protract": "protraction",
}  # fmt: skip


def title_of(name: str) -> str:
    """Return a parameter's name in words: `Index PIP flexion`."""
    if name.startswith("root_"):
        return f"{'Position' if name[5] == 't' else 'Rotation'} {name[-1]}"
    *parts, motion = name.split("_")
    joint = " ".join(_JOINTS.get(part, part) for part in parts)
    return f"{joint[:1].upper()}{joint[1:]} {_LONG_MOTIONS.get(motion, motion)}"
