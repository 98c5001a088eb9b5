"""`handtrack retarget`: somebody's motion file on a model of ours."""

from __future__ import annotations

import argparse

import numpy as np

from handtrack.errors import HandtrackError
from handtrack.model.model_file import load_model
from handtrack.session.formats.tables import write_npz
from handtrack.simulation.captured import result_of, write_captured
from handtrack.simulation.own_motion import own_params
from handtrack_app.commands.person.captured_motion import (
    clip_of,
    fitted,
    model_of,
    read_given,
    residuals,
)
from handtrack_app.commands.terminal.answer import answer
from handtrack_app.commands.terminal.output import check_new, new_folder, output_file


def run(args: argparse.Namespace) -> int:
    """Fit size and every frame; write poses, or a session with them; tell how near each joint is."""
    is_file = args.out.suffix.lower() == ".npz"
    if is_file:
        output_file(args.out, (".npz",), "poses are")
    else:
        check_new(args.out)
    raw = read_given(args, args.file)
    name = model_of(args, raw, args.file)
    if "/" in name or name.endswith(".toml"):
        raise HandtrackError(
            f"--model {name}: expected the name of a model, such as body34 or hand26."
        )
    clip, unit_m = clip_of(args, raw, load_model(name, side=args.side), args.file)
    motion = fitted(
        name, args.side, clip, args.scale, lambda model: own_params(model, raw.clip, unit_m)
    )
    if is_file:
        write_npz(args.out, result_of(motion, args.file.name))
    else:
        with new_folder(args.out) as folder:
            write_captured(folder, motion, args.file.stem)
    errors = 1e3 * motion.errors_m
    table = residuals(motion)
    lines = [
        f"{args.out}: {len(motion.params)} frames of {name}; joints are {np.nanmedian(errors):.1f} mm from the file's (median), "
        f"{np.nanpercentile(errors, 95):.1f} mm in 95 %.",
        "median of each joint [mm]: " + ", ".join(f"{joint} {mm:g}" for joint, mm in table.items()),
    ]
    if not is_file:
        lines.append(
            f"Open it with: handtrack open {args.out}; export it with: handtrack export {args.out}/tracks/poses.npz --to FORMAT"
        )
    told = {
        "out": args.out, "model": name, "frames": len(motion.params), "fps": clip.fps, "scale": motion.model.scale.overall,
        "median_mm": round(float(np.nanmedian(errors)), 2), "p95_mm": round(float(np.nanpercentile(errors, 95)), 2),
        "joints_mm": table,
    }  # fmt: skip
    answer(args, told, *lines)
    return 0
