"""`handtrack track`: headless tracking."""

from __future__ import annotations

import json
import re
import sys
import tempfile
import time
import zipfile
from argparse import Namespace
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from handtrack.capture.images.frames import listed
from handtrack.diagnostics.review import intervals_to_review, queue_words
from handtrack.errors import HandtrackError, listed_names
from handtrack.model.model_file import load_model
from handtrack.session.doctor.check_hand import odd_side
from handtrack.session.doctor.examine import examine_start
from handtrack.session.first_pose import FirstPose, read_first_pose
from handtrack.session.first_pose_search import (
    SURE,
    confirmed_by_tracking,
    find_first_poses,
    no_pose_error,
)
from handtrack.session.layout import POSES_FILE, SESSION_FILE
from handtrack.session.run import TrackingRun, poses_of_image_joints
from handtrack.session.session import Session, frames_words
from handtrack.session.sources.video_audits import count_beside
from handtrack.session.tables import write_result
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
from handtrack.tracking.find_pose import PoseEstimate
from handtrack.tracking.frame.confidence import hand_words
from handtrack.tracking.frame.control import Control, Observer, SearchReport, explained
from handtrack.tracking.frame.methods import METHODS
from handtrack.tracking.frame.result import FrameResult, Status, TrackResult
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack_app.commands.output import (
    INTERRUPTED,
    Stop,
    confirmed,
    note,
    output_file,
    print_status,
    progress_bar,
    saying_compiling,
    share_bar,
    stoppable,
)

if TYPE_CHECKING:
    from handtrack_app.rerun_recorder import ResidualRecorder


# ---- What is asked for, checked before anything is tracked or written; other commands that track ask the same


_SOURCES = ("silhouettes", "cloud", "keypoints", "edges", "intensity")
_UNUSUAL = ("edges", "intensity")  # off unless they are asked for


def asked_for(
    options: Namespace, more: Mapping[str, object]
) -> tuple[Session, dict[str, object], TrackerSettings, FirstPose | None]:
    """Return the session of a command that tracks, with a person's shape; what is set otherwise than in it; the settings in force; and
    the first pose of --init. more: settings that other options set. Raises HandtrackError where nothing can be tracked so.
    """
    session = Session.open(options.session)
    session = session if options.person is None else session.with_person(options.person)
    overrides = {**parse_settings(options.set), **more}
    overrides |= parse_sources(options.use, session.settings.with_values(overrides))
    settings = session.settings.with_values(overrides)
    check_observed(session, settings, options.use)
    return session, overrides, settings, first_pose(options.init, session, settings)


def parse_settings(pairs: Sequence[str]) -> dict[str, str]:
    """Return dotted settings from `section.key=value` texts."""
    values = {}
    for pair in pairs:
        key, equals, value = pair.partition("=")
        if not equals or not key.strip():
            raise HandtrackError(
                f"--set {pair}: expected section.key=value, as in --set solver.iterations=20."
            )
        values[key.strip()] = value.strip()
    return values


def parse_sources(text: str | None, settings: TrackerSettings) -> dict[str, float]:
    """Return the settings that switch off what is not to be used, and on what is off otherwise."""
    if text is None:
        return {}
    names = [name.strip() for name in text.split(",") if name.strip()]
    if not names:
        raise HandtrackError(f"--use '{text}': expected names such as {', '.join(_SOURCES)}.")
    for name in names:
        if name not in _SOURCES:
            raise HandtrackError(
                f"--use {name}: no such observation; {listed_names(name, _SOURCES)}"
            )
    weights = {f"{name}.weight": 0.0 for name in _SOURCES if name not in names}
    flat = settings.flat()
    left_out = METHODS[settings.method].values
    wanted = [
        f"{name}.weight" for name in names if name in _UNUSUAL or f"{name}.weight" in left_out
    ]
    return weights | {key: 1.0 for key in wanted if flat[key] == 0}


