"""`handtrack track`: headless tracking."""

from __future__ import annotations

import json
import sys
import tempfile
import time
from argparse import Namespace
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from handtrack.capture.images.frames import listed
from handtrack.diagnostics.review import intervals_to_review, queue_words
from handtrack.errors import HandtrackError
from handtrack.session.doctor.examine import examine_start
from handtrack.session.formats.tables import write_result
from handtrack.session.run import TrackingRun
from handtrack.session.sources.video_audits import count_beside
from handtrack.session.takes import TakeRecorder
from handtrack.session.track_session import (
    Ended,
    Event,
    FramesRefined,
    PassBegan,
    SizeFitted,
    request_for,
    track_session,
)
from handtrack.tracking.frame.confidence import hand_words
from handtrack.tracking.frame.control import Control, Observer, SearchReport, explained
from handtrack.tracking.frame.result import FrameResult, Status, TrackResult
from handtrack_app.commands.terminal.output import (
    INTERRUPTED,
    Stop,
    note,
    print_status,
    progress_bar,
    saying_compiling,
    share_bar,
    stoppable,
)
from handtrack_app.commands.terminal.track_options import (
    SURE,
    ask_for_other_side,
    asked_for,
    check_recording,
    first_pose_of_images,
    parse_frames,
    percent,
    search_first_pose,
    writable,
)

if TYPE_CHECKING:
    from handtrack_app.rerun_recorder import ResidualRecorder

_PROGRAM = "handtrack track"


def run(options: Namespace) -> int:
    """Track; return 0, or 130 when interrupted (what was tracked is saved and named)."""
    began = time.monotonic()
    more: dict[str, object] = {} if options.seed is None else {"tracker.seed": options.seed}
    if options.size_later:
        more["model.fit_size"] = "later"
    session, overrides, settings, first = asked_for(options, more)
    count_beside(session.folder if options.out is None else None, session.videos)
    # where a first pose is looked for depends on where the recording ends; else tracking begins while that is found out
    known = session.frame_range if options.init == "auto" else session.known_frames
    frames = parse_frames(options.frames, known, session.folder)
    check_recording(options.rerun_frame, options.rerun or options.rerun_save is not None, frames)
    if options.explain is not None and options.explain not in frames:
        raise HandtrackError(
            f"--explain {options.explain}: expected one of the frames that are tracked, {frames.start} to {frames.stop - 1}."
        )
    out = writable(options.out, session.folder)
    if options.init != "auto":
        ask_for_other_side(session, first or session.init, options.yes)
    note(*(examine_start(session) if options.init is None else session.absent))
    take_recorder = TakeRecorder(
        out,
        session.folder,
        _PROGRAM,
        restart=options.restart,
        take_over=options.take_over,
        resume_before=options.explain,
        on_note=note,
    )
    with (
        stoppable() as stop,
        saying_compiling(),
        take_recorder as take,
    ):
        if options.init == "auto":
            first = search_first_pose(session, overrides, frames, stop, options.yes)
        elif (given := first or session.init) is not None and given.pixels:
            first = first_pose_of_images(session, settings, given, options.yes)
        if stop():
            print_status("handtrack track: interrupted before the first frame; nothing was saved.")
            return INTERRUPTED
        unsized = TrackingRun.open(session, {**overrides, "model.fit_size": "false"}, first, stop)
        run_ = unsized.with_values({"model.fit_size": settings.model.fit_size})
        if options.size_later and not (settings.model.fit_size == "later" and run_.size_is_open):
            print_status("note: --size-later has no effect: the size is fixed, not fitted.")
        recorder = None
        if options.rerun or options.rerun_save:
            from handtrack_app.rerun_recorder import ResidualRecorder

            recorder = ResidualRecorder(
                run_, options.rerun, options.rerun_save, options.rerun_frame, lambda url: print_status(f"residuals are shown at {url}")
            )  # fmt: skip
        progress = Progressing(take, recorder, options.explain)
        control = Control(stop, progress)
        control = control if recorder is None else recorder.watching(control)
        try:
            run_, request = request_for(run_, frames, from_init=options.init is None)
            with progress:
                end, warnings = progress.follow(track_session(run_, request, control, take), stop)
            stop.shielded = True  # from here on it is saved
            code = _save(end, out, take, warnings, began if options.json else None)
            if options.explain is not None:
                there = next((r for r in end.results if r.frame == options.explain), None)
                text = "\n".join(explained(options.explain, progress.reports, there))
                print(text, file=sys.stderr if options.json else sys.stdout, flush=True)
        finally:
            if recorder is not None:
                recorder.close(keep_viewer=options.rerun)
                _summarise(recorder, options.rerun_save)
    if recorder is not None and options.rerun:
        _end_viewer(recorder, wait=code == 0)
    return code


