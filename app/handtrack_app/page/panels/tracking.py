"""Tracking: one frame, a range, everything; and how far it is, in words."""

from __future__ import annotations

import html
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import viser

from handtrack_app.page.html import table, text
from handtrack_app.page.page import Panel, put
from handtrack_app.protocol import (
    COUNTED,
    LiveSnapshot,
    ProgressSnapshot,
    RerunPage,
    SessionSnapshot,
    TimelineSnapshot,
    WorkSnapshot,
)

_SIZE = "model.fit_size"


@dataclass
class TrackingPanel(Panel):
    """Handles of the tracking tab."""

    def build(self) -> None:
        page, state, live = self.page, self.state, self.state.session.live
        if live:
            page.button(
                "Track live", lambda: self.start("live"), "player-play",
                "Tracks the newest images, from the pose shown.", None, state.is_free,
            )  # fmt: skip
        else:
            page.button(
                "Track all frames", lambda: self.start("all"), "player-play",
                "Tracks forward and backward from the first-frame pose, with the same numbers as `handtrack track`. Keyframes stay, and tracking restarts from each.",
                None, state.is_free,
            )  # fmt: skip
        page.button(
            "Track this frame", lambda: self.start("here"), "focus-2", "Fit the pose you see to this frame.",
            when=state.is_free,
        )  # fmt: skip
        later = page.check(
            page.phrase("Fit the {kind}'s size later"), False, self._put_off,
            "Tracks first, then fits the size to the tracked frames, and tracks again with it.",
            lambda: state.session.size_pending and state.is_idle(),
        )  # fmt: skip
        page.subscribe(
            SessionSnapshot, lambda now: put(later, value=now.settings.get(_SIZE) == "later")
        )
        if not live:
            self._add_range()
        hint = "Show the newest images; posing the {kind} halts them." if live else "Show each frame as it is tracked."  # fmt: skip
        self.follow = page.check(
            "Follow", True, self._follow, page.phrase(hint), lambda: live or not state.is_free()
        )
        page.reflect(self.follow, value=lambda: state.follow)
        page.button(
            "Refine", page.engine.refine, "sparkles",
            "Re-optimises all tracked frames jointly. Keyframes stay fixed, and neighbouring frames adapt to them. The previous track stays as a take.",
            when=lambda: not live and state.is_idle() and int((state.strip.status >= 0).sum()) > 1,
        )  # fmt: skip
        self.between = page.button(
            "Track between", lambda: self.start("between"), "arrows-join",
            "Tracks again from the nearest keyframe or accepted frame before this one to the nearest after it: the first half forwards, the second backwards.",
            when=lambda: self._ends is not None and state.is_idle(),
        )  # fmt: skip
        page.reflect(
            self.between, label=lambda: "Track between {} and {}".format(*self._ends or ("", ""))
        )
        if not live:
            page.button(
                "Save track", page.engine.save_track, "device-floppy", "Writes tracks/poses.npz into the session.",
            )  # fmt: skip
        page.button(
            "Open in rerun", page.engine.open_rerun, "chart-dots",
            "Opens rerun's viewer with every camera's residuals: of all tracked frames, and of each frame that is tracked from now on.",
        )  # fmt: skip
        self.rerun = page.gui.add_markdown("", visible=False)

    @property
    def _ends(self) -> tuple[int, int] | None:
        return frozen_ends(self.state.strip, self.state.frame)

    def _add_range(self) -> None:
        """Offer parts of a recording."""
        page, gui, strip, free = self.page, self.gui, self.state.strip, self.state.is_free
        first, last = strip.start, max(strip.stop - 1, strip.start + 1)
        page.buttons("From here", ("◀ backward", "forward ▶"), self.start, when=free)
        with page.offer(gui.add_folder("Range"), free):
            self.range = gui.add_multi_slider(
                "Frames", first, last, 1, initial_value=(first, last), min_range=0
            )
            page.button(
                "Track range", lambda: self.start("range"), "arrows-horizontal",
                "Starts at this frame if it has a pose, otherwise at the nearest frame of the range that has one.",
            )  # fmt: skip
        page.bind(self.range, lambda _: None)
        # the slider itself shows no numbers: they stand in its label
        page.reflect(self.range, label=lambda: "\u2060…\u2060".join(map(str, self._chosen)))

    def show_rerun(self, rerun: RerunPage) -> None:
        """Show where the residuals of what is tracked can be seen."""
        words = f"[Residuals of every camera, in rerun]({rerun.url})"
        put(self.rerun, content=words, visible=True)

    def _follow(self, on: bool) -> None:
        self.state.follow = on
        self.engine.follow(on)

    def start(self, which: str) -> None:
        """Track: `all`, `here`, `range`, or as a button of the panel says."""
        session, frame, strip = (
            self.state.session,
            self.state.frame,
            self.state.strip,
        )
        if which == "live":
            self._begin(self.engine.track_live)
        elif which == "all":
            self.track(strip.start, strip.stop, session.first_frame, anew=True)
        elif which == "between":
            if (ends := self._ends) is not None:
                self.track(ends[0], ends[1] + 1, ends[0], both_ends=True)
        elif which == "here":
            self.track(frame, frame + 1, frame)
        elif session.live:
            return  # there is but one frame
        elif which == "forward ▶":
            self.track(frame, strip.stop, frame)
        elif which == "◀ backward":
            self.track(strip.start, frame + 1, frame)
        else:
            first, last = self._chosen
            self.track(first, last + 1, nearest_posed(strip, first, last, frame))

    def track(self, start: int, stop: int, first: int, **how: bool) -> None:
        """Track frames [start, stop) from the first one, as `JobControl.track` does."""
        self._begin(partial(self.engine.track, start, stop, first, **how))

    def _begin(self, job: Callable[[], None]) -> None:
        self.page.play(False)
        job()
        self._follow(True)

    def pause_or_go_on(self) -> None:
        """Let tracking wait, or go on."""
        self.engine.pause(not self.state.is_paused())

    def _put_off(self, on: bool) -> None:
        words = self.page.phrase(f"Fit the {{kind}}'s size {'later' if on else 'first'}")
        self.engine.set_setting(_SIZE, "later" if on else "true", words)

    @property
    def _chosen(self) -> tuple[int, int]:
        """The first and last frame of the range."""
        strip = self.state.strip
        first, last = np.clip(sorted(self.range.value), strip.start, strip.stop - 1).tolist()
        return first, last


