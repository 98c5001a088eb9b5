"""`handtrack track`: headless tracking."""

from __future__ import annotations

import argparse
import os
import re
import sys
import tempfile
from contextlib import ExitStack
from pathlib import Path

from handtrack.errors import HandtrackError
from handtrack.session import layout
from handtrack.session.first_pose import read_first_pose
from handtrack.session.run import TrackingRun
from handtrack.session.session import Session
from handtrack.session.tables import write_result
from handtrack_app.commands.progress import progress_bar, stoppable

_SOURCES = ("silhouettes", "cloud", "keypoints", "edges", "intensity")
_AVAILABLE = ("silhouettes", "keypoints")


def run(args: argparse.Namespace) -> int:
    """Track; return 0, or 130 when interrupted (what was tracked is saved and named)."""
    session = Session.open(args.session)
    first = None
    if args.init is not None:
        if args.init == "auto":
            raise HandtrackError(
                "--init auto: automatic first frames are not available in this version. Pose the first frame in the workbench, "
                "or give a file with 21 keypoints (contracts §4)."
            )
        first = read_first_pose(Path(args.init))
    settings = parse_settings(args.set) | _sources(args.use)
    run_ = TrackingRun.open(session, settings, first)
    start_frame, start = run_.initial()
    frames = parse_frames(args.frames, session.frame_count)
    out = args.out or session.folder / layout.POSES_FILE
    check_writable(out)
    results, stopped = [], False
    with ExitStack() as stack:
        should_stop = stack.enter_context(stoppable())
        bar = stack.enter_context(progress_bar(len(frames), "tracking"))
        stream = _rerun(args, run_, stack)
        for result in run_.track(frames, start_frame, start, should_stop):
            results.append(result)
            if stream is not None:
                stream.show(result)
            bar.update()
        stopped = should_stop()
    if not results:
        print("handtrack track: interrupted before the first frame was done; nothing was saved.", file=sys.stderr)
        return 130
    write_result(out, run_.result(results))
    counts = [sum(r.status == status for r in results) for status in (0, 1, 2)]
    print(
        f"{len(results)} of {len(frames)} frames: {counts[0]} tracked, {counts[1]} doubtful, {counts[2]} lost. "
        f"Saved to {out}"
    )
    for warning in session.warnings:
        print(f"note: {warning}", file=sys.stderr)
    if stopped:
        print(f"handtrack track: interrupted; the frames tracked so far are in {out}.", file=sys.stderr)
        return 130
    return 0


def parse_settings(pairs: list[str]) -> dict[str, str]:
    """Return dotted settings from `section.key=value` strings."""
    values = {}
    for pair in pairs:
        key, equals, value = pair.partition("=")
        if not equals or not key.strip():
            raise HandtrackError(f"--set {pair}: expected section.key=value, as in --set solver.iterations=20.")
        values[key.strip()] = value.strip()
    return values


def parse_frames(text: str | None, count: int) -> range:
    """Return the frames of `A:B` (half-open), within a session of `count` frames."""
    if text is None:
        return range(count)
    match = re.fullmatch(r"(\d*):(\d*)", text)
    if match is None:
        raise HandtrackError(f"--frames {text}: expected A:B, the frames from A up to but not B, as in 0:100.")
    first, last = int(match[1] or 0), int(match[2] or count)
    if first >= last or last > count:
        raise HandtrackError(
            f"--frames {text}: this session has frames 0 to {count - 1}; expected A < B ≤ {count}."
        )
    return range(first, last)


def check_writable(path: Path) -> None:
    """Raise HandtrackError unless a file can be written at `path`; makes its folder."""
    if path.suffix != ".npz":
        raise HandtrackError(f"--out {path}: results are .npz files.")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent)
        os.close(handle)
        os.unlink(name)
    except OSError as error:
        raise HandtrackError(
            f"results cannot be written to {path.parent}: {error.strerror}. Nothing was tracked; name another place with --out."
        ) from None


def _sources(text: str | None) -> dict[str, float]:
    """Return the settings that switch off what is not to be used."""
    if text is None:
        return {}
    names = [name.strip() for name in text.split(",") if name.strip()]
    for name in names:
        if name not in _SOURCES:
            raise HandtrackError(f"--use {name}: known are {', '.join(_SOURCES)}.")
        if name not in _AVAILABLE:
            raise HandtrackError(f"--use {name}: not available in this version; available: {', '.join(_AVAILABLE)}.")
    return {f"{name}.weight": 0.0 for name in _AVAILABLE if name not in names}


def _rerun(args: argparse.Namespace, run_: TrackingRun, stack: ExitStack):
    if not (args.rerun or args.rerun_save):
        return None
    from handtrack_app.residual_recorder import ResidualRecorder

    recorder = ResidualRecorder(run_, live=args.rerun, path=args.rerun_save, closely=args.rerun_frame)
    stack.callback(recorder.close)
    return recorder
