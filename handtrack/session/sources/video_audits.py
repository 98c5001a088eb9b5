"""What was learned of a session's videos by decoding them whole, kept beside its tracks for the next opening."""

from __future__ import annotations

import atexit
import json
import threading
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path

import msgspec

from handtrack.capture.images.video import ENDING, VideoAudit, VideoFile, file_stamp
from handtrack.errors import HandtrackError
from handtrack.files.atomic import replace_text
from handtrack.session.layout import VIDEOS_FILE, place_of

_FORMAT = 2


def read_audit(folder: Path, video: Path) -> VideoAudit | None:
    """Return what is kept of a video; None where nothing is, or it is of a file that has changed since."""
    try:
        kept = json.loads((folder / VIDEOS_FILE).read_text(encoding="utf-8"))
        row = kept["videos"][place_of(video, folder)]
        if kept["format"] != _FORMAT or row["stamp"] != file_stamp(video):
            return None
        return msgspec.convert(row, VideoAudit, strict=False)
    except (OSError, ValueError, KeyError, TypeError):  # made anew, it costs time alone
        return None


def keep_audits(folder: Path, videos: Iterable[VideoFile]) -> None:
    """Write what is known of some videos; where the folder cannot be written, the next opening counts again."""
    try:
        rows = {
            place_of(video.path, folder): asdict(audit) | {"stamp": file_stamp(video.path)}
            for video in videos
            if (audit := video.audit) is not None
        }
        path = folder / VIDEOS_FILE
        text = json.dumps({"format": _FORMAT, "videos": rows}, indent=1)
        if rows and not (path.is_file() and path.read_text(encoding="utf-8") == text):
            path.parent.mkdir(exist_ok=True)
            replace_text(path, text)
    except (OSError, ValueError):
        return


def count_beside(folder: Path | None, videos: Sequence[VideoFile]) -> threading.Thread:
    """Begin to count videos' frames on a thread of its own; what is found is kept in a session's folder, if one is given."""

    def count() -> None:
        for video in videos:
            with suppress(HandtrackError):  # told to whoever asks for the frames
                video.audited()
        if folder is not None:
            keep_audits(folder, videos)

    thread = threading.Thread(target=count, name="video-count", daemon=True)
    thread.start()
    atexit.register(_end, thread)
    return thread


def _end(thread: threading.Thread) -> None:
    ENDING.set()
    thread.join()
