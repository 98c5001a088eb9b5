"""What `handtrack track` is asked for, checked before anything is tracked or written."""

from __future__ import annotations

import re
import zipfile
from argparse import Namespace
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from handtrack.errors import HandtrackError, listed_names
from handtrack.model.model_file import load_model
from handtrack.session.doctor.check_hand import odd_side
from handtrack.session.first_pose.first_pose import FirstPose, read_first_pose
from handtrack.session.first_pose.first_pose_search import (
    SURE,
    confirmed_by_tracking,
    find_first_poses,
    no_pose_error,
)
from handtrack.session.layout import POSES_FILE, SESSION_FILE
from handtrack.session.run import TrackingRun, poses_of_image_joints
from handtrack.session.session import Session, frames_words
from handtrack.tracking.find_pose import PoseEstimate
from handtrack.tracking.frame.methods import METHODS
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack_app.commands.terminal.output import Stop, confirmed, output_file, print_status

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
