"""`handtrack simulate` and `retarget`: a recording with truth; a model fitted to a motion file."""

from __future__ import annotations

import shlex
from argparse import Namespace
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from handtrack.arrays import F, Floats, P
from handtrack.errors import HandtrackError, unknown_name
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.model_file import load_model, read_scale
from handtrack.session.layout import POSES_FILE
from handtrack.session.tables import write_npz
from handtrack.simulation.motion import MOTIONS
from handtrack.simulation.motion_files.clip import MotionClip
from handtrack.simulation.motion_files.read_motion import (
    axis_words,
    in_metres,
    matched_joints,
    read_motion,
    read_table,
    upright_axis,
)
from handtrack.simulation.retarget import (
    Captured,
    captured,
    custom_motion,
    model_builder,
    own_params,
    result_of,
    staged,
    write_captured,
)
from handtrack.simulation.simulate import Simulation, simulate
from handtrack_app.commands.output import (
    Answer,
    check_new,
    new_folder,
    output_file,
    print_status,
    progress_bar,
)

_HAND, _BODY = ("open_fist_open", 0.5), ("dance", 3.5)
"""usual motion, and the cameras' distance [m]"""
_FRAMES = 100
_SUFFIXES = (".bvh", ".amc", ".asf", ".trc", ".c3d", ".csv")


def run(options: Namespace) -> Answer:
    """Render the session folder and name it."""
    check_new(options.out)
    file = _motion_file(options)
    known = None
    if file is None:
        model = options.model or "hand26"
        usual, distance_m = _usual(model)
        motion = usual if options.motion is None else options.motion
        frames = _FRAMES if options.frames is None else options.frames
        known_motions = tuple(MOTIONS[load_model(model).kind])
        if motion not in known_motions:
            raise unknown_name("motion", motion, known_motions, "--motion")
    else:
        motion, (model, _, clip, _) = file.name, read_clip(options, file)
        distance_m = _usual(model)[1]
        clip = clip.resampled(options.fps)
        clip = staged(replace(clip, positions=clip.positions[: options.frames]))
        frames = len(clip.positions)
        known = custom_motion(fitted(model, options.side, clip))
    what = Simulation(
        model=model,
        cameras=options.cameras,
        frames=frames,
        size=(options.size[0], options.size[1]),
        motion=motion,
        side=options.side,
        scale=options.scale,
        forearm=options.forearm,
        distance_m=distance_m if options.distance is None else options.distance,
        fps=options.fps,
        images=not options.no_images,
        distortion=options.distortion,
        init_noise_m=options.init_noise_mm * 1e-3,
        seed=options.seed,
        joints_px=options.joints_px,
        clouds=options.clouds,
    )
    what.check()
    total = frames * options.cameras
    with new_folder(options.out) as folder, progress_bar(total, "rendering") as bar:

        def show(_done: int, _total: int) -> None:
            bar.update()

        simulate(folder, what, show, known)
    words = f"simulated session in {options.out}; open it with: handtrack open {shlex.quote(str(options.out))}"
    report = {"session": options.out, "frames": frames, "cameras": options.cameras}
    return Answer(report, [words])


def _usual(model: str) -> tuple[str, float]:
    return _BODY if load_model(model).kind == "body" else _HAND


def _motion_file(options: Namespace) -> Path | None:
    """Return the file that `--motion` names; None for a motion's name. Raises HandtrackError for options of files alone."""
    text = options.motion
    if text is not None and (Path(text).suffix.lower() in _SUFFIXES or "/" in text):
        return Path(text)
    for option in ("skeleton", "names", "unit_m", "positions", "motion_fps"):
        if getattr(options, option) is not None:
            raise HandtrackError(
                f"--{option.replace('_', '-')} is about a motion file, but --motion names none; expected a {', '.join(_SUFFIXES)} file."
            )
    return None


# ---- `handtrack retarget`: a model fitted to a motion file


