"""`handtrack model`: a definition checked, or made of another program's model."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import tomlkit

from handtrack.errors import HandtrackError
from handtrack.export.motion.urdf import urdf_text
from handtrack.files.atomic import replace_text
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.model_file import load_model, read_definition
from handtrack_app.commands.terminal.answer import answer
from handtrack_app.commands.terminal.output import output_file

_SIZES_M = (0.02, 3.0)
"""of what may be tracked: a small gripper to more than a tall body"""
_THIN_M = 1e-4
_ROBOT = ".urdf"


def run(args: argparse.Namespace) -> int:
    """Check a definition and say what is in it; write it as TOML, or as a robot's URDF, where that is asked for."""
    if args.out is not None:
        output_file(args.out, (".toml", _ROBOT), "definitions and robots are")
        if args.out.exists():
            raise HandtrackError(f"--out {args.out}: there is such a file already; name another one.")  # fmt: skip
    model = load_model(args.file)
    found = findings(model)
    told = {
        "name": model.name, "kind": model.kind, "bones": len(model.skeleton.bone_names),
        "freedoms": list(model.parameter_names[6:]), "joints": list(model.joint_names),
        "ellipsoids": {key: len(flesh.bone) for key, flesh in model.flesh.items()}, "findings": found, "output": args.out,
    }  # fmt: skip
    if args.out is not None:
        is_robot = args.out.suffix.lower() == _ROBOT
        text = (
            urdf_text(model) if is_robot else definition_text(read_definition(args.file), args.file)
        )
        replace_text(args.out, text)
    shapes = ", ".join(f"{count} ellipsoids in {key}" for key, count in told["ellipsoids"].items())
    words = (
        f"{model.name}: {told['bones']} bones, {len(told['freedoms'])} freedoms besides the root's six, "
        f"{len(told['joints'])} joints, {shapes}. {'Nothing odd was found.' if not found else ''}"
    )
    written = [] if args.out is None else [f"written to {args.out}; to use it: [hand], model in a session, or load_model()"]  # fmt: skip
    answer(args, told, words.rstrip(), *(f"warning: {text}" for text in found), *written)
    return 0


def findings(model: ArticulatedModel) -> list[str]:
    """Return what is odd about a model, in sentences."""
    low, high = model.limits.interval[6:].T
    names, bones = model.parameter_names[6:], model.skeleton.bone_names
    rest = model.rest[6:]
    found = [f"freedom '{n}' has no room: its limits are equal" for n, a, b in zip(names, low, high) if a == b]  # fmt: skip
    found += [
        f"freedom '{name}': its rest of {np.rad2deg(r):.0f}° is outside of its limits"
        for name, r, a, b in zip(names, rest, low, high) if not a - 1e-9 <= r <= b + 1e-9
    ]  # fmt: skip
    bare = [bone for b, bone in enumerate(bones) if b not in set(model.flesh["fine"].bone.tolist())]
    moving = {bones[b] for b in model.skeleton.hinge_bone}
    last = [b for b in bare if b in moving and bones.index(b) not in model.skeleton.parent]
    found += [f"bone '{bone}' moves but has no ellipsoid: silhouettes cannot measure it" for bone in last]  # fmt: skip
    thin = model.flesh["fine"].radii.min(axis=1) < _THIN_M
    found += [f"ellipsoid {name} is thinner than 0.1 mm" for name in np.array(model.flesh["fine"].name)[thin]]  # fmt: skip
    size = float(np.ptp(model.joint_positions(model.bones(model.rest_params())), axis=0).max())
    if not _SIZES_M[0] < size < _SIZES_M[1]:
        found.append(f"its joints are {size:.3g} m apart at most: is the unit wrong? Definitions are in millimetres, URDF in metres")  # fmt: skip
    return found


def definition_text(table: Mapping[str, object], source: Path) -> str:
    """Return a definition as TOML, saying where it comes from."""
    return f"# Made of {source.name}. What the numbers mean: docs/reference/definitions.md.\n\n{tomlkit.dumps(table)}"
