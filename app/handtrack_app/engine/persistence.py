"""What outlives the page: every action and every tracked frame goes to the session's store, and comes back from it."""

from __future__ import annotations

import json
import logging
import shutil
import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from operator import attrgetter
from pathlib import Path
from typing import Any, get_args

from handtrack.arrays import Floats, P
from handtrack.capture.masks.segmentation import METHODS
from handtrack.errors import HandtrackError
from handtrack.export.registry import ExportFormat, export_format
from handtrack.export.table import ResultsTable
from handtrack.files.atomic import keep_version, remove_abandoned, replacing
from handtrack.files.toml_edit import edit_toml
from handtrack.files.toml_table import read_toml
from handtrack.model.articulated import HandScale
from handtrack.model.model_file import write_scale
from handtrack.session.first_pose import FirstPose, write_first_pose
from handtrack.session.layout import HAND_FILE, INIT_FILE, POSES_FILE, SESSION_FILE, TRACKS_FOLDER
from handtrack.session.session_state import (
    Correction,
    DecidedSize,
    Edit,
    Key,
    MaskSource,
    SessionState,
    decide,
    in_turn,
    name_of,
    read,
    readable,
    written,
)
from handtrack.session.tables import read_npz, write_npz
from handtrack.session.takes import (
    file_digest,
    foreign_takes,
    import_track,
    refined_by,
    versions_in_use,
)
from handtrack.session.track_session import keyframe_result
from handtrack.store.history import DO, NOTE, Action, Change, History, Kind, Span, merged
from handtrack.store.lease import LeaseTaken, was_left
from handtrack.store.store import Store, WritableStore, resolved
from handtrack.store.take import TakeAbout, TakeFrames, TakeWriter
from handtrack.tracking.frame.result import FrameResult, TrackResult
from handtrack.tracking.whole.refinement import Refinement
from handtrack_app.engine import edits
from handtrack_app.engine.document import Document, TakeCache, correction_of, pinning, usual_values
from handtrack_app.protocol import Download, FileKind, Notice

PROGRAM = "handtrack open"
_UNREADABLE = (HandtrackError, ValueError, KeyError, TypeError)
"""what is raised of values that were written by others, or long ago"""


@dataclass
class OpenTake:
    """Its frames are on the document's shelf at once."""

    number: int
    frames: range
    first: int
    """where tracking started: a pose set by hand there gives way to what is tracked"""
    take_frames: TakeFrames
    writer: TakeWriter | None
    """None: of a session that keeps nothing"""
    waiting: dict[int, FrameResult] = field(default_factory=dict)
    """frames that could not be written yet"""
    what: str = "Tracking"
    scale: HandScale | None = None
    """of the hand, where it is another than the document's"""

    def keep(self, result: FrameResult) -> None:
        """Keep a frame. Raises HandtrackError where it, or those before it, cannot be written now."""
        self.take_frames.put(result, None)
        if self.writer is not None:
            self.waiting[result.frame] = result
            self.write_waiting(self.writer)

    def write_waiting(self, writer: TakeWriter) -> None:
        """Write what could not be written before. Raises HandtrackError where it still cannot be."""
        for waiting in list(self.waiting.values()):
            self.take_frames.put(waiting, writer.replace(waiting))
            del self.waiting[waiting.frame]


def restored_message(document: Document) -> str:
    """Return the sentence; empty where there is nothing."""
    state = document.state
    searched = sum(document.decided_pose(frame).found for frame in document.by_hand)
    parts = [
        f"{count} {one if count == 1 else many}"
        for count, one, many in (
            (len(document.results), "tracked frame", "tracked frames"),
            (len(document.by_hand) - searched, "pose set by hand", "poses set by hand"),
            (searched, "pose found", "poses found"),
            (
                len(state.setting) + len(state.limits) + len(document.unsaved("clouds")),
                "changed setting",
                "changed settings",
            ),
            (len(state.camera), "corrected camera", "corrected cameras"),
        )
        if count
    ]
    return f"Restored from last time: {', '.join(parts)}." if parts else ""


