"""`handtrack masks`: masks made again by tracked poses, and how well they agree with the model."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict

import numpy as np

from handtrack.files.toml_edit import edit_toml
from handtrack.session.formats.tables import read_npz
from handtrack.session.layout import MASKS_FOLDER, POSES_FILE, SESSION_FILE
from handtrack.session.refined_masks import MaskRefinement, RefinedCamera
from handtrack.session.session import Session
from handtrack_app.commands.terminal.progress import progress_bar, say, stoppable

_INTERRUPTED = 130
_COMPARED = 25
"""frames in which cameras are compared"""


def run(args: argparse.Namespace) -> int:
    """Write a mask for each frame that was tracked, and say how the session is to use them."""
    session = Session.open(args.session)
    track = read_npz(args.poses or session.folder / POSES_FILE)
    refinement = MaskRefinement(session, track, args.camera)
    frames = list(refinement.rows)
    told: dict[str, tuple[int, float, float]] = {}
    with stoppable() as stop, progress_bar(len(frames) * len(refinement.views), "masks") as bar:
        for view in refinement.views:
            masks, rows = refinement.learn(view), []
            for frame in frames:
                if stop():
                    break
                row = refinement.write(view, masks, frame)
                rows += [] if row is None else [row]
                bar.update()
            known, agreement = np.median(rows, axis=0) if rows else (0.0, 0.0)
            told[view.name] = len(rows), float(known), float(agreement)
    off = refinement.outlines_off(frames[:: max(len(frames) // _COMPARED, 1)])
    found = [RefinedCamera(name, *row, off[name]) for name, row in told.items()]
    changes, said = refinement.changes(), ""
    if args.write and not stop.asked:
        said = edit_toml(session.folder / SESSION_FILE, changes, "a session's settings")
    for text in dict.fromkeys(session.warnings):
        say(f"note: {text}")
    if args.json:
        print(json.dumps({"cameras": {row.camera: asdict(row) for row in found}, "session_file": changes,
                          "written": args.write, "interrupted": stop.asked}))  # fmt: skip
        return _INTERRUPTED if stop.asked else 0
    for row in found:
        print(
            f"{row.camera}: {row.masks} masks; {row.known:.0%} of the hand is known (median), and agrees with the model by "
            f"{row.agreement:.2f} (IoU). The other cameras contradict {row.off_px:.1f} px of its outline."
        )
    print(f"Masks are in {session.folder / MASKS_FOLDER}.")
    if args.write and not stop.asked:
        print(f"{SESSION_FILE} says so now.{said} `handtrack track` uses them from now on.")
    else:
        print(f"To use them, give --write, or write in {SESSION_FILE}:")
        for key, value in changes.items():
            _, number, name = key.split(".")
            camera = session.file.cameras[int(number)].name
            print(f'  [[camera]] "{camera}": {name} = {json.dumps(value)}')
    return _INTERRUPTED if stop.asked else 0
