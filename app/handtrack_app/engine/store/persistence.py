"""What outlives the page: the journal, the work in progress, the first-frame pose, saved tracks."""

from __future__ import annotations

import json
import logging
import time
from dataclasses import dataclass, field
from pathlib import Path

from handtrack.errors import HandtrackError
from handtrack.files.toml_edit import edit_toml
from handtrack.files.toml_text import read_toml
from handtrack.files.versions import keep_version
from handtrack.model.articulated import HandScale
from handtrack.model.model_file import write_scale
from handtrack.session.clouds_settings import read_clouds
from handtrack.session.first_pose.first_pose import FirstPose, write_first_pose
from handtrack.session.formats.tables import read_npz, write_npz, write_result
from handtrack.session.journal import Event, Journal, read_events
from handtrack.session.layout import (
    HAND_FILE,
    INIT_FILE,
    POSES_FILE,
    SESSION_FILE,
    TRACKS_FOLDER,
    WORK_FILE,
)
from handtrack.store.lease import LeaseTaken
from handtrack.store.store import WritableStore
from handtrack.tracking.frame.result import FrameResult
from handtrack_app.engine.document import Document
from handtrack_app.engine.store.tracks import journal_row, result_of_row, whole_track

log = logging.getLogger(__name__)

_SETTINGS = "a session's settings"
_PROGRAM = "handtrack open"
_UNWRITABLE = "nothing can be written there, so work on this session would be lost"
_FLUSH_S = 1.0  # tracked frames reach the disk at most this late