log = logging.getLogger(__name__)

_IN_FILES = ("correction", "pins")
"""what has files of its own, for others to read"""
_SETTINGS = "a session's settings"
_TABLES = {"setting": "tracking", "clouds": "clouds"}
_UNWRITABLE = "nothing can be written there, so work on this session would be lost"
_MERGE_S = 0.8  # edits of one control closer than this are one step of undo: a drag is one step
_QUIET_S = 0.4  # edits by hand are written when none came for this long
_LONGEST_S = 1.0  # and at the latest after this, however long a drag lasts
FIXED = (
    "Settings and takes stay fixed while tracking runs, so that a result has one. Cancel it first."
)


@dataclass
class Persistence:
    """The one way in which a document changes for good: an action is applied, counted, and written.

    What is edited by hand is written a second later at most, everything else at once; what cannot be written stays, and
    is tried again. Without a store, of a live session or where another program writes, all works and nothing is kept.
    """

    document: Document
    store: WritableStore | None
    history: History = field(default_factory=History)
    warning: str = ""
    _cut_off: bool = False
    """whether the program that wrote here before did not come to its end"""
    _unwritten: list[Action] = field(default_factory=list)
    _to_file: dict[Key, Any] = field(default_factory=dict)
    """corrections and pins of the action written last, whose files are not written yet"""
    _take: OpenTake | None = None
    _corrections: dict[tuple[str, int], bytes | None] = field(default_factory=dict)
    """files of them as they were written here: what stands there otherwise is kept"""
    _pins_text: str | None = None
    """pins.json as it was written here"""
    said: tuple[str, int] | None = None
    """whose command is served, and its number"""
    tag: str = ""
    """of the control that was moved last: what follows with it is one step"""
    _when: float = 0.0
    _first_waits: float | None = None
    """since when an edit waits to be written; None: none does, or what does was told"""

    @classmethod
    def open(cls, document: Document, take_over: bool = False) -> Persistence:
        """Return the store of a session; one that cannot be written to, or that another program writes to, works, with a
        warning. A live one keeps nothing. take_over: even from another program, which can write no more.
        """
        if document.session.live is not None:
            return cls(document, None)
        folder = document.session.folder / TRACKS_FOLDER
        cut_off = was_left(folder)
        try:
            store = WritableStore(folder, PROGRAM, take_over)
        except (HandtrackError, OSError) as error:
            message = str(error)
            if isinstance(error, LeaseTaken):
                message += " It is open read-only; nothing is saved."
            elif isinstance(error, OSError):
                message = f"{folder}: {_UNWRITABLE} ({error.strerror})."
            return cls(document, None, Store(folder).history(), message)
        for ours in (folder, folder.parent):
            remove_abandoned(ours)  # the lease is ours: nobody else writes there
        damage = " ".join(store.damage(takes=False))
        return cls(document, store, store.history(), damage, cut_off)

    @property
    def folder(self) -> Path:
        return self.document.session.folder

    def check(self) -> None:
        """Raise HandtrackError where nothing may be written, with the reason."""
        if self.store is not None:
            self.store.lease.check()
        elif self.warning:
            raise HandtrackError(self.warning)

    # ---- actions

    def do(
        self,
        words: str,
        edit: Edit,
        tag: str = "",
        kind: Kind = DO,
        waits: bool = False,
        is_stroke: bool = False,
    ) -> bool:
        """Make an edit; return whether that changed anything.

        words: what is done, for undo. tag: of the control that is moved; what follows with the same is one step. waits: it
        is written once edits rest. is_stroke: the tag is of this one drag, which is one step however long it takes. Raises HandtrackError: for what cannot be, and nothing is changed; or where it cannot be
        written, and it stands, and is tried again.
        """
        document = self.document
        state = document.state
        after = edit(state).changed(state)
        changes = list[Change]()
        for key, value in after.items():
            stood, holds = written(key, document.in_force(key)), written(key, value)
            if stood != holds:
                changes.append(Change(name_of(key), stood, holds))
        if not changes:
            return False
        document.become(state.having(read({change.key: change.after for change in changes})))
        now = time.monotonic()
        soon = is_stroke or now - self._when < _MERGE_S
        follows = bool(tag) and tag == self.tag and soon
        if kind == DO:
            self.tag, self._when = tag, now
        last = self._unwritten[-1] if follows and self._unwritten else None
        if last is not None and last.kind == DO:
            whole = merged([last, Action(last.id, DO, words, tuple(changes))])
            self._unwritten[-1] = replace(last, changes=whole, said=self.said)
            self.history.take(replace(self._unwritten[-1], joins=True))
        else:
            joins = follows and bool(self.history.past)
            self._take_action(self.history.next(words, changes, kind, joins))
        self._after_edit(waits)
        return True

    def undo(self, busy: bool = False) -> Action | None:
        """Take the latest step back; return what that changes, None at the end of the history. busy: a job runs."""
        return self._travel(self.history.undoing(), busy)

    def redo(self, busy: bool = False) -> Action | None:
        """Make the step again that was undone last; return what that changes, None where there is none."""
        return self._travel(self.history.redoing(), busy)

    def _travel(self, action: Action | None, busy: bool) -> Action | None:
        if action is None:
            return None
        after = read(action.after)
        if busy and any(kind != "pose" for kind, _ in after):
            raise HandtrackError(FIXED)
        self.document.become(self.document.state.having(after))
        self._take_action(action)
        self.tag = ""
        self._after_edit()
        return action

    def _after_edit(self, waits: bool = False) -> None:
        """Leave to session.toml what it says, and write, or remember that an edit waits."""
        self._leave_what_the_file_says()
        if self._first_waits is None:
            self._first_waits = time.monotonic()
        if not waits:
            self.flush()

    def _leave_what_the_file_says(self) -> None:
        """Leave to session.toml each kind of decision that it says already."""
        for kind in get_args(FileKind):
            if getattr(self.document.state, kind) and not self.document.unsaved(kind):
                self.leave_to_the_file(kind)

    def leave_to_the_file(self, kind: str) -> None:
        """The session's files say what was decided of a kind: it may be edited there, and is not to be written over later."""
        state, known = self.document.state, self.history.state
        left = state.without(kind)
        self.document.become(left)
        names = [name for key in left.changed(state) if (name := name_of(key)) in known]
        if names:
            changes = [Change(name, known[name], None) for name in names]
            self._take_action(self.history.next("As the session's files have it", changes, NOTE))

    def _take_action(self, action: Action) -> None:
        action = replace(action, said=self.said)
        self.history.take(action)
        self._unwritten.append(action)

    def write_what_rests(self, at_once: bool = False) -> bool:
        """Write edits once none came for a while, or they go on and on; return whether there were any. What could not be
        written, and was told, is not tried again here.
        """
        now, since = time.monotonic(), self._first_waits
        rests = since is not None and (now - self._when > _QUIET_S or now - since > _LONGEST_S)
        if since is None or not (rests or at_once):
            return False
        self.flush()
        return True

    def flush(self) -> None:
        """Write what waits; raise HandtrackError for what cannot be: it stays, and is tried again with the next action."""
        self._first_waits = None
        while self.has_edits_to_write:
            if self.store is None:
                self._unwritten.clear()
                return
            self.check()
            if not self._to_file:
                self.store.write(self._unwritten[0])
                after = read(self._unwritten.pop(0).after)
                self._to_file = {key: v for key, v in after.items() if key[0] in _IN_FILES}
            self._write_files()

    def _write_files(self) -> None:
        """Write files of corrections and pins after their action: of a program that is cut off in between, the next one knows by the
        action what they were and what they are to be (`_finish_files`).
        """
        session, after = self.document.session, self._to_file
        for (kind, at), value in after.items():
            if kind == "correction":
                place, content = correction_of(session, at, value)
                if place.write(at[1], content, self._corrections.get(at)):
                    self._corrections[at] = content
        if pinned := {frame: own for (kind, frame), own in after.items() if kind == "pins"}:
            self._pins_text = session.pins.write(pinned, self._pins_text)
        self._to_file = {}

    def _finish_files(self) -> None:
        """The program before was cut off: files that stand as they were before its last action are written. Any other counts as
        it stands: somebody changed it.
        """
        document, pins = self.document, self.document.session.pins
        last = deque(Store(self.folder / TRACKS_FOLDER).actions(), 1)
        try:
            before, after = (
                read({c.key: value(c) for action in last for c in action.changes})
                for value in (attrgetter("before"), attrgetter("after"))
            )
            pinned = pins.text
            were = readable(self.history.state).having(before).pins
            for key, value in after.items():
                kind, at = key
                if kind == "pins" and pinned == pins.text_of(were):
                    self._to_file[key], self._pins_text = value, pinned
                    pins.hold(at, map(pins.as_written, value or ()))
                elif kind == "correction":
                    stands, was = (one and one.png for one in (document.in_force(key), before[key]))
                    if stands == was:
                        self._to_file[key], self._corrections[at] = value, stands
            self._write_files()
        except _UNREADABLE as error:
            self._warn(str(error))

    def _corrected_elsewhere(self) -> Iterator[Edit]:
        """Yield edits by what files of corrections say otherwise than the state, which was written after them."""
        for at, correction in self.document.state.correction.items():
            with suppress(HandtrackError):  # what cannot be is told where the state is applied
                place, content = correction_of(self.document.session, at, correction)
                path = place.path(at[1])
                stands = path.read_bytes() if path.is_file() else None
                if stands == content:
                    self._corrections[at] = stands
                else:
                    now = None if stands is None else Correction(stands)
                    yield decide(correction={at: now})

    @property
    def has_edits_to_write(self) -> bool:
        """Whether anything that was decided is not on disk yet."""
        return bool(self._unwritten or self._to_file)

    @property
    def saved(self) -> str:
        """How far the work is on disk, as WorkSnapshot says it."""
        if self.store is None:
            return "kept nowhere" if self.warning else ""
        if not self.has_edits_to_write and not (self._take and self._take.waiting):
            return "saved"
        return "unsaved" if self._first_waits is None else "saving"

    # ---- takes

    def begin_take(
        self,
        frames: range,
        first: int,
        params: Floats[P],
        keyframes: tuple[int, ...] = (),
        is_refined: bool = False,
        shared: Refinement | None = None,
    ) -> None:
        """Begin a take; tracking starts at frame `first` with solver parameters. It shows over what was tracked before from its first
        frame on. is_refined: it is of all frames together; shared: what these share, of which a hand's size holds with it. Raises
        HandtrackError.
        """
        document, store = self.document, self.store
        run, scale = document.run, None if shared is None else shared.scale
        labels = (run if scale is None else run.with_scale(scale)).labels
        labels = replace(labels, refinement=None if shared is None else shared.text)
        take_frames = TakeFrames(labels)
        about = TakeAbout(
            by=refined_by(PROGRAM) if is_refined else PROGRAM,
            begun=datetime.now(UTC).isoformat(timespec="seconds"),
            frames=(frames.start, frames.stop),
            labels=labels,
            inputs={} if store is None else document.files_read(),
            start={"frame": first, "parameters": params.tolist()},
            keyframes=keyframes,
            versions=versions_in_use(),
        )
        writer = None if store is None else store.begin(about)
        number = document.takes.next_number if writer is None else writer.take.number
        document.takes.put(number, take_frames)
        what = "Refining" if is_refined else "Tracking"
        self._take = OpenTake(number, frames, first, take_frames, writer, what=what, scale=scale)

    def add(self, result: FrameResult) -> bool:
        """Keep a tracked frame, whatever happens to this program; half a second later at most it is on disk. Return whether it is new."""
        take = self._take
        if take is None:
            return True  # it could not be begun, which was reported
        if take.take_frames.get(result.frame) is result:
            return False
        if self.document.is_locked(result.frame) and result.frame not in take.take_frames:
            return True  # accepted while tracking ran
        is_first = not take.take_frames
        try:
            take.keep(result)
        except HandtrackError:
            if len(take.waiting) == 1:  # else that was told
                raise
        finally:
            if is_first:
                self._show(take)
        return True

    def _show(self, take: OpenTake) -> None:
        """Lay a take over the others."""
        if take.writer is not None:
            with suppress(HandtrackError):
                take.writer.sync()  # its first frame is to be safe before anybody is told of it
        document, span = self.document, Span(take.number, take.frames.start, take.frames.stop)
        under = resolved(document.state.spans, document.takes.frames_of)
        laid = [decide(spans=(*under, span))]
        posed = {f for f in document.by_hand if f in take.frames}
        solved = {f for f in posed - document.accepted if document.decided_pose(f).is_led}
        given_way = solved | (posed & take.take_frames.keys() & {take.first})
        laid.append(decide(pose=dict.fromkeys(given_way)))
        if take.scale is not None:
            laid.append(edits.size(take.scale, live=document.size.live or document.run.scale))
        words = f"frames {span.first} to {span.stop - 1}"
        words = f"frame {take.first}" if len(take.frames) == 1 else words
        self.do(f"{take.what} of {words}", in_turn(*laid))

    def end_take(self, finished: bool) -> None:
        """Say that no frame comes any more; finished: all of them did. Raises HandtrackError where frames could not be
        written: they stay as long as the program runs.
        """
        take, self._take = self._take, None
        self.document.takes.forget_cards()
        if take is None or not take.take_frames:
            return
        try:
            self.flush()
            if take.writer is not None:
                take.write_waiting(take.writer)
                if finished:
                    take.writer.finish()
        except HandtrackError as error:
            raise HandtrackError(
                f"{error} What was tracked stays as long as the workbench is open: save the track once there is room."
            ) from None

    # ---- bringing back

    def restore(self) -> str:
        """Bring back what was decided and tracked; say what, in a sentence."""
        document = self.document
        if document.session.live is not None:
            return ""
        document.takes = TakeCache(self.folder / TRACKS_FOLDER, self._warn)
        if self._cut_off and self.store is not None:
            self._finish_files()
        pins = document.session.pins
        in_file, pinned = pins.text, {frame: pins.of(frame) for frame in pins.frames}
        state = readable(self.history.state, self._pass_over)
        is_known = bool(self.history.state)
        self._become(state)
        self._take_files()
        changed, pins, known = (
            [*self._corrected_elsewhere()],
            document.session.pins,
            document.state.pins,
        )
        if pins.text_of(known) != in_file:  # their file is another's
            changed.append(pinning({frame: pinned.get(frame, ()) for frame in {*pinned, *known}}))
        for edit in changed:
            self.do("As the session's files have it", edit, kind=NOTE)
        self._leave_what_the_file_says()  # what was saved by a program that was cut off then
        self._take_model_of_track()
        self._take_size_of_track()
        disk = self.store or Store(self.folder / TRACKS_FOLDER)
        for text in foreign_takes(disk, document.session, document.files_read()):
            self._warn(text)
        return restored_message(document) if is_known else ""

    def _become(self, state: SessionState) -> None:
        """Let a state hold whole; where a part of it cannot be any more, the rest, and say which."""
        document = self.document
        try:
            document.become(state)
        except _UNREADABLE:
            for key, value in state.changed(document.state).items():
                try:
                    document.become(document.state.having({key: value}))
                except _UNREADABLE as error:
                    self._pass_over(name_of(key), error)

    def _pass_over(self, name: str, error: Exception) -> None:
        log.warning("%s of last time passed over: %s", name, error)
        self._warn(f"Not restored from last time: {name}. {error}")

    def _take_files(self) -> None:
        """Make takes of track files that the store does not know; where nothing can be written, only show them."""
        document, spans = self.document, self.document.state.spans
        if self.store is not None:
            text = import_track(self.store, self.folder)
            if not spans:
                document.apply(decide(spans=readable(self.history.state).spans))
            if text and (spans or not document.state.spans):  # else it is what the timeline shows
                self._warn(text)
        elif not spans:
            show_track_file(document)

    def _take_model_of_track(self) -> None:
        """A forearm that is left to the program was decided while tracking: the current take says how."""
        document, spans = self.document, self.document.state.spans
        if spans and document.run.leaves_forearm_open:
            with suppress(HandtrackError):  # it stays hidden, which the timeline tells
                edit = edits.model_of_take(document, spans[-1].take)
                if [*edit(document.state).changed(document.state)] == [("forearm", None)]:
                    self.do("Forearm as tracked", edit, kind=NOTE)

    def _take_size_of_track(self) -> None:
        """The hand's size that the current track was made with counts, where none was decided since."""
        document, spans = self.document, self.document.state.spans
        take = document.takes.get(spans[-1].take) if spans else None
        if document.state.size is not None or take is None:
            return
        try:
            labels = take.labels
            if labels.model == document.run.labels.model:
                size = DecidedSize.of(json.loads(labels.scale))
                self.do("The track's size", decide(size=size), kind=NOTE)
        except _UNREADABLE as error:
            log.warning("the size of the track is not known: %s", error)

    def _warn(self, text: str) -> None:
        self.warning = f"{self.warning} {text}".strip()

    # ---- on request: what stands in the workbench goes into the session's own files, the one before kept

    def save_first_pose(self) -> str:
        """Write the pose shown to init.json; return a sentence about it."""
        self.check()
        document = self.document
        values = {name: round(v, 6) for name, v in document.model.named(document.shown).items()}
        path = self.folder / INIT_FILE
        try:
            said = self._keep_hand_size()
            keep_version(path)
            size = document.run.scale if document.size.pending else None
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
        if self.document.size.pending or not path.is_file():
            return ""
        hand = read_toml(path, _SETTINGS).get("hand")
        if not isinstance(hand, dict) or hand.get("scale") != "fit":
            return ""
        keep_version(self.folder / HAND_FILE)
        write_scale(self.folder / HAND_FILE, run.scale)
        edit_toml(path, {"hand.scale": HAND_FILE}, _SETTINGS)
        return f" The fitted size is kept in {HAND_FILE}."

    def save_settings(self, kind: FileKind) -> str:
        """Write what was changed of a kind into session.toml, which says it from now on; return a sentence about it."""
        self.check()
        document = self.document
        now, unsaved = document.settings, document.unsaved(kind)
        if not unsaved:
            return "session.toml has these settings already."
        if kind == "masks":
            what, changes = "Masks", dict[str, object]()
            for number, camera in enumerate(document.session.file.cameras):
                if (name := camera.name) in unsaved:
                    saved = document.saved["masks"][name]
                    changes |= _mask_changes(f"camera.{number}", now["masks"][name], saved)
                    changes[f"camera.{number}.mask_unknown"] = camera.mask_unknown
        else:
            what, values = f"[{_TABLES[kind]}]", now[kind]
            changes = {f"{_TABLES[kind]}.{name}": values.get(name) for name in unsaved}
        kept = edit_toml(self.folder / SESSION_FILE, changes, _SETTINGS)
        document.saved = {**document.saved, kind: now[kind]}
        self.leave_to_the_file(kind)
        self.flush()
        return f"{what} of session.toml: {', '.join(unsaved)}.{kept}"

    def save_track(self) -> str:
        """Write tracks/poses.npz; return a sentence about it."""
        self.check()
        path = self.folder / POSES_FILE
        track = whole_track(self.document)
        try:
            path.parent.mkdir(exist_ok=True)
            previous = keep_version(path)
            with replacing(path) as part:
                write_npz(part, track)
                if self.store is not None:  # known before it is there: else it would become a take
                    self.store.know_file(file_digest(part))
        except OSError as error:
            raise HandtrackError(
                f"{path}: cannot be written ({error.strerror}). Is the folder read-only?"
            ) from None
        kept = f" The one before is kept as {previous.name}." if previous is not None else ""
        return f"{len(track)} frames are in {path}.{kept}"

    def close(self) -> None:
        """Write what waits, and let others write."""
        try:
            self.flush()
        finally:
            if self.store is not None:
                self.store.close()


