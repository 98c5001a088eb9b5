"""`handtrack track`: headless tracking."""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from handtrack.capture.images.frame_notes import listed
from handtrack.diagnostics.review import queue_words, worth_a_look
from handtrack.errors import HandtrackError
from handtrack.model.model_file import load_model
from handtrack.session.doctor.check_tracked import doubt_of_cameras
from handtrack.session.doctor.examine import examine_start
from handtrack.session.first_pose.first_pose import FirstPose
from handtrack.session.formats.tables import write_result
from handtrack.session.run import TrackingRun
from handtrack.session.seen.video_audits import count_beside
from handtrack.session.session import Session
from handtrack.session.side import doubt_of_side
from handtrack.tracking.frame.assessment import hand_words
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.result import FrameResult, Status, TrackResult
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.search.engine import SearchReport
from handtrack.tracking.search.explain import explained
from handtrack.tracking.whole.refinement import Refinement
from handtrack_app.commands.terminal.first_pose import (
    SURE,
    ask_for_other_side,
    first_pose_of_images,
    found_first_pose,
    percent,
)
from handtrack_app.commands.terminal.progress import (
    Stop,
    say,
    saying_compiling,
    share_bar,
    stoppable,
)
from handtrack_app.commands.terminal.track_options import (
    check_recording,
    check_seen,
    first_pose,
    parse_frames,
    parse_settings,
    parse_sources,
    writable,
)
from handtrack_app.commands.terminal.tracked_take import TrackedTake
from handtrack_app.commands.terminal.tracking_passes import TrackingPasses
from handtrack_app.rerun.recorder import ResidualRecorder

_INTERRUPTED = 130


def run(args: argparse.Namespace) -> int:
    """Track; return 0, or 130 when interrupted (what was tracked is saved and named)."""
    began = time.monotonic()
    session = Session.open(args.session)
    session = session if args.person is None else session.with_person(args.person)
    overrides: dict[str, object] = dict(parse_settings(args.set))
    if args.seed is not None:
        overrides["tracker.seed"] = args.seed
    if args.size_later:
        overrides["model.fit_size"] = "later"
    settings = session.settings.with_values(overrides)
    overrides |= parse_sources(args.use, settings)
    settings = settings.with_values(overrides)
    check_seen(session, settings, args.use)
    count_beside(session.folder if args.out is None else None, session.videos)
    first = first_pose(args.init, session, settings)
    # where a first pose is looked for depends on where the recording ends; else tracking begins while that is found out
    known = session.frame_range if args.init == "auto" else session.known_frames
    frames = parse_frames(args.frames, known, session.folder)
    check_recording(args, frames)
    if args.explain is not None and args.explain not in frames:
        raise HandtrackError(
            f"--explain {args.explain}: expected one of the frames that are tracked, {frames.start} to {frames.stop - 1}."
        )
    out = writable(args.out, session.folder)
    if args.init != "auto":
        ask_for_other_side(session, first or session.init, args.yes)
    for text in examine_start(session) if args.init is None else ():
        say(f"note: {text}")
    fits = session.hand_scale == "fit" and settings.model.fit_size == "true"
    with stoppable() as stop, saying_compiling(), TrackedTake(out, session, args) as take:
        if args.init == "auto":
            first = found_first_pose(session, overrides, frames, stop, args.yes)
        elif (given := first or session.init) is not None and given.pixels:
            first = first_pose_of_images(session, settings, given)
        run_ = None if stop() else _opened(session, overrides, first, fits, stop)
        if run_ is None:
            say("handtrack track: interrupted before the first frame; nothing was saved.")
            return _INTERRUPTED
        later = settings.model.fit_size == "later" and run_.size_is_open
        if args.size_later and not later:
            say("note: --size-later has no effect: the size is given, and not fitted.")
        recorder = None
        if args.rerun or args.rerun_save:
            recorder = ResidualRecorder(run_, args.rerun, args.rerun_save, args.rerun_frame)
            if recorder.url:
                say(f"residuals are shown at {recorder.url}")
        try:
            reports: list[SearchReport] = []
            on_search = None if args.explain is None else reports.append
            passes = TrackingPasses(stop, take, recorder, on_search)
            results, problem = passes.track(run_, frames)
            counted = frames if stop() else _counted(args, session, settings)
            if counted != frames:
                say(
                    "note: the videos have not as many frames as they announce; tracking begins anew."
                )
                stop.shielded, frames = False, counted
                reports.clear()
                results, problem = passes.track(run_, frames)
            if later and not problem and not stop():
                reports.clear()
                run_, results = passes.track_again(run_, results, frames)
            elif not problem and not stop():
                run_, results = passes.with_arm_of_all(run_, results, frames)
            doubts = _doubts_of_side(run_, results, args, stop) if take.is_first else []
            refinement = Refinement.read(passes.refinement) if passes.refinement else None
            if refinement is not None and refinement.scale is not None:
                run_ = run_.with_scale(refinement.scale)
            doubts += (refinement and refinement.words) or (
                [doubt_of_cameras(run_, results)] if not stop() else []
            )
            code = _save(
                run_, results, passes.refinement, frames, out, stop(), problem, take, doubts,
                began if args.json else None,
            )  # fmt: skip
            if args.explain is not None:
                there = next((r for r in results if r.frame == args.explain), None)
                text = "\n".join(explained(args.explain, reports, there))
                print(text, file=sys.stderr if args.json else sys.stdout, flush=True)
        finally:
            if recorder is not None:
                recorder.close(keep_viewer=args.rerun)
                _summarise(recorder, args)
    if recorder is not None and args.rerun:
        _end_viewer(recorder, wait=code == 0)
    return code


