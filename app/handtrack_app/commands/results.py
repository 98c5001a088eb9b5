"""Commands on what was tracked: export, takes."""

from __future__ import annotations

import json
from argparse import Namespace
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from handtrack.diagnostics.metrics import evaluate
from handtrack.diagnostics.score import compared, mean_overlap
from handtrack.errors import HandtrackError
from handtrack.export.registry import FORMATS, export_format
from handtrack.export.table import ArchiveMetadata, ResultsTable
from handtrack.files.atomic import keep_version
from handtrack.session.layout import POSES_FILE, SESSION_FILE, TRACKS_FOLDER
from handtrack.session.session import Session
from handtrack.session.takes import foreign_result, foreign_takes, import_track, make_current
from handtrack.store.history import Span
from handtrack.store.lease import holder_of
from handtrack.store.store import Store, WritableStore
from handtrack.store.take import Take
from handtrack.tracking.frame.result import TrackResult, model_of
from handtrack_app.commands.output import Answer, note, output_file, print_status
from handtrack_app.commands.track import parse_frames

_NEGLIGIBLE_M = 1e-4  # a tenth of a millimetre: the bound that every format is held to


def export_poses(options: Namespace) -> Answer:
    """Write the converted file, and those that belong to it, and name them."""
    if options.to is None:
        formats = {known.name: known.purpose for known in FORMATS}
        return Answer(formats, [f"{name:10} {purpose}" for name, purpose in formats.items()])
    chosen = export_format(options.to)
    around = options.poses.resolve().parents[len(Path(POSES_FILE).parts) - 1]
    folder = options.session or (around if (around / SESSION_FILE).is_file() else None)
    table = ResultsTable.read(options.poses, folder)
    table = replace(table, mano=options.mano)
    if options.metadata is not None:
        table = replace(table, metadata=ArchiveMetadata.read(options.metadata))
    out: Path = options.out or options.poses.with_name(f"{options.poses.stem}{chosen.ending}")
    output_file(out, (chosen.suffix,), f"{options.to} exports are")
    if out.resolve() == options.poses.resolve():
        raise HandtrackError(
            f"--out {out}: that is the file that is read; nothing was written. Name another one."
        )
    try:
        previous = keep_version(out)
        written = chosen.write(out, table, options.up or "", options.landmarks or "")
    except OSError as error:
        raise HandtrackError(
            f"--out {out}: cannot be written ({error.strerror}). Name another place with --out."
        ) from None
    kept = f"; the file before is kept as {previous}" if previous else ""
    beside = f", with {', '.join(path.name for path in written[1:])}" if written[1:] else ""
    report = {"frames": len(table.track), "output": out, "files": written, "previous": previous}
    if folder is not None:
        note(*_foreign(table.track, options.poses, folder))
    if chosen.one_skeleton and table.misfit_m > _NEGLIGIBLE_M:
        print_status(
            f"note: {options.poses} has frames with different hand sizes; {options.to} has one skeleton for all, with errors of up to "
            f"{1e3 * table.misfit_m:.1f} mm in some frames."
        )
    return Answer(report, [f"{len(table.track)} frames written to {out}{beside}{kept}"])


def _foreign(track: TrackResult, poses: Path, folder: Path) -> list[str]:
    """Return that a result was made from other input than its session has now, in sentences."""
    with suppress(HandtrackError):  # a session that cannot be read: its result can all the same
        session = Session.open(folder)
        own = poses.resolve() == (folder / POSES_FILE).resolve()
        warnings = foreign_takes(Store(folder / TRACKS_FOLDER), session) if own else []
        return warnings or foreign_result(track, str(poses), session)
    return []


# ---- `handtrack takes`


_PROGRAM = "handtrack takes"


def manage_takes(
    session: Path,
    restore: int | None,
    compare: list[int] | None,
    prune: int | None,
    frames: str | None,
    take_over: bool,
) -> int | Answer:
    """List the takes, or do with them what the options say."""
    opened = Session.open(session)
    folder = opened.folder / TRACKS_FOLDER
    chosen = None if frames is None else parse_frames(frames, opened.frame_range, opened.folder)
    if chosen is not None and restore is None and compare is None:
        raise HandtrackError("--frames goes with --restore or --compare.")
    if restore is not None:
        _restore(opened.folder, restore, chosen, take_over)
    elif prune is not None:
        with WritableStore(folder, _PROGRAM, take_over) as store:
            freed = store.prune(prune)
        print(f"take {prune} is removed; {freed / 1e6:.1f} MB are free.")
    elif compare is not None:
        return _compared(Store(folder), opened, compare, chosen)
    else:
        return _list(Store(folder), opened)
    return 0


