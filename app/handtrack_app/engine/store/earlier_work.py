"""Work of earlier versions and of other programs: their files become actions and takes, once."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import TYPE_CHECKING

from handtrack.errors import HandtrackError
from handtrack.files.versions import keep_version
from handtrack.session.formats.tables import read_npz
from handtrack.session.journal import Event, read_events
from handtrack.session.layout import JOURNAL_FILE, POSES_FILE, WORK_FILE
from handtrack.session.takes.track_files import import_tracks
from handtrack.store.current_track import TakeFrames
from handtrack.store.history import Value
from handtrack.store.spans import Span
from handtrack.tracking.frame.result import FrameResult
from handtrack_app.engine import keys
from handtrack_app.engine.store.tracks import result_of_row

if TYPE_CHECKING:
    from handtrack_app.engine.store.persistence import Persistence

log = logging.getLogger(__name__)
_WORDS = "Work of an earlier version"


def earlier_work(store: Persistence, folder: Path) -> list[str]:
    """Take what the store does not know yet of a session's folder; return sentences about it.

    Track files become takes; the journal that the workbench kept before it had this store becomes one action and a take,
    and goes to versions/.
    """
    said = [] if store.store is None else import_tracks(store.store, folder)
    spans = store.history.state.get(keys.SPANS)
    if spans is not None and spans != store.document.state.get(keys.SPANS):
        store.document.apply({keys.SPANS: spans})
    if store.store is None and spans is None:
        _show_files(store, folder)
    events = read_events(folder)
    if events:
        _take_journal(store, events)
        if store.store is not None:
            keep_version(folder / JOURNAL_FILE)
            (folder / JOURNAL_FILE).unlink()
    return said


def _show_files(store: Persistence, folder: Path) -> None:
    """Where nothing can be written, a track file is only shown."""
    document = store.document
    for name in (POSES_FILE, WORK_FILE):
        if not (folder / name).is_file():
            continue
        try:
            track = read_npz(folder / name)
        except HandtrackError as error:
            log.warning("%s cannot be shown: %s", name, error)
            continue
        number = document.takes.next_number
        take = TakeFrames(track.parameter_names, {r.frame: r for r in track.frames()})
        document.takes.put(number, take)
        document.apply(keys.spans([Span(number, min(take), max(take) + 1)]))


def _take_journal(store: Persistence, events: list[Event]) -> None:
    values, tracked = dict[str, Value](), dict[int, FrameResult]()
    for event in events:
        try:
            if event.kind == "tracked":
                result = result_of_row(event.data, store.document)
                tracked[result.frame] = result
                if not event.data.get("by_hand", False):
                    values.pop(keys.pose(result.frame), None)
            else:
                values |= _values(event)
        except (KeyError, TypeError, ValueError, HandtrackError) as error:
            log.warning("journal entry %s passed over: %s", event.kind, error)
    for key, value in values.items():
        try:
            store.do(_WORDS, {key: value}, tag=_WORDS)
        except HandtrackError as error:
            log.warning("%s of an earlier version passed over: %s", key, error)
    if tracked:
        first = min(tracked)
        start = store.document.start_params(first)
        store.begin_take(range(first, max(tracked) + 1), first, start)
        for result in tracked.values():
            store.add(result)
        store.end_take(finished=False)


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
