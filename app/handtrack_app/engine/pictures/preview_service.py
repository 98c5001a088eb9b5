"""What clouds and masks have in common on the page: pictures on request, and settings whose change the frame shown follows."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable

from handtrack_app.engine.document import Document
from handtrack_app.engine.job_control import JobControl
from handtrack_app.engine.pictures.render_thread import RenderThread
from handtrack_app.engine.store.persistence import Persistence
from handtrack_app.protocol.snapshots import Snapshot

_HURRIED_S = 0.6  # while tracking runs, previews are shown at most this often


class PreviewService(ABC):
    """Lives on the worker's thread; what takes time is made on the render thread or by a job."""

    def __init__(
        self,
        document: Document,
        store: Persistence,
        jobs: JobControl,
        render_thread: RenderThread,
        publish: Callable[[Snapshot], None],
        followed: Callable[[Callable[[], None]], None],
    ) -> None:
        """followed: makes a change of what is tracked by, and lets the frame shown follow."""
        self._document, self._store, self._jobs = document, store, jobs
        self._render_thread, self._publish, self._followed = render_thread, publish, followed
        self._shown_at = 0.0

    @property
    @abstractmethod
    def _is_wanted(self) -> bool:
        """Whether the page wants anything."""

    @abstractmethod
    def _show(self, hurried: bool) -> None:
        """Have made what the page wants of the frame shown."""

    @abstractmethod
    def card(self) -> Snapshot:
        """Return the settings in force."""

    def show(self, hurried: bool = False) -> None:
        """Have made what the page wants of the frame shown. hurried: tracking runs, which comes first."""
        now = time.monotonic()
        if self._is_wanted and not (hurried and now - self._shown_at < _HURRIED_S):
            self._shown_at = now
            self._show(hurried)

    def tell(self) -> None:
        """Publish the settings in force."""
        self._publish(self.card())

    def _change(self, change: Callable[[], object]) -> None:
        """Change, save or restore settings. Raises HandtrackError for what cannot be done."""

        def changed() -> None:
            try:
                self._jobs.require_idle()
                change()
                self.show()
            finally:
                self.tell()  # the page shows what holds

        self._followed(changed)