def retarget(options: Namespace) -> Answer:
    """Fit size and every frame; write poses, or a session with them; tell how near each joint is."""
    is_file = options.out.suffix.lower() == ".npz"
    if is_file:
        output_file(options.out, (".npz",), "poses are")
    else:
        check_new(options.out)
    asked = options.model or ""
    if "/" in asked or asked.endswith(".toml"):
        raise HandtrackError(
            f"--model {asked}: expected the name of a model, such as body34 or hand26."
        )
    name, theirs, clip, unit_m = read_clip(options, options.file)
    motion = fitted(
        name, options.side, clip, options.scale, lambda model: own_params(model, theirs, unit_m)
    )
    if is_file:
        write_npz(options.out, result_of(motion, options.file.name))
    else:
        with new_folder(options.out) as folder:
            write_captured(folder, motion, options.file.stem)
    errors = 1e3 * motion.errors_m
    table = residuals(motion)
    lines = [
        f"{options.out}: {len(motion.params)} frames of {name}; joints are {np.nanmedian(errors):.1f} mm from the file's (median), "
        f"{np.nanpercentile(errors, 95):.1f} mm in 95 %.",
        "median of each joint [mm]: " + ", ".join(f"{joint} {mm:g}" for joint, mm in table.items()),
    ]
    if not is_file:
        folder, poses = (shlex.quote(str(path)) for path in (options.out, options.out / POSES_FILE))
        lines.append(
            f"Open it with: handtrack open {folder}; export it with: handtrack export {poses} --to FORMAT"
        )
    report = {
        "out": options.out, "model": name, "frames": len(motion.params), "fps": clip.fps, "scale": motion.model.scale.overall,
        "median_mm": round(float(np.nanmedian(errors)), 2), "p95_mm": round(float(np.nanpercentile(errors, 95)), 2),
        "joints_mm": table,
    }  # fmt: skip
    return Answer(report, lines)


# ---- The motion file that a command is given


Posed = Callable[[ArticulatedModel], Floats[F, P] | None]
_HAND_JOINTS = 12
"""of a hand's 21, from which on a file is a hand's where it is no body's"""


def model_of(options: Namespace, names: Sequence[str], path: Path) -> str:
    """Return the model's name: the user's, else a body's or a hand's, whichever the file's names are of."""
    if options.model is not None:
        return options.model
    if options.names is not None:
        return "body34"
    try:
        matched_joints(load_model("body34"), names, str(path))
    except HandtrackError as unknown:
        try:
            result, _ = matched_joints(load_model("hand26"), names, str(path))
        except HandtrackError:
            raise unknown from None
        if len(result) < _HAND_JOINTS:
            raise unknown from None
        return "hand26"
    return "body34"


def read_clip(options: Namespace, path: Path) -> tuple[str, MotionClip, MotionClip, float]:
    """Return the model's name, a file's clip, its joints by the model's names [m], and the metres in its unit; say how. Raises
    HandtrackError.
    """
    theirs, unit_m, form = read_motion(
        path, options.skeleton, options.motion_fps, options.positions
    )
    name = model_of(options, theirs.names, path)
    model = load_model(name, side=options.side)
    names, words = (
        matched_joints(model, theirs.names, str(path))
        if options.names is None
        else read_table(options.names, model, theirs.names)
    )
    print_status(
        f"{path}: {form}, {len(theirs.positions)} frames at {theirs.fps:.4g} a second; {words}"
    )
    clip, unit_m, notes = in_metres(theirs, names, model.kind, options.unit_m or unit_m, str(path))
    axis = upright_axis(clip)
    up = (
        []
        if axis is None
        else [f"up is {axis_words(axis)}, as the shoulders stand above the hips."]
    )
    for text in (*notes, *up):
        print_status(text)
    return name, theirs, clip, unit_m


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

        def report() -> None:
            bar.update()

        return captured(build, clip, None if scale is None else read_scale(scale), report, posed)


def residuals(motion: Captured) -> dict[str, float]:
    """Return the median distance of each joint to the file's [mm]; of joints that are known in some frame."""
    errors = 1e3 * motion.errors_m
    return {
        name: round(float(np.nanmedian(column)), 1)
        for name, column in zip(motion.clip.names, errors.T, strict=True)
        if np.isfinite(column).any()
    }
