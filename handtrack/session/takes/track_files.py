"""The track that lies in a session's folder as a file becomes a take, once: nothing that is written over is lost."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from hashlib import blake2b
from pathlib import Path

from handtrack.errors import HandtrackError
from handtrack.files.atomic import replacing
from handtrack.files.versions import keep_version
from handtrack.session.formats.tables import read_npz, write_npz
from handtrack.session.layout import POSES_FILE
from handtrack.store.spans import Span
from handtrack.store.store import WritableStore
from handtrack.store.take import TakeAbout
from handtrack.tracking.frame.result import TrackResult


def import_track(store: WritableStore, folder: Path) -> str:
    """Make a take of a session's track file that the store does not know, another program's say; say so. The file stays; of
    one that cannot be read is told, and no take made.
    """
    path = folder / POSES_FILE
    if (
        not path.is_file()
        or path.is_symlink()
        or (digest := file_digest(path)) in store.known_files()
    ):
        return ""
    try:
        number = _imported(store, read_npz(path))
    except HandtrackError as error:
        return f"{error} It is kept as it is in versions/ when it is written over."
    store.know_file(digest)
    return f"{path} is kept as take {number}."


def make_current(store: WritableStore, spans: Sequence[Span], words: str, path: Path) -> None:
    """Make spans of takes the current track, and write it to the session's track file: both, or neither where the disk is full.

    Raises HandtrackError where they cannot be one track, and OSError.
    """
    track = store.track_of(store.composed(spans))
    assert track is not None, "spans have frames"
    path.parent.mkdir(exist_ok=True)
    keep_version(path)
    with replacing(path) as part:
        write_npz(part, track)
        store.make_current(spans, words)
    store.know_file(file_digest(path))


def file_digest(path: Path) -> str:
    """Return what tells a file's content from any other."""
    total = blake2b(digest_size=16)
    with path.open("rb") as file:
        while chunk := file.read(1 << 20):
            total.update(chunk)
    return total.hexdigest()


def _imported(store: WritableStore, track: TrackResult) -> int:
    first, stop = int(track.frame[0]), int(track.frame[-1]) + 1
    now = datetime.now(UTC).isoformat(timespec="seconds")
    writer = store.begin(TakeAbout(POSES_FILE, now, (first, stop), track.labels))
    for result in track.frames():
        writer.replace(result)
    writer.finish()
    if not store.current():
        store.make_current([Span(writer.take.number, first, stop)])
    return writer.take.number
