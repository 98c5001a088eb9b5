"""What was said to the user: it stays to be read; and what is to be done or known stands until it is put away."""

from __future__ import annotations

import html
import re
import threading
from collections import deque
from dataclasses import dataclass, field

import viser

from handtrack_app.page.page import Page, put
from handtrack_app.protocol.snapshots import Notice

GUIDE = "guide"
_COLOURS = {GUIDE: "#56b4e9", "info": "#56b4e9", "done": "#009e73", "warning": "#e69f00", "error": "#d55e00"}  # fmt: skip
_STANDS = (GUIDE, "warning", "error")
_FRAME, _LINK = re.compile(r"\b(frame) (\d+)", re.I), r"<a href='#' data-frame='\2'>\1 \2</a>"
"""the style's script goes to the frame of such a link"""
_MOST = 100  # messages that are kept
_NONE = "<div style='padding:.6em .9em;font-size:.85em;opacity:.75'>Nothing was said yet.</div>"


@dataclass
class Messages:
    """The note in the head of the main panel, and the tab with all messages."""

    page: Page
    is_posed: bool = False
    """there is a pose: guidance to the first one has done its work"""
    _all: deque[Notice] = field(default_factory=lambda: deque(maxlen=_MOST))
    _standing: list[Notice] = field(default_factory=list)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def __post_init__(self) -> None:
        """Add the note where the page builds now."""
        gui = self.page.gui
        self.note = gui.add_html("", visible=False)
        self.away = gui.add_button("Put away", color="gray", visible=False)
        self.page.on(self.away, lambda _: self.put_away())

    def build(self, tab: viser.GuiTabHandle) -> None:
        """Add the list of all messages to a tab."""
        with tab:
            self.list = self.page.gui.add_html(_NONE)

    def take(self, notice: Notice) -> None:
        """Keep what is said; the same again takes the place of the older one."""
        with self._lock:
            self._all.appendleft(notice)
            if notice.level in _STANDS and not (notice.level == GUIDE and self.is_posed):
                self._standing = [one for one in self._standing if one.title != notice.title]
                self._standing.append(notice)
        self._show()

    def put_away(self) -> None:
        """Let the newest stand no more."""
        with self._lock:
            del self._standing[-1:]
        self._show()

    def see_pose(self, is_posed: bool) -> None:
        """Take whether any frame has a pose: guidance goes then."""
        if is_posed != self.is_posed:
            with self._lock:
                self.is_posed = is_posed
                self._standing = [n for n in self._standing if not (n.level == GUIDE and is_posed)]
            self._show()

    def _show(self) -> None:
        with self._lock:
            said, standing = list(self._all), list(self._standing)
        put(self.list, content="".join(_words(one) for one in said) or _NONE)
        more = f"<div style='opacity:.7'>{len(standing) - 1} more: tab Messages</div>"
        if standing:
            put(self.note, content=_words(standing[-1], more if len(standing) > 1 else ""))
        put(self.note, visible=bool(standing))
        put(self.away, visible=bool(standing))


def _words(notice: Notice, more: str = "") -> str:
    colour = _COLOURS.get(notice.level, "gray")
    title, text = (_FRAME.sub(_LINK, html.escape(words)) for words in (notice.title, notice.text))
    text = f"<div>{text}</div>" if text else ""
    return (
        f"<div class='handtrack-note' style='margin:.3em .9em .4em;padding:.15em .6em;border-left:3px solid {colour};"
        f"font-size:.85em;line-height:1.4;overflow-wrap:anywhere'><b>{title}</b>{text}{more}</div>"
    )
