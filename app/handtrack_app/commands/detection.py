"""`handtrack detect`, `detector`, `masks` and `stereo`: joints, masks and clouds made of a session's images, as files that it reads."""

from __future__ import annotations

import json
import time
from argparse import Namespace
from collections.abc import Mapping
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from handtrack.capture.clouds.cloud_files import write_cloud
from handtrack.capture.clouds.stereo import rectified
from handtrack.detector.hand_detector import HandDetector
from handtrack.detector.weights import (
    DOWNLOAD_MB,
    LICENCE,
    digest_of,
    fetch_weights,
    install_weights,
)
from handtrack.errors import HandtrackError
from handtrack.files.atomic import replacing
from handtrack.files.toml_edit import edit_toml
from handtrack.session.detection import (
    JointDetection,
    camera_changes,
    keypoint_settings,
    mask_settings,
    other_joints,
)
from handtrack.session.doctor.check_views import check_synchrony
from handtrack.session.layout import KEYPOINTS_FOLDER, MASKS_FOLDER, POSES_FILE, SESSION_FILE
from handtrack.session.refined_masks import MaskRefinement
from handtrack.session.session import Session
from handtrack.session.session_file import CloudSettings
from handtrack.session.tables import read_npz
from handtrack_app.commands.output import (
    Answer,
    note,
    print_status,
    progress_bar,
    stoppable,
)
from handtrack_app.commands.track import parse_frames

_MOST = 0.5
"""share of a camera's images in which its joints must be for its masks to be made by them, as for `new`"""
_SEEDED = '{ method = "seeded" }'


def detect(options: Namespace) -> Answer:
    """Look for the hand in every frame asked for, write its joints, and say how the session is to use them."""
    session = Session.open(options.session)
    detector = HandDetector.open(options.weights, options.backend)
    if not detector.weights.is_known:
        print_status(
            f"note: {detector.weights.path} is not the file that handtrack was tested with."
        )
    detection = JointDetection(session, detector, options.camera)
    frames = parse_frames(options.frames, session.frame_range, session.folder)[:: options.every]
    started = time.monotonic()
    with stoppable() as stop, progress_bar(len(frames), "detecting") as bar:
        for frame in frames:
            if stop():
                break
            detection.step(frame)
            bar.update()
        stop.shielded = True
        counts = detection.write()
    seconds = time.monotonic() - started
    where = [camera for camera, row in counts.items() if row["found"]]
    changes = camera_changes(session, where, keypoint_settings)
    often = [
        camera for camera in where if counts[camera]["found"] >= _MOST * counts[camera]["images"]
    ]
    others = [c.name for c in session.file.cameras if c.name in often and mask_settings(c)]
    kept = detection.with_fitting_masks(others)
    masked = [camera for camera in others if camera not in kept]
    masks = camera_changes(session, masked, mask_settings)
    if options.masks:
        changes |= masks
    by = f" Masks of {', '.join(masked)} are made by them (method seeded)."
    used = f"{by if options.masks and masks else ''} `handtrack track` takes them beside all else."
    to_use = _used(session, changes, options.write, used) if changes else []
    note(*_notes(session, counts), *session.warnings)
    cameras = {camera: {"camera": camera, **row} for camera, row in counts.items()}
    report = {
        "cameras": cameras, "session_file": changes, "written": options.write, "seconds": seconds,
        "backend": detector.backend, "interrupted": stop.asked,
    }  # fmt: skip
    lines = [
        f"{camera}: found in {row['found']} of {row['images']} images ({100 * row['found'] / max(row['images'], 1):.1f} %)."
        for camera, row in counts.items()
    ]
    lines += [f"Joints are in {session.folder / KEYPOINTS_FOLDER}.", *to_use]
    if kept and options.masks:
        lines.append(f"Masks of {', '.join(kept)} stay: they show the hand where its joints are.")
    if masks and not options.masks:
        lines.append(
            f"Masks can be made by these joints: give --masks, too, or write masks = {_SEEDED}."
        )
    return Answer(report, lines, stop.code)


def _used(session: Session, changes: dict[str, Any], writes: bool, used: str) -> list[str]:
    """Write into session.toml what it is to say of files that were made, or return it in lines. used: what follows then."""
    if writes:
        said = edit_toml(session.folder / SESSION_FILE, changes, "a session's settings")
        return [f"{SESSION_FILE} says so now.{said}{used}"]
    lines = [f"To use them, give --write, or write in {SESSION_FILE}:"]
    for key, value in changes.items():
        _, number, name = key.split(".", 2)
        camera = session.file.cameras[int(number)].name
        if value is not None:
            shown = _SEEDED if isinstance(value, dict) else json.dumps(value)
            lines.append(f'  [[camera]] "{camera}": {name} = {shown}')
    return lines


def _notes(session: Session, counts: Mapping[str, Mapping[str, int]]) -> list[str]:
    side = session.file.hand.side
    other = {"right": "left", "left": "right"}[side]
    notes = []
    for camera, row in counts.items():
        if row["other_side"]:
            notes.append(
                f"camera '{camera}': in {row['other_side']} images all hands look like {other} ones, so they were left out. "
                f'If one of them is the session\'s, write side = "{other}" in [hand] of {SESSION_FILE}; mirrored images look so, too.'
            )
        if row["unfit"]:
            notes.append(
                f"camera '{camera}': in {row['unfit']} images a {side} hand was detected that disagrees with the other cameras; "
                "it was left out. If there is only one hand, check the cameras' synchronisation and the calibration."
            )
        already = other_joints(session, camera)
        if row["found"] and already is not None:
            notes.append(
                f"camera '{camera}' already has keypoints = \"{already}\"; that is unchanged."
            )
    return notes