def _save(
    end: Ended, out: Path, take: TakeRecorder, warnings: Sequence[str], json_since: float | None
) -> int:
    """Write the result and report how it went, as JSON where `json_since` says when it began [s]."""
    take.check()
    run, results, frames = end.run, end.results, end.frames
    if not results:
        print_status("handtrack track: interrupted before the first frame; nothing was saved.")
        return INTERRUPTED
    track = end.track
    try:
        whole = track if end.is_complete else take.with_earlier(track)
    except HandtrackError:
        print_status(
            f"handtrack track: {end.problem or 'interrupted;'} the track before, of another model, stays. The {len(results)} "
            f"frames tracked so far are take {take.number}: `handtrack takes {run.session.folder} --restore {take.number}` "
            "makes them the track."
        )
        return 2 if end.problem else INTERRUPTED
    place, problem = _write(out, whole)
    if not problem:
        take.saved(track, end.is_complete)
    earlier = len(whole) - len(track)
    over = f", over {earlier} of an earlier take" if earlier > 0 else ""
    counts = {status.name.lower(): sum(r.status == status for r in results) for status in Status}
    notes = [
        *dict.fromkeys([*run.session.corrected_words, *run.session.warnings, *run.notes]),
        *warnings,
        *_confidence_notes(results),
    ]
    hand = hand_words(run.model)
    if json_since is None:
        by_status = f"{counts['tracked']} tracked, {counts['doubtful']} of low confidence, {counts['lost']} lost"
        fixed = f", {counts['keyframe']} set by hand" if counts["keyframe"] else ""
        sure = None if run.first is None else run.first.confidence
        begun = ""
        if sure is not None and sure < SURE:
            begun = f", from a first pose that was {percent(sure)} sure"
        print(
            f"{len(results)} of {len(frames)} frames{begun}: {by_status}{fixed}{hand and f'; {hand}'}. "
            f"Saved to {place}",
            flush=True,
        )
    else:
        seconds = round(time.monotonic() - json_since, 3)
        report = {"frames": counts, "seconds": seconds, "warnings": notes, "output": str(place)}
        print(json.dumps(report, indent=1), flush=True)
    note(*notes)
    if problem:
        raise HandtrackError(problem)
    if end.problem:
        raise HandtrackError(
            f"{end.problem} Tracking ended there; the {len(results)} frames tracked before it are in {place}{over}."
        )
    if end.cancelled:
        print_status(
            f"handtrack track: interrupted; the {len(results)} frames tracked so far are in {place}{over}."
        )
        return INTERRUPTED
    return 0


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


def _confidence_notes(results: Sequence[FrameResult]) -> list[str]:
    """Return a sentence on the lost frames and one on those of low confidence, with the first one's reason."""
    notes = []
    for status, word in ((Status.LOST, "lost"), (Status.DOUBTFUL, "low confidence")):
        detections = sorted((r for r in results if r.status == status), key=lambda r: r.frame)
        if detections:
            frames = listed([r.frame for r in detections])
            notes.append(
                f"{word}: frames {frames}; the first: {detections[0].note or 'no reason given'}."
            )
    queue = queue_words(intervals_to_review(sorted(results, key=lambda r: r.frame)))
    return [*notes, queue] if queue else notes


def _summarise(recorder: ResidualRecorder, saved: Path | None) -> None:
    """Say how recording went."""
    if recorder.problem:
        print_status(f"note: {recorder.problem}")
    elif saved:
        print_status(f"residuals are in {saved}; look at them with: rerun {saved}")
    if recorder.without_pictures:
        print_status(
            f"note: {recorder.without_pictures} frames were recorded without pictures; tracking was faster."
        )


