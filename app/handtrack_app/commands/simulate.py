"""`handtrack simulate`: a recording with truth."""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from pathlib import Path

from handtrack.errors import HandtrackError, unknown_name
from handtrack.model.model_file import load_model
from handtrack.simulation.captured import known_motion, staged
from handtrack.simulation.motion import MOTIONS
from handtrack.simulation.simulate import Simulation, simulate
from handtrack_app.commands.retarget import clip_of, fitted, model_of, read_given
from handtrack_app.commands.terminal.output import answer, check_new, new_folder, progress_bar

_LARGEST_IMAGE = 8192
_HAND, _BODY = ("open_fist_open", 0.5), ("dance", 3.5)
"""usual motion, and the cameras' distance [m]"""
_FRAMES = 100
_SUFFIXES = (".bvh", ".amc", ".asf", ".trc", ".c3d", ".csv")
_SCALES = (0.3, 3.0)
_MOST_NOISE_MM = 100.0
_MOST_JOINTS_PX = 100.0


def run(args: argparse.Namespace) -> int:
    """Render the session folder and name it."""
    file = _motion_file(args)
    known = None
    if file is None:
        args.model = args.model or "hand26"
        motion, distance_m = _usual(args.model)
        args.motion = motion if args.motion is None else args.motion
        args.frames = _FRAMES if args.frames is None else args.frames
    else:
        raw = read_given(args, file)
        args.model = model_of(args, raw, file)
        distance_m = _usual(args.model)[1]
    args.distance = distance_m if args.distance is None else args.distance
    _check(args, file is None)
    if file is not None:
        clip, _ = clip_of(args, raw, load_model(args.model, side=args.side), file)
        clip = clip.resampled(args.fps)
        clip = staged(replace(clip, positions=clip.positions[: args.frames]))
        args.frames = len(clip.positions)
        check_new(args.out)
        known = known_motion(fitted(args.model, args.side, clip), file.name)
    what = Simulation(
        model=args.model,
        cameras=args.cameras,
        frames=args.frames,
        size=(args.size[0], args.size[1]),
        motion=args.motion,
        side=args.side,
        scale=args.scale,
        forearm=args.forearm,
        distance_m=args.distance,
        fps=args.fps,
        images=not args.no_images,
        distortion=args.distortion,
        init_noise_m=args.init_noise_mm * 1e-3,
        seed=args.seed,
        joints_px=args.joints_px,
        clouds=args.clouds,
    )
    what.check()
    check_new(args.out)
    total = args.frames * args.cameras
    with new_folder(args.out) as folder, progress_bar(total, "rendering") as bar:

        def show(_done: int, _total: int) -> None:
            bar.update()

        simulate(folder, what, show, known)
    words = f"simulated session in {args.out}; open it with: handtrack open {args.out}"
    answer(args, {"session": args.out, "frames": args.frames, "cameras": args.cameras}, words)
    return 0


def _usual(model: str) -> tuple[str, float]:
    return _BODY if load_model(model).kind == "body" else _HAND


def _motion_file(args: argparse.Namespace) -> Path | None:
    """Return the file that `--motion` names; None for a motion's name. Raises HandtrackError for options of files alone."""
    text = args.motion
    if text is not None and (Path(text).suffix.lower() in _SUFFIXES or "/" in text):
        return Path(text)
    for option in ("skeleton", "names", "unit_m", "positions", "motion_fps"):
        if getattr(args, option) is not None:
            raise HandtrackError(
                f"--{option.replace('_', '-')} is about a motion file, but --motion names none; expected a {', '.join(_SUFFIXES)} file."
            )
    return None


def _check(args: argparse.Namespace, is_named: bool) -> None:
    """Raise HandtrackError for numbers that Simulation.check lets pass."""
    known = tuple(MOTIONS[load_model(args.model).kind])
    if is_named and args.motion not in known:
        raise unknown_name("motion", args.motion, known, "--motion")
    if max(args.size) > _LARGEST_IMAGE:
        raise HandtrackError(
            f"--size {args.size[0]} {args.size[1]}: expected at most {_LARGEST_IMAGE} pixels each."
        )
    if not _SCALES[0] <= args.scale <= _SCALES[1]:
        raise HandtrackError(
            f"--scale {args.scale:g}: expected a factor on a hand of 187 mm, {_SCALES[0]:g} to {_SCALES[1]:g}."
        )
    if not math.isfinite(args.init_noise_mm) or not 0 <= args.init_noise_mm <= _MOST_NOISE_MM:
        raise HandtrackError(
            f"--init-noise-mm {args.init_noise_mm:g}: expected 0 to {_MOST_NOISE_MM:g} mm."
        )
    if args.joints_px is not None and not 0 <= args.joints_px <= _MOST_JOINTS_PX:
        raise HandtrackError(
            f"--joints-px {args.joints_px:g}: expected 0 to {_MOST_JOINTS_PX:g} px of error in each joint."
        )
    if not is_named and args.frames is not None and args.frames < 1:
        raise HandtrackError(f"--frames {args.frames}: expected 1 at least.")
    if args.seed < 0:
        raise HandtrackError(f"--seed {args.seed}: expected a whole number from 0.")