def check_observed(session: Session, settings: TrackerSettings, use: str | None) -> None:
    """Raise HandtrackError for a session in which nothing can be tracked, or not what `--use` asks for."""
    masks, clouds = any(view.has_masks for view in session.views), session.has_clouds
    images = any(view.images is not None for view in session.views)
    joints = any(view.keypoint_files is not None for view in session.views)
    for name, there, needs in (
        ("silhouettes", masks, "no camera has masks"),
        ("cloud", clouds, "there is no table [clouds]"),
        ("edges", images, "no camera has images"),
        ("intensity", images, "no camera has images"),
    ):
        if use is not None and settings.flat()[f"{name}.weight"] > 0 and not there:
            raise HandtrackError(
                f"--use {use}: {session.folder / SESSION_FILE} has no {name}: {needs}."
            )
    session.check_frames()
    by_images = images and settings.uses_images
    if joints and settings.keypoints.weight > 0:
        return
    usual = settings.silhouettes.weight + settings.cloud.weight > 0
    if not (masks or clouds or by_images) and usual:
        raise HandtrackError(
            f"{session.folder}: nothing to track by: no camera has masks, and there are no [clouds]. Give at least one "
            f'[[camera]] in {SESSION_FILE} `masks`: files such as "masks/cam0/*.png", or a method such as '
            '{ method = "skin_ycrcb" } where there are images; or a table [clouds] where there is depth or stereo; '
            "or track by the images themselves, with --use edges,intensity."
            + "".join(f" {text}" for text in session.absent)
        )
    weights = (settings.silhouettes.weight * masks, settings.cloud.weight * clouds)
    if not any(weights) and not by_images and settings.keypoints.weight == 0:
        raise HandtrackError(
            "the weights of all that this session observes are 0: nothing is left to track by. Look at --use, --set "
            f"and [tracking] in {session.folder / SESSION_FILE}."
            + (
                ""
                if settings.method == "default"
                else f" The method {settings.method} uses one kind of observation; --use adds others."
            )
        )


def first_pose(init: str | None, session: Session, settings: TrackerSettings) -> FirstPose | None:
    """Return the pose of --init, None when the session's own is to be used, or one is to be found. It belongs to the session."""
    if init == "auto":
        return None  # it is looked for once all else is checked
    if init is None:
        if session.init is None:
            raise HandtrackError(
                f"{session.folder}: no init.json, so tracking has no first pose. Let it be found with --init auto, pose "
                f"the hand in the workbench (`handtrack open {session.folder}`) and save the first-frame pose, or give a "
                "file with --init."
            )
        return None
    model = load_model(settings.model.name or session.hand_model, forearm=True)
    pose = read_first_pose(Path(init), model.parameter_names)
    if pose.frame not in session.known_frames and pose.frame not in session.frame_range:
        raise HandtrackError(
            f"--init {init}: it is about frame {pose.frame}, but {frames_words(session.frame_range)}."
        )
    return pose


def parse_frames(text: str | None, frames: range, folder: Path) -> range:
    """Return the frames of `A:B` (half-open), all of the session's (0 to its end) without a text."""
    count = frames.stop
    if text is None:
        return range(count)
    match = re.fullmatch(r"([0-9]*):([0-9]*)", text)
    if match is None:
        raise HandtrackError(
            f"--frames {text}: expected A:B, the frames from A up to but not B, as in --frames 0:100."
        )
    first, last = int(match[1] or 0), int(match[2] or count)
    if first >= last or last > count:
        raise HandtrackError(
            f"--frames {text}: {folder} has the frames 0 to {count - 1}; expected A < B ≤ {count}."
        )
    return range(first, last)


def check_recording(closely: int | None, goes_somewhere: bool, frames: range) -> None:
    """Raise HandtrackError for options of rerun that do not go together."""
    if closely is None:
        return
    if not goes_somewhere:
        raise HandtrackError(
            f"--rerun-frame {closely}: it needs --rerun or --rerun-save FILE.rrd, where its iterations go."
        )
    if closely not in frames:
        raise HandtrackError(
            f"--rerun-frame {closely}: not among the frames that are tracked, {frames.start} to {frames.stop - 1}."
        )


def writable(asked: Path | None, folder: Path) -> Path:
    """Return where the result goes. Raises HandtrackError unless it can be written there; writes nothing."""
    out = output_file(
        folder / POSES_FILE if asked is None else asked,
        (".npz",),
        "results are",
        makes_folders=True,
    )
    with suppress(
        zipfile.BadZipFile, OSError
    ):  # what cannot be read may be an earlier result, and is kept as a version
        if not any(name.startswith("T_world_bone") for name in zipfile.ZipFile(out).namelist()):
            raise HandtrackError(
                f"--out {out}: there is another .npz file already, which is no tracked sequence; nothing was tracked. Name "
                "another file with --out."
            )
    return out