def _end_viewer(recorder: ResidualRecorder, wait: bool) -> None:
    """End rerun's viewer; wait: only when whoever sits at the terminal has seen enough."""
    if wait and sys.stdin.isatty() and sys.stderr.isatty() and not recorder.problem:
        print_status(f"the residuals stay at {recorder.url} until Ctrl-C.")
        with suppress(KeyboardInterrupt):
            while True:
                time.sleep(3600)
    recorder.close()


# ---- A tracking at the terminal: bars of what goes on, and a recording for rerun


_STAGES = {"size": "sizing", "refine": "refining"}


class Progressing(Observer):
    """A context in which the events of one tracking are shown."""

    def __init__(
        self, take: TakeRecorder, recorder: ResidualRecorder | None, explain: int | None
    ) -> None:
        """explain: the frame whose searches are kept, those of the last pass."""
        self._take, self._recorder, self._explain = take, recorder, explain
        self.reports: list[SearchReport] = []
        self._bars = ExitStack()
        self._stage = ""
        self._run: TrackingRun | None = None

    def __enter__(self) -> Progressing:
        return self

    def __exit__(self, *_: object) -> None:
        self._bars.close()

    def search(self, report: SearchReport) -> None:
        if report.frame == self._explain:
            self.reports.append(report)

    def progress(self, share: float, words: str = "", stage: str = "refine") -> None:
        if stage != self._stage:
            self._bars.close()
            self._stage = stage
            if words:
                print_status(words)
            self._shown = self._bars.enter_context(share_bar(_STAGES[stage]))
        if share > 0:
            self._shown.progress(share, words)

    def follow(self, events: Iterator[Event], stop: Stop) -> tuple[Ended, list[str]]:
        """Follow a tracking to its end; return how it ended, and its warnings."""
        warnings = list[str]()
        for event in events:
            if isinstance(event, str):
                warnings.append(event)
            elif isinstance(event, Ended):
                return event, warnings
            try:
                self._show(event)
            except KeyboardInterrupt:  # a second Ctrl-C
                stop.asked = True
        raise AssertionError("the last event is Ended")

    def _show(self, event: Event) -> None:
        recorder = self._recorder
        match event:
            case PassBegan():
                self._run = event.run
                self.reports.clear()
                self._stage = ""
                self._bars.close()
                if event.resumed:
                    words = f"resuming at frame {len(event.resumed)} of {len(event.frames)}"
                    print_status(f"{words} (take {self._take.number}; --restart begins anew)")
                if recorder is not None:
                    recorder.go_on_with(event.run)
                self._bar = self._bars.enter_context(progress_bar(len(event.frames), "tracking"))
                self._bar.update(len(event.resumed))
            case FrameResult():
                if recorder is not None:
                    recorder.show(event)
                self._bar.update(1)
            case FramesRefined() if recorder is not None:
                recorder.go_on_with(event.run)
                for result in event.results:
                    recorder.show(result)
            case SizeFitted():
                self._bars.close()
                print_status(_size_words(event, self._run))
            case _:
                pass


def _size_words(event: SizeFitted, before: TrackingRun | None) -> str:
    """Return what was found of the hand, and what follows."""
    run = event.run
    if before is None or not event.after_tracking:
        return f"the {run.model.kind} is {run.scale.overall:.3f} times a mean adult's."
    if run is before:
        return f"note: no frame measures the {run.model.kind}'s size well enough; it is unchanged."
    if run.arm_m != before.arm_m:
        end = "" if np.isinf(run.arm_m) else f" that ends {100 * run.arm_m:.0f} cm from the wrist"
        shown = f"a forearm{end}" if run.forearm else "no forearm"
        return f"masks of all frames show {shown}, not what those of the first did; tracking again from the first pose …"
    old, new = before.scale.overall, run.scale.overall
    return f"the {run.model.kind} is {new:.3f} of a mean adult's, not {old:.3f}; tracking again from the first pose …"
