"""What the services of an open session have in common: what they work on, and how what they change is shown."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import TYPE_CHECKING

from handtrack.session.session_state import Edit
from handtrack_app.engine.store.persistence import Persistence
from handtrack_app.protocol.snapshots import Notice, Snapshot

if TYPE_CHECKING:
    from handtrack_app.engine.open_session import OpenSession


class Service:
    """A part of an open session, which lives on the worker's thread."""

    def __init__(self, opened: OpenSession) -> None:
        self.opened, self.document, self.store = opened, opened.document, opened.store
        self.jobs, self.publish = opened.jobs, opened.publish


_HURRIED_S = 0.6  # while tracking runs, previews are shown at most this often


class PreviewService(Service, ABC):
    """Pictures on request, and settings whose change the frame shown follows; what takes time is made on the render thread or by a job."""

    is_wanted = False
    """the page looks at something of it"""
    _shown_at = 0.0

    @abstractmethod
    def _wants(self) -> bool:
        """Return whether the page looks at something that there is."""

    @abstractmethod
    def _show(self, hurried: bool) -> None:
        """Have made what the page wants of the frame shown."""

    @abstractmethod
    def card(self) -> Snapshot:
        """Return the settings in force."""

    def show(self, hurried: bool = False) -> None:
        """Have made what the page wants of the frame shown. hurried: tracking runs, which comes first."""
        now = time.monotonic()
        if self.is_wanted and not (hurried and now - self._shown_at < _HURRIED_S):
            self._shown_at = now
            self._show(hurried)

    def look(self) -> None:
        """The page looks at something else."""
        self.is_wanted = self._wants()
        self.show()

    def tell(self) -> None:
        """Publish the settings in force."""
        self.is_wanted = self._wants()
        self.publish(self.card())

    def _change(self, change: Callable[[], object]) -> None:
        """Change, save or restore settings. Raises HandtrackError for what cannot be done."""

        def changed() -> None:
            try:
                self.jobs.require_idle()
                change()
                self.look()
            finally:
                self.tell()  # the page shows what holds

        self.opened.see_otherwise(changed)

    def _do(
        self, words: str, edit: Callable[[], Edit], tag: str = "", is_stroke: bool = False
    ) -> None:
        """Make an edit of settings."""
        self._change(lambda: self.store.do(words, edit(), tag, is_stroke=is_stroke))

    def _save(self, save: Callable[[Persistence], str], title: str) -> None:
        """Write settings into session.toml, and say so."""
        self._change(lambda: self.publish(Notice("done", title, save(self.store))))