def _mask_changes(place: str, now: MaskSource, saved: MaskSource) -> dict[str, object]:
    """Return what is to be changed of a camera's table: of the same method only what differs."""
    table, known = now.masks, saved.masks
    changes: dict[str, object] = {f"{place}.roi": None if now.roi is None else list(now.roi)}
    if not isinstance(table, dict):
        return changes | {f"{place}.masks": table}
    if isinstance(known, dict) and known["method"] == table["method"]:
        differ = {key: value for key, value in table.items() if value != known[key]}
        return changes | {f"{place}.masks.{key}": value for key, value in differ.items()}
    usual = usual_values(METHODS[table["method"]])
    said = {k: v for k, v in table.items() if k not in usual or v != usual[k]}
    return changes | {f"{place}.masks": said}


# ---- Tracks: all frames with poses set by hand as one; a track file where nothing can be written


def whole_track(document: Document) -> TrackResult:
    """Return all frames as one TrackResult; poses set by hand are keyframes."""
    frames = dict(document.results)
    given = document.by_hand.items()
    frames |= {frame: keyframe_result(document.run, frame, pose) for frame, pose in given}
    if not frames:
        raise HandtrackError(
            f"There is nothing to save yet: track some frames, or pose the {document.model.kind}, first."
        )
    track = document.run.result(sorted(frames.values(), key=lambda result: result.frame))
    return replace(track, refinement=document.results.refinement)