def frozen_ends(strip: TimelineSnapshot, frame: int) -> tuple[int, int] | None:
    """Return the nearest frames before and after one that tracking leaves, with frames between them; None where there are none."""
    kept = strip.accepted | set(strip.by_hand)
    before = max((f for f in kept if f <= frame), default=None)
    after = min((f for f in kept if f > frame), default=None)
    if before is None or after is None or after - before < 2:
        return None
    return before, after


def nearest_posed(strip: TimelineSnapshot, first: int, last: int, frame: int) -> int:
    """Return the frame of a range that is nearest to one and has a pose of its own: set, found or tracked; where none has, the
    nearest at all.
    """
    here = min(max(frame, first), last)
    posed = {*strip.by_hand, *(strip.start + np.flatnonzero(strip.status >= 0)).tolist()}  # fmt: skip
    return min((f for f in posed if first <= f <= last), key=lambda f: abs(f - here), default=here)


def progress_words(progress: ProgressSnapshot) -> str:
    """Return what is going on, in one line."""
    words = progress.text
    if progress.state in ("tracking", "preparing") and progress.eta_s > 0:
        words += f", {duration(progress.eta_s)} left"
    return words


def duration(seconds: float) -> str:
    """Return a length of time in words."""
    if seconds < 60:
        return f"{seconds:.0f} s"
    return f"{int(seconds // 60)} min {int(seconds % 60):02d} s"


