"""Work of earlier versions, which kept a journal and a track file: read as actions and frames of this one."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from handtrack.errors import HandtrackError
from handtrack.files.versions import keep_version
from handtrack.session.formats.tables import read_npz
from handtrack.session.journal import Event, read_events
from handtrack.session.layout import JOURNAL_FILE, POSES_FILE, WORK_FILE
from handtrack.store.current_track import TakeFrames
from handtrack.store.history import Value
from handtrack.tracking.frame.result import FrameResult
from handtrack_app.engine.document import Document
from handtrack_app.engine.store import keys
from handtrack_app.engine.store.tracks import result_of_row

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class EarlierWork:
    """What a journal of an earlier version says."""

    values: dict[str, Value] = field(default_factory=dict)
    tracked: dict[int, FrameResult] = field(default_factory=dict)

    @classmethod
    def read(cls, folder: Path, document: Document) -> EarlierWork:
        """Return what the journal of a session's folder says, as far as the document's model knows it."""
        work = cls()
        for event in read_events(folder):
            try:
                if event.kind == "tracked":
                    result = result_of_row(event.data, document)
                    work.tracked[result.frame] = result
                    if not event.data.get("by_hand", False):
                        work.values.pop(keys.pose(result.frame), None)
                else:
                    work.values.update(_values(event))
            except (KeyError, TypeError, ValueError, HandtrackError) as error:
                log.warning("journal entry %s passed over: %s", event.kind, error)
        return work

    @staticmethod
    def put_away(folder: Path) -> None:
        """Move the journal to versions/: from now on the store has it all."""
        if (folder / JOURNAL_FILE).is_file():
            keep_version(folder / JOURNAL_FILE)
            (folder / JOURNAL_FILE).unlink()


def takes_to_look_at(folder: Path) -> Iterator[TakeFrames]:
    """Yield the track files of a session's folder, to be shown where nothing can be written."""
    for name in (POSES_FILE, WORK_FILE):
        if (folder / name).is_file():
            try:
                track = read_npz(folder / name)
                settings = json.loads(track.settings or "{}")
                frames = {r.frame: r for r in track.frames()}
                yield TakeFrames(track.parameter_names, dict(frames), settings=settings)
            except HandtrackError as error:
                log.warning("%s cannot be shown: %s", name, error)


def _values(event: Event) -> dict[str, Value]:
    data = event.data
    match event.kind:
        case "pose":
            given = {name: float(value) for name, value in data["parameters"].items()}
            found = bool(data.get("found", False))
            return {keys.pose(int(data["frame"])): {"parameters": given, "found": found}}
        case "forget":
            return {keys.pose(int(data["frame"])): None}
        case "setting":
            return {keys.setting(str(data["name"])): data["value"]}
        case "limits":
            return {keys.limits(str(data["name"])): data["interval"]}
        case "scale":
            size = {"overall": float(data["overall"]), "parts": dict(data["parts"])}
            return {keys.SIZE: size | {"pending": bool(data.get("pending", False))}}
        case "clouds":
            return {keys.CLOUDS: None if data["table"] is None else {"table": data["table"]}}
    return {}
