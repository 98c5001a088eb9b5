"""`handtrack detect`: the hand's joints in a session's images → files that the session reads."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from handtrack.detector.hand_detector import HandDetector
from handtrack.errors import HandtrackError
from handtrack.files.toml_edit import edit_toml
from handtrack.session.detection import (
    CameraDetection,
    JointDetection,
    mask_changes,
    other_joints,
    session_changes,
)
from handtrack.session.layout import KEYPOINTS_FOLDER, SESSION_FILE
from handtrack.session.session import Session
from handtrack_app.commands.terminal.progress import progress_bar, say, stoppable
from handtrack_app.commands.terminal.track_options import parse_frames

_INTERRUPTED = 130
_MOST = 0.5
"""share of a camera's images in which its joints must be for its masks to be made by them, as for `new`"""
_SEEDED = '{ method = "seeded" }'


def run(args: argparse.Namespace) -> int:
    """Look for the hand in every frame asked for, write its joints, and say how the session is to use them."""
    session = Session.open(args.session)
    detector = HandDetector.open(args.weights, args.backend)
    if not detector.weights.is_known:
        say(f"note: {detector.weights.path} is not the file that handtrack was tested with.")
    detection = JointDetection(session, detector, args.camera)
    if args.every < 1:
        raise HandtrackError(f"--every {args.every}: expected a whole number from 1.")
    frames = parse_frames(args.frames, session.frame_range, session.folder)[:: args.every]
    started = time.monotonic()
    with stoppable() as stop, progress_bar(len(frames), "detecting") as bar:
        for frame in frames:
            if stop():
                break
            detection.step(frame)
            bar.update()
        stop.shielded = True
        found = detection.write()
    seconds = time.monotonic() - started
    where = [row.camera for row in found if row.found]
    changes: dict[str, Any] = {**session_changes(session, where)}
    often = [row.camera for row in found if row.found >= _MOST * row.images]
    masks = mask_changes(session, [name for name in often if name in where])
    if args.masks:
        changes |= masks
    said = ""
    if args.write and changes:
        said = edit_toml(session.folder / SESSION_FILE, changes, "a session's settings")
    for text in [*_notes(session, found), *dict.fromkeys(session.warnings)]:
        say(f"note: {text}")
    if args.json:
        cameras = {row.camera: asdict(row) for row in found}
        print(json.dumps({"cameras": cameras, "session_file": changes, "written": args.write, "seconds": seconds,
                          "backend": detector.backend, "interrupted": stop.asked}))  # fmt: skip
    else:
        _print(session, found, changes, said if args.write else None)
        if masks and not args.masks:
            print(
                f"Masks can be made by these joints: give --masks, too, or write masks = {_SEEDED}."
            )
    return _INTERRUPTED if stop.asked else 0


def _print(
    session: Session, found: Sequence[CameraDetection], changes: dict[str, Any], said: str | None
) -> None:
    """said: about session.toml, which was changed; None where it was not."""
    for row in found:
        share = 100 * row.found / max(row.images, 1)
        print(f"{row.camera}: found in {row.found} of {row.images} images ({share:.1f} %).")
    print(f"Joints are in {session.folder / KEYPOINTS_FOLDER}.")
    if said is not None and changes:
        masks = any(name.endswith(".masks") for name in changes)
        by = " Masks are made by them (method seeded)." if masks else ""
        print(
            f"{SESSION_FILE} says so now.{said}{by} `handtrack track` takes them beside all else."
        )
    elif changes:
        print(f"To use them, write in {SESSION_FILE}, or give --write:")
        for key, value in changes.items():
            _, number, name = key.split(".", 2)
            camera = session.file.cameras[int(number)].name
            if value is not None:
                shown = _SEEDED if name == "masks" else f'"{value}"'
                print(f'  [[camera]] "{camera}": {name} = {shown}')


def _notes(session: Session, found: Sequence[CameraDetection]) -> list[str]:
    side = session.file.hand.side
    other = {"right": "left", "left": "right"}[side]
    notes = []
    for row in found:
        if row.other_side:
            notes.append(
                f"camera '{row.camera}': in {row.other_side} images all hands look like {other} ones, so they were left out. "
                f'If one of them is the session\'s, write side = "{other}" in [hand] of {SESSION_FILE}; mirrored images look so, too.'
            )
        if row.unfit:
            notes.append(
                f"camera '{row.camera}': in {row.unfit} images a {side} hand was detected that disagrees with the other cameras; "
                "it was left out. If there is only one hand, check the cameras' synchronisation and the calibration."
            )
        already = other_joints(session, row.camera)
        if row.found and already is not None:
            notes.append(
                f"camera '{row.camera}' already has keypoints = \"{already}\"; that is unchanged."
            )
    return notes