# ---- Live: what becomes of running cameras' images, and recording them


@dataclass
class LivePanel(Panel):
    """The part of the Track tab that only running cameras have."""

    recording: bool = False

    def build(self) -> None:
        gui = self.gui
        self.record = self.page.button(
            "Record", lambda: self.engine.record(not self.recording), "player-record",
            "Records the cameras and the tracked poses to a new session folder.",
        )  # fmt: skip
        self.counts = gui.add_html("")

    def show(self, live: LiveSnapshot) -> None:
        """Show the counts, and whether something is recorded."""
        if self.recording != bool(live.recording):
            self.recording = bool(live.recording)
            icon = viser.Icon.PLAYER_STOP if self.recording else viser.Icon.PLAYER_RECORD
            put(self.record, label="Stop recording" if self.recording else "Record", icon=icon)
            self.record.color = "red" if self.recording else "gray"
        put(self.counts, content=live_table(live))


def live_table(live: LiveSnapshot) -> str:
    """Return a row for each camera: images tracked, dropped, missing; and what is recorded."""
    head = "".join(
        f"<td class='handtrack-number'>{word}</td>" for word in ("tracked", "dropped", "missing")
    )
    rows = "".join(
        f"<tr><td>{html.escape(name)}</td>"
        + "".join(f"<td class='handtrack-number'>{count[what]}</td>" for what in COUNTED)
        + "</tr>"
        + (
            f"<tr><td colspan='4' style='color:#e69f00'>{html.escape(live.gone[name])}</td></tr>"
            if live.gone[name]
            else ""
        )
        for name, count in live.counts.items()
    )
    recorded = ""
    if live.recording:
        recorded = text(
            f"Recording: {live.recorded} frames in {html.escape(live.recording)}", faint=False
        )
    said = text(
        "Images since tracking began. Dropped: they came while an earlier frame was still worked on."
    )
    return table(f"<tr><td></td>{head}</tr>{rows}") + said + recorded


# ---- Takes: every tracking there was, brought back


_MOST = 40  # of the list; `handtrack takes` has all
_NO_TAKES: tuple[str, ...] = ("–",)


@dataclass
class TakesPanel(Panel):
    """The end of the Track tab, once something was tracked."""

    def build(self) -> None:
        page, gui = self.page, self.gui
        self.folder = gui.add_folder("Takes", expand_by_default=False)
        with page.offer(self.folder, lambda: self.chosen.options != _NO_TAKES):
            self.list = gui.add_html("")
            self.chosen = gui.add_dropdown("Take", _NO_TAKES)
            self.back = page.button(
                "Restore this take", self._restore, "restore",
                "Makes it the current track again, except in accepted frames. Undo reverts that; nothing is overwritten.",
            )  # fmt: skip

    def _restore(self) -> None:
        chosen = str(self.page.said(self.chosen))
        if chosen.isdecimal():
            self.page.play(False)
            self.engine.restore_take(int(chosen))

    def show(self, work: WorkSnapshot) -> None:
        """Show the takes that there are."""
        numbers = tuple(str(card.number) for card in work.takes[:_MOST])
        if numbers and numbers != self.chosen.options:
            self.chosen.options = numbers
            self.chosen.value = numbers[0]
        put(self.list, content=takes_table(work))


def takes_table(work: WorkSnapshot) -> str:
    """Return a row for each take, the latest first."""
    rows = ""
    for card in work.takes[:_MOST]:
        shown = (
            f"<b>{card.shown} {'frame' if card.shown == 1 else 'frames'} shown</b>"
            if card.shown
            else ""
        )
        rows += (
            f"<tr><td style='vertical-align:top;padding-right:.8em'><b>{card.number}</b></td>"
            f"<td>{html.escape(card.words)} {shown}</td></tr>"
        )
    return table(rows)
