"""What a live session needs beside a recording's: opening it, watching the cameras, recording, telling what was dropped."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

from handtrack.capture.images.live_feed import LiveFeed
from handtrack.errors import HandtrackError
from handtrack.session.live_session import LIVE_SETTINGS, LiveRecording, LiveSession, open_live
from handtrack.session.run import TrackingRun
from handtrack.session.session_file import dotted
from handtrack.tracking.frame.result import FrameResult
from handtrack_app.engine.document import Document
from handtrack_app.engine.opening import placed_in_view
from handtrack_app.process.child import LiveOptions
from handtrack_app.protocol import COUNTED, LiveSnapshot, Notice, Snapshot

_REPORT_EVERY_S = 0.5
KEEPS_NOTHING = "A live source keeps no files of its own: press 'Record', and open the recording, where everything can be saved."


def open_live_document(
    options: LiveOptions, folder: Path, overrides: Mapping[str, object] | None = None
) -> Document:
    """Return the document of running cameras, with the hand as the folder's first pose has it. Raises HandtrackError."""
    session = open_live(folder, options.devices, options.tolerance_s, options.rate)
    try:
        assert session.live is not None
        session.live.reach(0)
        session.live.begin_counting()
        live = dict(LIVE_SETTINGS)
        for name in dotted(session.file.tracking):
            live.pop(name, None)  # what session.toml says holds
        run = TrackingRun.open(session, {**live, **(overrides or {})}, use_init=False)
        first = session.init
        if first is None or first.pixels:
            return Document(run, 0, placed_in_view(run))
        return Document(run, 0, replace(run, first=first).initial()[1])
    except BaseException:
        if session.live is not None:
            session.live.close()
        raise


class LiveControl:
    """Lives on the worker's thread; only frames are recorded from others."""

    def __init__(self, document: Document, publish: Callable[[Snapshot], None]) -> None:
        self._document, self._publish = document, publish
        self._recording: LiveRecording | None = None
        self._reported: LiveSnapshot | None = None
        self._when = 0.0
        self._known_gone: set[str] = set()

    @property
    def recording(self) -> bool:
        return self._recording is not None

    def watch(self, show: bool) -> bool:
        """Take, and perhaps show, the cameras' newest images while nothing is tracked; return whether there are any."""
        made = self._feed.make_next(0.0, counts=False)
        if made is not None:
            self._document.see_frames()
            if show:
                self._document.show(made.number)
        return made is not None

    def record(self, on: bool, folder: str | None) -> None:
        """Begin to record what is shown and tracked to a folder, or end it. Raises HandtrackError."""
        if not on:
            self.end_recording()
        elif self._recording is None:
            own = self._session.folder
            beside = own.resolve().parent / f"{own.name}_live_{time.strftime('%Y-%m-%d_%H-%M-%S')}"
            chosen = beside if folder is None else Path(folder)
            self._recording = LiveRecording(chosen, self._session)
            self._feed.on_frame = self._recording.add
        self.report(at_once=True)

    def note(self, result: FrameResult) -> None:
        """Keep a tracked frame, if it is recorded."""
        if self._recording is not None:
            self._recording.note(result)

    def end_recording(self) -> str:
        """Complete the recording and tell of it; return the same words, empty without one."""
        recording, self._recording, self._feed.on_frame = self._recording, None, None
        if recording is None:
            return ""
        words = recording.close(self._document.run)
        self._publish(Notice("done", "Recorded", words))
        return words

    def close(self) -> list[str]:
        """End recording and the cameras; return what is to be said at the end, in sentences."""
        try:
            said = self.end_recording()
        except HandtrackError as error:
            said = str(error)
        self._feed.close()
        return [*self.count_words(), *filter(None, [said])]

    def report(self, at_once: bool = False) -> bool:
        """Show what became of the cameras' images, and tell of a camera that is gone: now and then; return whether it was now."""
        now = time.monotonic()
        if not at_once and now - self._when < _REPORT_EVERY_S:
            return False
        self._when = now
        for sentence in self._feed.gone:
            if sentence not in self._known_gone:
                self._known_gone.add(sentence)
                self._publish(
                    Notice("warning", "A camera is disconnected", f"{sentence} The others go on.")
                )
        recording = self._recording
        snapshot = LiveSnapshot(
            {
                name: {what: count[what] for what in COUNTED}
                for name, count in self._feed.counts.items()
            },
            {camera.name: camera.gone for camera in self._feed.cameras},
            "" if recording is None else str(recording.folder),
            0 if recording is None else recording.count,
        )
        if snapshot != self._reported:
            self._reported = snapshot
            self._publish(snapshot)
        return True

    def count_words(self) -> list[str]:
        """Return what became of each camera's images while tracking, in sentences."""
        results = []
        for camera in self._feed.cameras:
            count = self._feed.counts[camera.name]
            missing = f", {count['missing']} missing" if count["missing"] else ""
            results.append(
                f"{camera.name}: {count['used']} images tracked, {count['dropped']} dropped (came while a frame was solved)"
                f"{missing}. {camera.gone}".rstrip()
            )
        return results

    @property
    def _session(self) -> LiveSession:
        session = self._document.run.session
        assert isinstance(session, LiveSession)
        return session

    @property
    def _feed(self) -> LiveFeed:
        feed = self._session.live
        assert feed is not None
        return feed