def _restore(folder: Path, take: int, frames: range | None, take_over: bool) -> None:
    with WritableStore(folder / TRACKS_FOLDER, _PROGRAM, take_over) as store:
        if text := import_track(store, folder):
            note(text)
        spans = store.restored(take, frames)
        make_current(store, spans, f"Take {take} restored", folder / POSES_FILE)
        named = ", ".join(f"{s.first} to {s.stop - 1} of take {s.take}" for s in store.current())
        print(f"current: frames {named}. Saved to {folder / POSES_FILE}")
        note(*store.damage())


def _compared(store: Store, session: Session, numbers: list[int], frames: range | None) -> Answer:
    takes = [store.take(number) for number in numbers]
    differences = compared(*(take.track(frames) for take in takes))
    if session.truth is not None:
        for take in takes:
            error = evaluate(take.track(frames), session.truth)["mpjpe_tracked_mm"]
            differences[f"take_{take.number}_error_mm"] = error
    for take in takes:
        overlap = _overlap(session, take, frames)
        if overlap is not None:
            differences[f"take_{take.number}_overlap"] = overlap
    shown = {name: "-" if value is None else f"{value:.4g}" for name, value in differences.items()}
    return Answer(differences, [f"{name:28s} {value}" for name, value in shown.items()])


def _overlap(session: Session, take: Take, frames: range | None) -> float | None:
    """Return how well a take covers the session's masks; None where it cannot be told."""
    try:
        model = model_of(take.track(frames), f"take {take.number}")
        return mean_overlap(
            model,
            lambda frame: session.observation(frame, cloud=False).silhouettes,
            take.results(frames),
        )
    except HandtrackError as error:
        print_status(
            f"note: the overlap of take {take.number} with the masks cannot be computed: {error}"
        )
        return None


def _list(store: Store, session: Session) -> Answer:
    spans, damage, holder = store.current(), store.damage(), holder_of(store.folder)
    foreign = foreign_takes(store, session)
    listed = [_listed(take, spans) for take in store.takes()]
    report = {
        "takes": [table for table, _ in listed],
        "damage": damage,
        "foreign": foreign,
        "writer": holder and str(holder),
    }
    none = f"{store.folder}: no takes yet; `handtrack track` makes one."
    if holder is not None:
        print_status(f"note: {holder} is writing here.")
    note(*foreign, *damage)
    return Answer(report, [words for _, words in listed] or [none])


def _listed(take: Take, spans: Sequence[Span]) -> tuple[dict[str, object], str]:
    """Return what is told of a take, as JSON has it (spans of frames are half-open), and in words."""
    current = [(span.first, span.stop) for span in spans if span.take == take.number]
    report: dict[str, object] = {
        "take": take.number, "bytes": take.bytes, "current": current, "begun": "", "by": "", "frames": (0, 0), "statuses": {},
        "finished": False, "settings": {}, "versions": {}, "damage": "",
    }  # fmt: skip
    size = f"{take.bytes / 1e6:.1f} MB"
    try:
        about = take.about
    except HandtrackError as error:
        return report | {"damage": str(error)}, f"take {take.number}: {size}, damaged"
    counts = Counter(take.statuses.values())
    report |= {
        "begun": about.begun, "by": about.by, "frames": about.frames, "statuses": {s.name.lower(): n for s, n in counts.items()}, "finished": take.is_finished,
        "settings": json.loads(about.labels.settings or "{}"), "versions": dict(about.versions),
    }  # fmt: skip
    first, stop = about.frames
    by_status = [f"{count} {status.words}" for status, count in counts.items()]
    words = [f"frames {first}:{stop}", *(by_status or ["none tracked"]), size]
    words += [] if take.is_finished else ["not finished"]
    if current:
        words.append("current for " + ", ".join(f"{a}:{b}" for a, b in current))
    return report, f"take {take.number}: {about.begun} by {about.by}, {', '.join(words)}"
