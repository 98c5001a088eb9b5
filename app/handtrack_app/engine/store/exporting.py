"""Files for the browser: what has been tracked, in any format; made beside the worker, for a film may take minutes."""

from __future__ import annotations

import io
import json
import logging
import tempfile
import threading
import zipfile
from collections.abc import Callable
from pathlib import Path

from handtrack.errors import HandtrackError
from handtrack.export.registry import ExportFormat, export_format
from handtrack.export.table import ResultsTable
from handtrack_app.engine.document import Document
from handtrack_app.engine.store.tracks import whole_track
from handtrack_app.protocol.snapshots import Download, Notice

FIRST_POSE = "init"
log = logging.getLogger(__name__)


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
    stem = file_stem(document)
    if kind == FIRST_POSE:
        name, data = first_pose_file(document)
        publish(Download(name, data, client_id))
        return None
    chosen = export_format(kind)
    table = ResultsTable(whole_track(document), "this track", document.run.session.folder)

    def work() -> None:
        try:
            name, data = exported(chosen, table, stem, up)
            publish(Download(name, data, client_id))
        except HandtrackError as error:
            publish(Notice("error", "Not exported", str(error)))
        except Exception as error:  # the page must go on, and the user must know
            log.exception("internal error")
            publish(Notice.of_mistake(error))

    thread = threading.Thread(target=work, name="export", daemon=True)
    thread.start()
    return thread


def exported(
    chosen: ExportFormat, table: ResultsTable, stem: str, up: str = ""
) -> tuple[str, bytes]:
    """Return name and content of one file: a zip where the format is of several. Raises HandtrackError."""
    with tempfile.TemporaryDirectory() as folder:
        written = chosen.write(Path(folder) / f"{stem}{chosen.ending}", table, up)
        if not chosen.has_parts:
            return written[0].name, written[0].read_bytes()
        data = io.BytesIO()
        with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED) as archive:
            for path in written:
                archive.write(path, path.name)
        return f"{written[0].stem}.zip", data.getvalue()


def first_pose_file(document: Document) -> tuple[str, bytes]:
    """Return name and content of the pose that is shown, as init.json."""
    values = dict(zip(document.model.parameter_names, document.shown.tolist(), strict=True))
    text = json.dumps({"frame": document.frame, "parameters": values}, indent=1) + "\n"
    return f"{file_stem(document)}_frame{document.frame}_init.json", text.encode()


def file_stem(document: Document) -> str:
    """Return the session's name as files may have it."""
    name = document.run.session.name
    return "".join(c if c.isalnum() else "_" for c in name).strip("_") or "session"
