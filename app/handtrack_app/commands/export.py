"""`handtrack export`: a tracked sequence in another format."""

from __future__ import annotations

import argparse
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from handtrack.errors import HandtrackError
from handtrack.export.registry import FORMATS, export_format
from handtrack.export.table import ArchiveMetadata, ResultsTable
from handtrack.files.versions import keep_version
from handtrack.session.layout import POSES_FILE, SESSION_FILE, TRACKS_FOLDER
from handtrack.session.session import Session
from handtrack.session.takes.take_about import foreign_result, foreign_takes
from handtrack.store.store import Store
from handtrack.tracking.frame.result import TrackResult
from handtrack_app.commands.terminal.answer import answer
from handtrack_app.commands.terminal.output import output_file
from handtrack_app.commands.terminal.progress import say

_NEGLIGIBLE_M = 1e-4  # a tenth of a millimetre: the bound that every format is held to


def run(args: argparse.Namespace) -> int:
    """Write the converted file, and those that belong to it, and name them."""
    if args.to is None:
        formats = {known.name: known.purpose for known in FORMATS}
        answer(args, formats, *(f"{name:10} {purpose}" for name, purpose in formats.items()))
        return 0
    chosen = export_format(args.to)
    folder = args.session or session_of(args.poses)
    table = ResultsTable.read(args.poses, folder)
    table = replace(table, mano=args.mano)
    if args.metadata is not None:
        table = replace(table, metadata=ArchiveMetadata.read(args.metadata))
    out: Path = args.out or args.poses.with_name(f"{args.poses.stem}{chosen.ending}")
    output_file(out, (chosen.suffix,), f"{args.to} exports are")
    if out.resolve() == args.poses.resolve():
        raise HandtrackError(
            f"--out {out}: that is the file that is read; nothing was written. Name another one."
        )
    try:
        previous = keep_version(out)
        written = chosen.write(out, table, args.up or "", args.landmarks or "")
    except OSError as error:
        raise HandtrackError(
            f"--out {out}: cannot be written ({error.strerror}). Name another place with --out."
        ) from None
    kept = f"; the file before is kept as {previous}" if previous else ""
    beside = f", with {', '.join(path.name for path in written[1:])}" if written[1:] else ""
    told = {"frames": len(table.track), "output": out, "files": written, "previous": previous}
    answer(args, told, f"{len(table.track)} frames written to {out}{beside}{kept}")
    for text in () if folder is None else _foreign(table.track, args.poses, folder):
        say(f"note: {text}")
    if chosen.one_skeleton and table.misfit_m > _NEGLIGIBLE_M:
        say(
            f"note: {args.poses} has frames with different hand sizes; {args.to} has one skeleton for all, with errors of up to "
            f"{1e3 * table.misfit_m:.1f} mm in some frames."
        )
    return 0


def _foreign(track: TrackResult, poses: Path, folder: Path) -> list[str]:
    """Return that a result was made from other input than its session has now, in sentences."""
    with suppress(HandtrackError):  # a session that cannot be read: its result can all the same
        session = Session.open(folder)
        own = poses.resolve() == (folder / POSES_FILE).resolve()
        found = foreign_takes(Store(folder / TRACKS_FOLDER), session) if own else []
        return found or foreign_result(track, str(poses), session)
    return []


def session_of(poses: Path) -> Path | None:
    """Return the session folder that a result lies in, None where it lies elsewhere."""
    folder = poses.resolve().parents[len(Path(POSES_FILE).parts) - 1]
    return folder if (folder / SESSION_FILE).is_file() else None