def _opened(
    session: Session,
    overrides: Mapping[str, object],
    first: FirstPose | None,
    fits: bool,
    stop: Stop,
) -> TrackingRun | None:
    """Return the run with its hand, None when the user stopped it."""
    if fits:
        chosen = session.settings.with_values(overrides).model.name
        say(f"fitting the {load_model(chosen or session.hand_model).kind}'s size …")
    try:
        with share_bar("sizing") as tell:
            run_ = TrackingRun.open(session, overrides, first, stop, tell=tell)
    except KeyboardInterrupt:
        return None
    return None if stop() else run_


def _doubts_of_side(
    run_: TrackingRun, results: Sequence[FrameResult], args: argparse.Namespace, stop: Stop
) -> list[str]:
    """Return that the other hand was tracked, in words, where nothing but session.toml says which it is. That takes as long
    as a hundred frames: asked once for a first pose, and by `doctor`.
    """
    joints_given = args.init != "auto" and run_.first is not None and run_.first.xyz is not None
    if joints_given or stop():
        return []
    tracked = {r.frame: r.parameters for r in results if r.status != Status.LOST}
    text = doubt_of_side(run_.session, run_.settings, run_.model, tracked, Control(stop))
    return [text] if text else []


def _counted(args: argparse.Namespace, session: Session, settings: TrackerSettings) -> range:
    """Return the frames asked for once those of videos are counted. Raises HandtrackError where there are none such."""
    counted = session.frame_range
    if args.init is None:
        session.check_init()
    first_pose(args.init, session, settings)
    return parse_frames(args.frames, counted, session.folder)


