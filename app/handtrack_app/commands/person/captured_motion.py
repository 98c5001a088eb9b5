"""The motion file that a command is given, on a model: what was told of names, unit and size, and what was assumed, said."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np

from handtrack.arrays import F, Floats, P
from handtrack.errors import HandtrackError
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.model_file import load_model, read_scale
from handtrack.simulation.captured import Captured, captured, model_builder
from handtrack.simulation.motion_files.clip import MotionClip
from handtrack.simulation.motion_files.joint_tables import matched_joints, read_table
from handtrack.simulation.motion_files.read_motion import (
    RawMotion,
    axis_words,
    in_metres,
    read_motion,
    upright_axis,
)
from handtrack_app.commands.terminal.progress import progress_bar, say

Posed = Callable[[ArticulatedModel], Floats[F, P] | None]
_HAND_JOINTS = 12
"""of a hand's 21, from which on a file is a hand's where it is no body's"""


def read_given(args: argparse.Namespace, path: Path) -> RawMotion:
    """Return what the file says, after `--skeleton`, `--motion-fps` and `--positions`. Raises HandtrackError."""
    raw = read_motion(path, args.skeleton, args.motion_fps, args.positions)
    for note in raw.notes:
        say(f"note: {note}")
    return raw


def model_of(args: argparse.Namespace, raw: RawMotion, path: Path) -> str:
    """Return the model's name: the user's, else a body's or a hand's, whichever the file's names are of."""
    if args.model is not None:
        return args.model
    if args.names is not None:
        return "body34"
    try:
        matched_joints(load_model("body34"), raw.clip.names, str(path))
    except HandtrackError as unknown:
        try:
            found = matched_joints(load_model("hand26"), raw.clip.names, str(path))
        except HandtrackError:
            raise unknown from None
        if len(found.names) < _HAND_JOINTS:
            raise unknown from None
        return "hand26"
    return "body34"


def clip_of(
    args: argparse.Namespace, raw: RawMotion, model: ArticulatedModel, path: Path
) -> tuple[MotionClip, float]:
    """Return the file's joints by the model's names [m], and the metres in its unit; say how. Raises HandtrackError."""
    names = raw.clip.names
    found = (
        matched_joints(model, names, str(path))
        if args.names is None
        else read_table(args.names, model, names)
    )
    say(
        f"{path}: {raw.family}, {len(raw.clip.positions)} frames at {raw.clip.fps:.4g} a second; {found.words}"
    )
    clip, unit_m, notes = in_metres(raw, found.names, model.kind, args.unit_m, str(path))
    axis = upright_axis(clip)
    up = (
        []
        if axis is None
        else [f"up is {axis_words(axis)}, as the shoulders stand above the hips."]
    )
    for note in (*notes, *up):
        say(note)
    return clip, unit_m


def fitted(
    name: str,
    side: str,
    clip: MotionClip,
    scale: Path | None = None,
    posed: Posed = lambda _: None,
) -> Captured:
    """Return the clip on the model, with a bar; its size fitted unless a saved one is given."""
    build = model_builder(name, side)
    with progress_bar(len(clip.positions), "fitting") as bar:

        def tell() -> None:
            bar.update()

        return captured(build, clip, None if scale is None else read_scale(scale), tell, posed)


def residuals(motion: Captured) -> dict[str, float]:
    """Return the median distance of each joint to the file's [mm]; of joints that are known in some frame."""
    errors = 1e3 * motion.errors_m
    return {
        name: round(float(np.nanmedian(column)), 1)
        for name, column in zip(motion.clip.names, errors.T, strict=True)
        if np.isfinite(column).any()
    }