# ---- `handtrack masks`: masks made again by tracked poses, and how well they agree with the model


_COMPARED = 25
"""frames in which cameras are compared"""


def segment_again(session: Path, poses: Path | None, camera: list[str], write: bool) -> Answer:
    """Write a mask for each frame that was tracked, and say how the session is to use them."""
    opened = Session.open(session)
    track = read_npz(poses or opened.folder / POSES_FILE)
    refinement = MaskRefinement(opened, track, camera)
    frames = list(refinement.rows)
    results: dict[str, dict[str, Any]] = {}
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
            results[view.name] = {"camera": view.name, "masks": len(rows), "known": float(known), "agreement": float(agreement)}  # fmt: skip
    off = refinement.outline_errors_px(frames[:: max(len(frames) // _COMPARED, 1)])
    for name, row in results.items():
        row["off_px"] = off[name]
    changes, writes = refinement.changes(), write and not stop.asked
    to_use = _used(opened, changes, writes, " `handtrack track` uses them from now on.")
    note(*opened.warnings)
    lines = [
        "{camera}: {masks} masks; {known:.0%} of the hand is known (median), and agrees with the model by {agreement:.2f} (IoU). "
        "The other cameras contradict {off_px:.1f} px of its outline.".format(**row)
        for row in results.values()
    ]
    lines += [f"Masks are in {opened.folder / MASKS_FOLDER}.", *to_use]
    report = {"cameras": results, "session_file": changes, "written": write, "interrupted": stop.asked}  # fmt: skip
    return Answer(report, lines, stop.code)


# ---- `handtrack stereo`: calibrated pairs of a session → one point cloud file a frame


_FOLDER = "clouds"
_MOST_APART_DEG = 40.0  # pairs chosen for the user; others may be asked for in session.toml


def match_stereo(session: Path, frames: str | None, out: Path | None) -> Answer:
    """Match the pairs of every frame asked for and write their merged clouds."""
    opened = Session.open(session)
    numbers = parse_frames(frames, opened.frame_range, opened.folder)
    folder = out or opened.folder / _FOLDER
    if folder.is_dir() and any(folder.glob("*.ply")):
        raise HandtrackError(
            f"{folder} already holds .ply files; they are not overwritten. Give another folder with "
            "--out, or move them away."
        )
    settings = opened.file.clouds or CloudSettings()
    names = settings.stereo or _pairs(opened)
    measuring = opened.with_clouds(settings.with_values({"stereo": names}))
    note(*(finding.text for finding in check_synchrony(opened) if finding.severity == "warning"))
    print_status("pairs: " + ", ".join(f"{a} and {b}" for a, b in names))
    folder.mkdir(parents=True, exist_ok=True)
    counts: list[int] = []
    with stoppable() as stop, progress_bar(len(numbers), "matching") as bar:
        for frame in numbers:
            if stop():
                break
            cloud = measuring.measured_cloud(frame)
            if cloud is not None:
                path = folder / f"{frame:06d}.ply"
                with replacing(path) as part:
                    write_cloud(part, cloud, opened.file.session.world_unit_m)
                counts.append(len(cloud))
            bar.update()
    note(*measuring.warnings)
    report = {"clouds": len(counts), "frames": len(numbers), "points": counts, "output": folder}
    return Answer(report, _summary(opened, folder, numbers, counts), stop.code)


def _summary(session: Session, out: Path, frames: range, counts: list[int]) -> list[str]:
    """Return what clouds were made, in lines."""
    if not counts:
        return [
            f"no frame of {len(frames)} has images of both cameras of a pair; nothing was written."
        ]
    lines = [
        f"{len(counts)} clouds of {len(frames)} frames in {out}; {min(counts)} to {max(counts)} points."
    ]
    if not max(counts):
        print_status(
            "note: no points at all: do the cameras have empty masks? `handtrack doctor` checks them."
        )
    if out.resolve().is_relative_to(session.folder.resolve()):
        place = out.resolve().relative_to(session.folder.resolve()).as_posix()
        lines.append(
            f'To use these files instead of matching anew: in [clouds], files = "{place}/*.ply".'
        )
    return lines


def _pairs(session: Session) -> tuple[tuple[str, str], ...]:
    """Return the pairs of cameras with images that look the same way; session.toml names none."""
    views = [view for view in session.views if view.images is not None]
    pairs = []
    for a, b in combinations(views, 2):
        cosine = np.clip(a.camera.rotation[2] @ b.camera.rotation[2], -1.0, 1.0)
        if np.degrees(np.arccos(cosine)) > _MOST_APART_DEG:
            continue
        try:
            rectified(a.camera, b.camera)
        except HandtrackError:
            continue  # cameras in one place, or one before the other
        pairs.append((a.name, b.name))
    if not pairs:
        raise HandtrackError(
            f"{session.folder}: no two cameras with images look in directions less than "
            f"{_MOST_APART_DEG:g} degrees apart, so there is no pair to match. Name pairs in "
            'session.toml: [clouds], stereo = [["left", "right"]].'
        )
    return tuple(pairs)


# ---- `handtrack detector install`: the detector's weights for all sessions of this user, fetched or copied


def install(file: Path | None) -> Answer:
    """Install the networks of the file given, else fetch them by pip; say their licence."""
    if file is None:
        print_status(f"fetching the detector's networks by pip, {DOWNLOAD_MB} MB …")
    target = fetch_weights() if file is None else install_weights(file)
    digest = digest_of(target)
    lines = (
        f"The detector is installed in {target}; its networks are those that handtrack was tested with.",
        f"Licence of these weights: {LICENCE}.",
    )
    report = {"source": file, "output": target, "sha256": digest, "licence": LICENCE}
    return Answer(report, lines)