@dataclass
class Persistence:
    """Writes what is accepted, at once, and brings it back on reopening."""

    document: Document
    journal: Journal | None
    warning: str = ""
    lease: WritableStore | None = None
    """the right to write to the session's tracks/, which one program has"""
    _waiting: list[dict[str, object]] = field(default_factory=list)
    _flushed: float = 0.0

    @classmethod
    def open(cls, document: Document, take_over: bool = False) -> Persistence:
        """Return the store of a session; one that cannot be written to, or that another program writes to, works, with a
        warning. A live one keeps nothing. take_over: even from another program, which can write no more.
        """
        if document.run.session.live is not None:
            return cls(document, None)
        folder = document.run.session.folder
        lease = None
        try:
            lease = WritableStore(folder / TRACKS_FOLDER, _PROGRAM, take_over)
            journal = Journal.open(folder)
            return cls(document, journal, _damage(journal), lease)
        except LeaseTaken as error:
            return cls(document, None, f"{error} Here it can be looked at; nothing is saved.")
        except HandtrackError as error:
            if lease is not None:
                lease.close()
            return cls(document, None, str(error))
        except OSError as error:
            return cls(
                document, None, f"{folder / TRACKS_FOLDER}: {_UNWRITABLE} ({error.strerror})."
            )

    @property
    def folder(self) -> Path:
        return self.document.run.session.folder

    # ---- writing

    def note(self, kind: str, data: dict[str, object]) -> None:
        """Write one accepted change. Raises HandtrackError where another program took over."""
        if self.journal is not None:
            self._check()
            self.journal.append(kind, data)

    def _check(self) -> None:
        if self.lease is not None:
            self.lease.lease.check()
        elif self.warning:
            raise HandtrackError(self.warning)

    def note_pose(self, frame: int) -> None:
        """Write the pose set by hand at a frame."""
        values = self.document.by_hand.get(frame)
        if values is not None:
            names = self.document.model.parameter_names
            known = dict(zip(names, values.tolist(), strict=True))
            found = self.document.is_found(frame)
            self.note("pose", {"frame": frame, "parameters": known, "found": found})

    def note_setting(self, name: str, value: object) -> None:
        """Write one changed setting."""
        self.note("setting", {"name": name, "value": value})
        if self.document.run.settings.flat() == self.document.own_settings:
            self._leave_settings_to_the_file()

    def _leave_settings_to_the_file(self) -> None:
        """session.toml says all of them, and may be edited: the journal is not to come back over it."""
        if self.journal is not None:
            self.flush()
            self.journal.replace([e for e in self.journal.events() if e.kind != "setting"])

    def note_scale(self) -> None:
        """Write the hand's size."""
        size, pending = self.document.run.scale, self.document.size_pending
        self.note("scale", {"overall": size.overall, "parts": size.parts, "pending": pending})

    def note_clouds(self) -> None:
        """Write the settings of [clouds], or that those of session.toml hold."""
        clouds, table = self.document.clouds, None
        if clouds is not None and self.document.unsaved_clouds:
            table = clouds.table
        self.note("clouds", {"table": table})

    def note_result(self, result: FrameResult) -> None:
        """Write a tracked frame, a second late at most."""
        self._waiting.append(journal_row(result, stays=result.frame in self.document.by_hand))
        if time.monotonic() - self._flushed > _FLUSH_S:
            self.flush()

    def flush(self) -> None:
        """Write what waits."""
        self._flushed = time.monotonic()
        if self.journal is not None and self._waiting:
            self._check()
            self.journal.append_all([("tracked", row) for row in self._waiting])
        self._waiting = []  # not before: what failed is tried again

    def settle(self) -> None:
        """Write the work in progress to one file, and shorten the journal by what is in it."""
        self.flush()
        if self.journal is None or not self.document.results:
            return
        ordered = sorted(self.document.results.values(), key=lambda result: result.frame)
        path = self.folder / WORK_FILE
        try:
            if self._is_of_another_model(path):
                keep_version(path)
            write_npz(path, self.document.run.result(ordered))
        except OSError as error:
            raise HandtrackError(
                f"{path}: what was tracked cannot be written there ({error.strerror}). It stays as long as the workbench is "
                "open: make room, or bring the folder back, and save the track."
            ) from None
        # a pose set by hand that tracking replaced is not to come back over it
        kept = [e for e in self.journal.events() if e.kind != "tracked" and not self._replaced(e)]
        self.journal.replace(kept)

    def _is_of_another_model(self, path: Path) -> bool:
        if not path.is_file():
            return False
        try:
            return read_npz(path).parameter_names != self.document.model.parameter_names
        except HandtrackError:
            return True  # whatever it is, it is kept

    def _replaced(self, event: Event) -> bool:
        frame = event.data.get("frame")
        return event.kind in ("pose", "forget") and frame not in self.document.by_hand

    def close(self) -> None:
        """Write what waits, close the journal and let others write."""
        try:
            self.flush()
        finally:
            if self.journal is not None:
                self.journal.close()
            if self.lease is not None:
                self.lease.close()

    # ---- bringing back

    def restore(self) -> str:
        """Bring back poses, settings and tracked frames of the last time; say what, in a sentence."""
        if self.document.run.session.live is not None:
            return ""
        events = self.journal.events() if self.journal is not None else read_events(self.folder)
        changed = self._restore_settings(events) + self._restore_clouds(events)
        self._restore_work()
        for event in events:
            try:
                self._replay(event)
            except (KeyError, TypeError, ValueError, HandtrackError) as error:
                log.warning("journal entry %s passed over: %s", event.kind, error)
        document = self.document
        found = sum(document.is_found(frame) for frame in document.by_hand)
        parts = [
            f"{count} {one if count == 1 else many}"
            for count, one, many in (
                (len(document.results), "tracked frame", "tracked frames"),
                (len(document.by_hand) - found, "pose set by hand", "poses set by hand"),
                (found, "pose found", "poses found"),
                (changed, "changed setting", "changed settings"),
            )
            if count
        ]
        return f"Brought back from last time: {', '.join(parts)}." if parts else ""

    def _restore_settings(self, events: list[Event]) -> int:
        document, names = self.document, set()
        for event in events:
            try:
                if event.kind == "setting":
                    document.replace_run(
                        document.run.with_values({event.data["name"]: event.data["value"]})
                    )
                elif event.kind == "scale":
                    pending = bool(event.data.get("pending", False))
                    document.set_scale(
                        HandScale(event.data["overall"], event.data["parts"]), pending
                    )
                    continue
                elif event.kind == "limits":
                    interval = event.data["interval"]
                    document.set_limits(event.data["name"], tuple(interval) if interval else None)
                else:
                    continue
                names.add(event.data["name"])
            except (KeyError, TypeError, ValueError, HandtrackError) as error:
                log.warning("setting of last time passed over: %s", error)
        return len(names)

    def _restore_clouds(self, events: list[Event]) -> int:
        """The last entry counts; without a table, session.toml does."""
        document = self.document
        entries = [event for event in events if event.kind == "clouds"]
        if not entries or (document.clouds is None and not entries[-1].data.get("table")):
            return 0
        try:
            table = entries[-1].data["table"]
            if table is not None:
                cameras = document.run.session.file.cameras
                document.use_clouds(read_clouds(table, cameras, "the clouds of last time"))
        except (KeyError, TypeError, ValueError, AttributeError, HandtrackError) as error:
            log.warning("the clouds' settings of last time passed over: %s", error)
        return len(document.unsaved_clouds)

    def _restore_work(self) -> None:
        """Take the newer of the workbench's own track and what `handtrack track` wrote."""
        found = [p for p in (self.folder / WORK_FILE, self.folder / POSES_FILE) if p.is_file()]
        if not found:
            return
        path = max(found, key=lambda p: p.stat().st_mtime)
        try:
            track = read_npz(path)
            size = json.loads(track.scale)
            moved = dict(size.get("proportions", {}))
            scale = HandScale(float(size["overall"]), dict(size["parts"]), moved)
        except (HandtrackError, ValueError, KeyError, TypeError) as error:
            self.warning = f"The track of last time, {path.name}, cannot be read: {error}"
            return
        if track.parameter_names != self.document.model.parameter_names:
            self.warning = f"{path.name} was tracked with another model; it is not shown."
            return
        if scale != self.document.run.scale:
            self.document.set_scale(scale)
        self.document.results.update({result.frame: result for result in track.frames()})

    def _replay(self, event: Event) -> None:
        document, data = self.document, event.data
        if event.kind == "pose":
            names = document.model.parameter_names
            values = [float(data["parameters"].get(n, 0.0)) for n in names]
            put = document.set_found if data.get("found") else document.set_pose
            put(int(data["frame"]), values)
        elif event.kind == "forget":
            document.forget_pose(int(data["frame"]))
        elif event.kind == "tracked":
            document.accept(result_of_row(data, document), not data.get("by_hand", False))

    # ---- on request

    def save_first_pose(self) -> str:
        """Write the pose shown to init.json; return a sentence about it."""
        self._check()
        document = self.document
        names = document.model.parameter_names
        values = dict(zip(names, [round(float(v), 6) for v in document.shown], strict=True))
        path = self.folder / INIT_FILE
        try:
            said = self._keep_hand_size()
            keep_version(path)
            size = document.run.scale if document.size_pending else None
            pose = FirstPose(document.frame, values, scale=size)
            write_first_pose(path, pose)
        except OSError as error:
            raise HandtrackError(
                f"{path}: cannot be written ({error.strerror}). Is the folder read-only?"
            ) from None
        document.start_from(pose)
        return (
            f"Tracking will start from frame {document.frame} with this pose ({path.name}).{said}"
        )

    def _keep_hand_size(self) -> str:
        """A size that was fitted from the first pose of before belongs to it: it gets its own file."""
        run, path = self.document.run, self.folder / SESSION_FILE
        if self.document.size_pending or not path.is_file():
            return ""
        hand = read_toml(path, _SETTINGS).get("hand")
        if not isinstance(hand, dict) or hand.get("scale") != "fit":
            return ""
        keep_version(self.folder / HAND_FILE)
        write_scale(self.folder / HAND_FILE, run.scale)
        edit_toml(path, {"hand.scale": HAND_FILE}, _SETTINGS)
        return f" The hand's fitted size is kept in {HAND_FILE}."

    def save_clouds(self) -> str:
        """Write the settings of [clouds] into session.toml; return a sentence about it."""
        self._check()
        document = self.document
        clouds, changed = document.clouds, document.unsaved_clouds
        if clouds is None:
            raise HandtrackError("This session has no clouds whose settings could be saved.")
        if not changed:
            return "session.toml has these settings already."
        values = clouds.table
        kept = self._edit_session("clouds", {name: values.get(name) for name in changed})
        document.saved_clouds = clouds
        self.note_clouds()
        return kept

    def save_settings(self) -> str:
        """Write the settings that were changed into session.toml; return a sentence about it."""
        self._check()
        document = self.document
        now, own = dict(document.run.settings.flat()), document.own_settings
        changed = {name: value for name, value in now.items() if value != own[name]}
        if not changed:
            return "session.toml has these settings already."
        kept = self._edit_session("tracking", changed)
        document.own_settings = now
        self._leave_settings_to_the_file()
        return kept

    def _edit_session(self, table: str, changed: dict[str, object]) -> str:
        changes = {f"{table}.{name}": value for name, value in changed.items()}
        kept = edit_toml(self.folder / SESSION_FILE, changes, _SETTINGS)
        return f"[{table}] of session.toml: {', '.join(changed)}.{kept}"

    def save_track(self) -> str:
        """Write tracks/poses.npz; return a sentence about it."""
        self._check()
        path = self.folder / POSES_FILE
        track = whole_track(self.document)
        try:
            path.parent.mkdir(exist_ok=True)
            previous = write_result(path, track)
        except OSError as error:
            raise HandtrackError(
                f"{path}: cannot be written ({error.strerror}). Is the folder read-only?"
            ) from None
        kept = f" The one before is kept as {previous.name}." if previous is not None else ""
        return f"{len(track)} frames are in {path}.{kept}"


def _damage(journal: Journal) -> str:
    """Return what is to be said of a journal's unreadable lines; the file as it is is kept, since they go when it is shortened."""
    if not journal.damaged:
        return ""
    kept = keep_version(journal.path)
    where = "" if kept is None else f" The file with them is kept as {kept}."
    return (
        f"{journal.path}: {journal.damaged} of its lines cannot be read, torn by a crash or damaged on the disk, and are "
        f"passed over: look whether poses or settings of last time are missing.{where}"
    )
