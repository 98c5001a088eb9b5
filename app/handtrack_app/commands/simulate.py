"""`handtrack simulate`: a recording with truth."""

from __future__ import annotations

import argparse
import math

from handtrack.errors import HandtrackError, unknown_name
from handtrack.simulation.body_motion import BODY_MOTIONS
from handtrack.simulation.motion import MOTIONS
from handtrack.simulation.simulate import Simulation, simulate
from handtrack_app.commands.terminal.answer import answer
from handtrack_app.commands.terminal.output import check_new, new_folder
from handtrack_app.commands.terminal.progress import progress_bar

_LARGEST_IMAGE = 8192
_HAND, _BODY = ("open_fist_open", 0.5), ("dance", 3.5)
_USUAL = {"hand26": _HAND, "body34": _BODY, "body38": _BODY}
"""motion and the cameras' distance [m] of a model"""
_SCALES = (0.3, 3.0)
_MOST_NOISE_MM = 100.0


def run(args: argparse.Namespace) -> int:
    """Render the session folder and name it."""
    motion, distance_m = _USUAL[args.model]
    args.motion = motion if args.motion is None else args.motion
    args.distance = distance_m if args.distance is None else args.distance
    _check(args)
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
    )
    what.check()
    check_new(args.out)
    total = args.frames * args.cameras
    with new_folder(args.out) as folder, progress_bar(total, "rendering") as bar:

        def show(_done: int, _total: int) -> None:
            bar.update()

        simulate(folder, what, show)
    words = f"simulated session in {args.out}; open it with: handtrack open {args.out}"
    answer(args, {"session": args.out, "frames": args.frames, "cameras": args.cameras}, words)
    return 0


def _check(args: argparse.Namespace) -> None:
    """Raise HandtrackError for numbers that Simulation.check lets pass."""
    known = tuple(MOTIONS if _USUAL[args.model] is _HAND else BODY_MOTIONS)
    if args.motion not in known:
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
    if args.seed < 0:
        raise HandtrackError(f"--seed {args.seed}: expected a whole number from 0.")