def show_track_file(document: Document) -> None:
    """Show the track file of a session's folder, the person it was tracked with, as a take that is not on disk; nothing where there is none."""
    path = document.session.folder / POSES_FILE
    if not path.is_file():
        return
    try:
        track, number = read_npz(path), document.takes.next_number
        frames = {r.frame: r for r in track.frames()}
        document.takes.put(number, TakeFrames(track.labels, dict(frames)))
        document.apply(decide(spans=(Span(number, min(frames), max(frames) + 1),)))
        document.apply(edits.model_of_take(document, number))
        if track.scale:
            document.apply(decide(size=DecidedSize.of(json.loads(track.scale))))
    except _UNREADABLE as error:
        log.warning("%s cannot be shown: %s", path, error)


FIRST_POSE = "init"


def export_beside(
    document: Document,
    kind: str,
    client_id: int,
    up: str,
    publish: Callable[[Download | Notice], None],
) -> threading.Thread | None:
    """Send a file to the client that asked: the pose that is shown, or what has been tracked so far, which is taken now and
    written by the thread that is returned. Raises HandtrackError where there is nothing to send.
    """
    name = document.session.name
    stem = "".join(c if c.isalnum() else "_" for c in name).strip("_") or "session"
    if kind == FIRST_POSE:
        pose = {"frame": document.frame, "parameters": document.model.named(document.shown)}
        data = (json.dumps(pose, indent=1) + "\n").encode()
        publish(Download(f"{stem}_frame{document.frame}_init.json", data, client_id))
        return None
    chosen = export_format(kind)
    table = ResultsTable(whole_track(document), "this track", document.session.folder)

    def work() -> None:
        try:
            name, data = exported(chosen, table, stem, up)
            publish(Download(name, data, client_id))
        except Exception as error:
            publish(Notice.of_error(error, "Not exported"))

    thread = threading.Thread(target=work, name="export", daemon=True)
    thread.start()
    return thread


def exported(
    chosen: ExportFormat, table: ResultsTable, stem: str, up: str = ""
) -> tuple[str, bytes]:
    """Return name and content of one file: a zip where the format is of several. Raises HandtrackError."""
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryDirectory() as beside:
        file = chosen.write(Path(folder) / f"{stem}{chosen.ending}", table, up)[0]
        if chosen.has_parts:
            file = Path(shutil.make_archive(str(Path(beside) / file.stem), "zip", folder))
        return file.name, file.read_bytes()
