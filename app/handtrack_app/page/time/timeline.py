"""Timeline: the recording at a glance in lanes, with the frame slider over them; zoom, playback."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

from handtrack_app.page.page import Panel, put
from handtrack_app.page.time.lanes import (
    Lane,
    Window,
    cursor_picture,
    lanes_of,
    lanes_picture,
)
from handtrack_app.protocol.snapshots import PoseSnapshot

_PLAY: tuple[str, ...] = ("⇤", "←", "▶", "→", "⇥")
_ZOOM: tuple[str, ...] = ("+", "−", "↔", "☰")
_SPEEDS = {"¼×": 0.25, "½×": 0.5, "1×": 1.0, "2×": 2.0}
_FACTOR = 2.0


@dataclass
class TimelinePanel(Panel):
    """Handles of the timeline. A click anywhere on the lanes goes there: the slider lies over them, and has their ends."""

    every: bool = False
    """all lanes, not only the first ones"""
    moved: Callable[[], None] = lambda: None
    """called when another part of the recording is shown"""
    _lanes: list[Lane] = field(default_factory=list)
    _pose: PoseSnapshot | None = None

    def build(self) -> None:
        page, gui = self.page, self.gui
        self.window, self._frame = Window.whole(self.frames), page.state.session.first_frame
        self.picture = gui.add_html("")
        self.cursor = gui.add_html("")
        self.slider = gui.add_slider("Frame", self.window.first, self.window.last, 1, self._frame)
        self.play = page.buttons(
            "Playback", _PLAY, self._pressed, "First frame, back, play or pause, next, last frame. Keys: Space, arrows.",
        )  # fmt: skip
        self.zoom = page.buttons(
            "Timeline", _ZOOM, self.look_closer, "Fewer frames, more frames, all frames; more lanes or the first ones.",
        )  # fmt: skip
        self.speed = page.choice("Speed", _SPEEDS, partial(setattr, page.state, "speed"), now="1×")
        page.on(self.slider, lambda _, frame: page.go_to(frame))
        page.key("Timeline: fewer frames", "shift+F", partial(self.look_closer, _ZOOM[0]))
        page.key("Timeline: more frames", "shift+G", partial(self.look_closer, _ZOOM[1]))

    def _pressed(self, key: str) -> None:
        page, state = self.page, self.state
        targets = (state.strip.start, state.frame - 1, None, state.frame + 1, state.strip.stop - 1)
        target = targets[_PLAY.index(key)]
        page.play(target is None and not state.playing)
        if target is not None:
            page.go_to(target)

    @property
    def frames(self) -> range:
        """Those of the recording."""
        return range(self.state.strip.start, self.state.strip.stop)

    def look_closer(self, how: str) -> None:
        """Show fewer frames or more, all, or other lanes: a button's sign, of `_ZOOM`."""
        if how == _ZOOM[3]:
            self.every = not self.every
            self._redraw()
        elif how == _ZOOM[2]:
            self.look_at(Window.whole(self.frames))
        else:
            factor = 1 / _FACTOR if how == _ZOOM[0] else _FACTOR
            self.look_at(self.window.zoomed(factor, self.state.frame))

    def look_at(self, window: Window) -> None:
        """Show a part of the recording."""
        if window != self.window:
            self.window = window
            self._redraw()
            self.moved()

    def show_frame(self, frame: int) -> None:
        """Move slider and cursor to a frame; where it is beyond the part that is shown, that goes along."""
        self._frame = frame
        self.look_at(self.window.around(frame))
        put(self.slider, max=max(self.slider.max, frame), value=frame)
        self._show_numbers()

    def show_pose(self, pose: PoseSnapshot) -> None:
        """Stand at a pose, and show its own numbers."""
        self._pose = pose
        self.show_frame(pose.frame)

    def show_timeline(self) -> None:
        """Take the recording's new status and energies."""
        if self.window.frames != self.frames:  # frames are counted, or come, while the page is open
            self.window = Window.whole(self.frames)
        self._redraw()

    def _redraw(self) -> None:
        """Send all lanes again."""
        strip = self.state.strip
        self._lanes = lanes_of(strip, self.window, self.every)
        put(self.picture, content=lanes_picture(self._lanes, strip, self.window, self.every))
        put(self.slider, min=self.window.first, max=self.window.last)
        self._show_numbers()

    def _show_numbers(self) -> None:
        """Show the numbers of the frame: those of the pose shown, where it is of that frame."""
        frame, pose = self._frame, self._pose
        pose = pose if pose is not None and pose.frame == frame else None
        row = self.frames.index(frame) if frame in self.frames else None
        put(self.cursor, content=cursor_picture(self._lanes, row, pose))