def _save(
    run_: TrackingRun,
    results: Sequence[FrameResult],
    refinement: str | None,
    frames: range,
    out: Path,
    stopped: bool,
    ended_by: str,
    take: TrackedTake,
    doubts: Sequence[str],
    json_since: float | None,
) -> int:
    """Write the result and tell how it went, as JSON where `json_since` says when it began [s]."""
    take.check()
    if not results:
        say("handtrack track: interrupted before the first frame was done; nothing was saved.")
        return _INTERRUPTED
    track, finished = (
        replace(run_.result(results), refinement=refinement),
        not (stopped or ended_by),
    )
    try:
        whole = track if finished else take.with_earlier(track)
    except HandtrackError:
        say(
            f"handtrack track: {ended_by or 'interrupted;'} the track before, of another model, stays. The {len(results)} frames tracked so "
            f"far are take {take.number}: `handtrack takes {run_.session.folder} --restore {take.number}` makes them the track."
        )
        return 2 if ended_by else _INTERRUPTED
    place, problem = _write(out, whole)
    if not problem:
        take.saved(track, finished)
    earlier = len(whole) - len(track)
    over = f", over {earlier} of an earlier take" if earlier > 0 else ""
    counts = {status.name.lower(): sum(r.status == status for r in results) for status in Status}
    notes = [
        *dict.fromkeys([*run_.session.warnings, *run_.notes]),
        *filter(None, doubts),
        *_doubts(results),
    ]
    hand = hand_words(run_.model)
    if json_since is None:
        by_status = ", ".join(f"{counts[name]} {name}" for name in ("tracked", "doubtful", "lost"))
        begun = _begun_at(run_)
        print(
            f"{len(results)} of {len(frames)} frames{begun}: {by_status}{hand and f'; {hand}'}. Saved to {place}",
            flush=True,
        )
    else:
        seconds = round(time.monotonic() - json_since, 3)
        told = {"frames": counts, "seconds": seconds, "warnings": notes, "output": str(place)}
        print(json.dumps(told, indent=1), flush=True)
    for note in notes:
        say(f"note: {note}")
    if problem:
        raise HandtrackError(problem)
    if ended_by:
        raise HandtrackError(
            f"{ended_by} Tracking ended there; the {len(results)} frames tracked before it are in {place}{over}."
        )
    if stopped:
        say(
            f"handtrack track: interrupted; the {len(results)} frames tracked so far are in {place}{over}."
        )
        return _INTERRUPTED
    return 0


def _begun_at(run_: TrackingRun) -> str:
    """Return how sure the first pose was, in words, where it was not."""
    sure = None if run_.first is None else run_.first.confidence
    return (
        "" if sure is None or sure >= SURE else f", from a first pose that was {percent(sure)} sure"
    )


def _write(out: Path, track: TrackResult) -> tuple[Path, str]:
    """Save the result; return where, and what was wrong with the place asked for."""
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        write_result(out, track)
    except (
        OSError
    ) as error:  # full, or gone, since it was checked: hours of work may be in our hands
        other = Path(tempfile.mkdtemp(prefix="handtrack_")) / out.name
        write_result(other, track)
        return other, f"--out {out}: writing failed ({error.strerror}); the result is in {other}."
    return out, ""


def _doubts(results: Sequence[FrameResult]) -> list[str]:
    """Return a sentence on the lost frames and one on the doubtful, with the first one's reason."""
    notes = []
    for status, word in ((Status.LOST, "lost"), (Status.DOUBTFUL, "doubtful")):
        found = sorted((r for r in results if r.status == status), key=lambda r: r.frame)
        if found:
            frames = listed([r.frame for r in found])
            notes.append(
                f"{word}: frames {frames}; the first: {found[0].note or 'no reason told'}."
            )
    queue = queue_words(worth_a_look(sorted(results, key=lambda r: r.frame)))
    return [*notes, queue] if queue else notes


def _summarise(recorder: ResidualRecorder, args: argparse.Namespace) -> None:
    """Say how recording went."""
    if recorder.problem:
        say(f"note: {recorder.problem}")
    elif args.rerun_save:
        say(f"residuals are in {args.rerun_save}; look at them with: rerun {args.rerun_save}")
    if recorder.without_pictures:
        say(
            f"note: {recorder.without_pictures} frames were recorded without pictures; tracking was faster."
        )


def _end_viewer(recorder: ResidualRecorder, wait: bool) -> None:
    """End rerun's viewer; wait: only when whoever sits at the terminal has seen enough."""
    if wait and sys.stdin.isatty() and sys.stderr.isatty() and not recorder.problem:
        say(f"the residuals stay at {recorder.url} until Ctrl-C.")
        with suppress(KeyboardInterrupt):
            while True:
                time.sleep(3600)
    recorder.close()
