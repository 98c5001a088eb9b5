"""What `handtrack track` is asked for, checked before anything is tracked or written."""

from __future__ import annotations

import argparse
import re
import zipfile
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from handtrack.errors import HandtrackError, listed_names
from handtrack.model.model_file import load_model
from handtrack.session.first_pose.first_pose import FirstPose, read_first_pose
from handtrack.session.layout import POSES_FILE, SESSION_FILE
from handtrack.session.session import Session
from handtrack.tracking.frame.methods import METHODS
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack_app.commands.terminal.output import output_file

_SOURCES = ("silhouettes", "cloud", "keypoints", "edges", "intensity")
_UNUSUAL = ("edges", "intensity")  # off unless they are asked for


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


def check_seen(session: Session, settings: TrackerSettings, use: str | None) -> None:
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
    by_images = images and settings.looks_at_images
    if joints and settings.keypoints.weight > 0:
        return
    usual = settings.silhouettes.weight + settings.cloud.weight > 0
    if not (masks or clouds or by_images) and usual:
        raise HandtrackError(
            f"{session.folder}: nothing to track by: no camera has masks, and there are no [clouds]. Give at least one "
            f'[[camera]] in {SESSION_FILE} `masks`: files such as "masks/cam0/*.png", or a method such as '
            '{ method = "skin_ycrcb" } where there are images; or a table [clouds] where there is depth or stereo; '
            "or track by the images themselves, with --use edges,intensity."
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
            f"--init {init}: it is about frame {pose.frame}, but {session.folder} has the frames 0 to "
            f"{session.frame_count - 1}."
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


def check_recording(args: argparse.Namespace, frames: range) -> None:
    """Raise HandtrackError for options of rerun that do not go together."""
    closely = args.rerun_frame
    if closely is None:
        return
    if not (args.rerun or args.rerun_save):
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