# ---- First poses that leave something open: found by `--init auto`, or joints in images; says how sure they are


_ANYWAY = "Track from it anyway?"


def search_first_pose(
    session: Session, overrides: Mapping[str, object], frames: range, stop: Stop, yes: bool
) -> FirstPose | None:
    """Return the surest pose in a range of frames; None when the user stopped it. HandtrackError where there is no hand, or the
    surest is not sure, tracking from it does not confirm it, and nobody says that it is to be taken. yes: it is.
    """
    run = TrackingRun.open(session, overrides, use_init=False)
    begun: list[float] = []

    def progress(share: float, _text: str) -> None:
        if not begun:
            print_status("looking for the first pose …")
        begun.append(share)

    result = find_first_poses(run, frames, stop, progress)
    if stop():
        return None
    if not result:
        raise no_pose_error(run)
    for line in described(result):
        print_status(line)
    first = FirstPose.of(result[0])
    ask_for_other_side(session, first, yes)
    if result[0].confidence >= SURE or yes:
        return first
    unfitted = {**overrides, "model.fit_size": False}
    begun_there = TrackingRun.open(session, unfitted, first, stop)
    if confirmed_by_tracking(begun_there, frames, stop):
        print_status("Tracking confirms it: the next frames fit as well.")
    elif not stop() and not confirmed(_ANYWAY):
        is_body = result[0].model.kind == "body"
        more = "add another camera's joints" if is_body else "give joints (`handtrack detect`)"
        raise HandtrackError(
            f"{session.folder}: the best first pose, in frame {result[0].frame}, has a confidence of {percent(result[0].confidence)}, so "
            f"nothing was tracked. Look at it in the workbench (`handtrack open`), {more}, give a "
            "pose (--init FILE), name other frames with --frames, or use it anyway with --yes."
        )
    return None if stop() else first


def ask_for_other_side(session: Session, first: FirstPose | None, yes: bool) -> None:
    """Raise HandtrackError where a first pose's joints are those of the other hand, and nobody says that it is to be taken."""
    for words in [] if yes else odd_side(first, session):
        if not confirmed(f"{words} {_ANYWAY}"):
            raise HandtrackError(
                f"{session.folder}, {words} Nothing was tracked from it. Use it anyway with --yes."
            )


def first_pose_of_images(
    session: Session, settings: TrackerSettings, first: FirstPose, yes: bool
) -> FirstPose:
    """Return the likeliest pose that joints in images mean, and tell the others; see `ask_for_other_side`."""
    result = poses_of_image_joints(session, settings, first)
    for line in described(result):
        print_status(line)
    ask_for_other_side(session, FirstPose.of(result[0]), yes)
    return FirstPose.of(result[0])


def described(candidates: list[PoseEstimate]) -> list[str]:
    """Return lines that say what was found, how sure it is, and what else it may be."""
    best, others = candidates[0], candidates[1:]
    lines = [f"first pose: frame {best.frame}, {percent(best.confidence)} sure ({best.note})."]
    lines += [f"  or: {percent(other.confidence)}, {other.note}" for other in others]
    if best.confidence < SURE:
        lines.append(
            "note: the confidence is low. Check it in the workbench (`handtrack open`), where you can choose another."
        )
    return lines


def percent(share: float) -> str:
    """Return a share in words: never 0 % nor 100 %, which nobody knows."""
    return "below 1 %" if share < 0.01 else f"{100 * min(share, 0.99):.0f} %"


# ---- The command itself


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
    if options.rerun_save is not None:
        recording = options.rerun_save
        output_file(
            recording, (".rrd",), "recordings are", makes_folders=True, option="--rerun-save"
        )
    if options.init != "auto":
        ask_for_other_side(session, first or session.init, options.yes)
    note(*examine_start(session, options.init is None))
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
    if not (run.fits_sizes or event.after_tracking):
        return f"the offsets of the detected joints are fitted; the {run.model.kind}'s size stays as it is given."
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
