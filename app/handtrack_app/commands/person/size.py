"""`handtrack size`: the size of a person's hand or body from a recording, saved for every other one."""

from __future__ import annotations

import argparse
from pathlib import Path

from handtrack.errors import HandtrackError
from handtrack.model.articulated import HandScale
from handtrack.model.model_file import scale_table, write_scale
from handtrack.session.layout import SESSION_FILE
from handtrack.session.run import TrackingRun
from handtrack.session.session import Session
from handtrack.tracking.frame.assessment import hand_words
from handtrack_app.commands.terminal.answer import answer
from handtrack_app.commands.terminal.first_pose import ask_for_other_side, found_first_pose
from handtrack_app.commands.terminal.output import output_file
from handtrack_app.commands.terminal.progress import (
    say,
    saying_compiling,
    share_bar,
    stoppable,
)
from handtrack_app.commands.terminal.track_options import (
    check_seen,
    first_pose,
    parse_frames,
    parse_settings,
    parse_sources,
)

_FILES = {"hand": "hand.json", "body": "body.json"}
_INTERRUPTED = 130


def run(args: argparse.Namespace) -> int:
    """Track the frames asked for, fit one size to some of them, and save it; return the exit code."""
    session = Session.open(args.session)
    overrides: dict[str, object] = dict(parse_settings(args.set))
    settings = session.settings.with_values(overrides)
    overrides |= parse_sources(args.use, settings) | {"model.fit_size": False}
    settings = settings.with_values(overrides)
    check_seen(session, settings, args.use)
    first = first_pose(args.init, session, settings)
    if args.init != "auto":
        ask_for_other_side(session, first or session.init, args.yes)
    frames = parse_frames(args.frames, session.frame_range, session.folder)
    if args.count < 1:
        raise HandtrackError(
            f"--count {args.count}: expected at least one frame to fit the size to."
        )
    kind = TrackingRun.open(session, overrides, use_init=False).model.kind
    out = _new_file(args.out or session.folder / _FILES[kind], kind)
    with stoppable() as stop, saying_compiling():
        if args.init == "auto":
            first = found_first_pose(session, overrides, frames, stop, args.yes)
        say(
            f"tracking {len(frames)} frames, and fitting the {kind}'s size to {args.count} of them …"
        )
        before = after = None
        if not stop():
            before = TrackingRun.open(session, overrides, first, stop)
            with share_bar("sizing") as tell:
                after = before.fit_size(stop, frames, args.count, tell, sizes=True)
        if stop() or after is None:
            say("handtrack size: interrupted; nothing was saved.")
            return _INTERRUPTED
    if after is before:
        raise HandtrackError(
            f"{session.folder}: in none of the frames {frames.start} to {frames.stop - 1} the {kind} was tracked and seen "
            "well enough to tell its size: by cameras whose lines of sight differ by 20 degrees at least, or by a "
            "cloud. Nothing was saved. Name other frames with --frames."
        )
    for note in dict.fromkeys(after.notes):
        say(f"note: {note}")
    write_scale(out, after.scale)
    hand = hand_words(after.model)
    use = f'To use it: copy it into a session and set scale = "{out.name}" in [hand] of its {SESSION_FILE}.'
    if out.resolve().parent == session.folder.resolve():
        use = f'To use it: in {SESSION_FILE}, [hand], scale = "{out.name}".'
    saved = f"{_words(after.scale, kind)}{hand and f' {hand.capitalize()}.'} Saved to {out}"
    answer(args, {"scale": scale_table(after.scale), "hand": hand, "output": out}, saved, use)
    return 0


def _words(scale: HandScale, kind: str) -> str:
    if kind == "body":
        known = {"overall": scale.overall, **scale.parts}
        said = (f"{name} {size:.3f}{_doubt(scale, name)}" for name, size in known.items())
        return f"Of a mean adult's: {', '.join(said)}."
    parts = ", ".join(f"{name} {scale.factor(name):.3f}" for name in scale.parts)
    return (
        f"palm {scale.overall:.3f} of a mean adult's, {parts}."
        if parts
        else f"{scale.overall:.3f}."
    )


def _doubt(scale: HandScale, name: str) -> str:
    std = scale.std.get(name)
    return "" if std is None else f" ± {std:.3f}"


def _new_file(out: Path, kind: str) -> Path:
    output_file(out, (".json",), "hands of persons are")
    if out.exists():
        raise HandtrackError(
            f"{out} exists, and a person's {kind} is not written over. Name another file with --out, or move it away."
        )
    return out
