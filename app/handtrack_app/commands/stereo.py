"""`handtrack stereo`: calibrated pairs of a session → one point cloud file a frame."""

from __future__ import annotations

import argparse
from itertools import combinations
from pathlib import Path

import numpy as np

from handtrack.capture.clouds.cloud_files import write_cloud
from handtrack.capture.clouds.rectification import rectified
from handtrack.errors import HandtrackError
from handtrack.files.atomic import replacing
from handtrack.session.doctor.check_views import check_synchrony
from handtrack.session.session import Session
from handtrack.session.session_file import CloudSettings
from handtrack.session.sources.clouds import StereoClouds
from handtrack_app.commands.terminal.output import answer, progress_bar, say, stoppable
from handtrack_app.commands.terminal.track_options import parse_frames

_FOLDER = "clouds"
_MOST_APART_DEG = 40.0  # pairs chosen for the user; others may be asked for in session.toml
_INTERRUPTED = 130


def run(args: argparse.Namespace) -> int:
    """Match the pairs of every frame asked for and write their merged clouds."""
    session = Session.open(args.session)
    frames = parse_frames(args.frames, session.frame_range, session.folder)
    out = args.out or session.folder / _FOLDER
    if out.is_dir() and any(out.glob("*.ply")):
        raise HandtrackError(
            f"{out} already holds .ply files; they are not overwritten. Give another folder with "
            "--out, or move them away."
        )
    settings = session.file.clouds or CloudSettings()
    names = settings.stereo or _pairs(session)
    pairs = tuple((session.view(a), session.view(b)) for a, b in names)
    source = StereoClouds(pairs, settings.matching)
    for finding in check_synchrony(session):
        if finding.severity == "warning":
            say(f"note: {finding.text}")
    say("pairs: " + ", ".join(f"{a} and {b}" for a, b in names))
    out.mkdir(parents=True, exist_ok=True)
    counts: list[int] = []
    with stoppable() as stop, progress_bar(len(frames), "matching") as bar:
        for frame in frames:
            if stop():
                break
            cloud = source.read(frame)
            if cloud is not None:
                path = out / f"{frame:06d}.ply"
                with replacing(path) as part:
                    write_cloud(part, cloud, session.file.session.world_unit_m)
                counts.append(len(cloud))
            bar.update()
    _summarise(args, session, out, frames, counts)
    for text in dict.fromkeys([*session.warnings, *source.warnings]):
        say(f"note: {text}")
    return _INTERRUPTED if stop.asked else 0


def _summarise(
    args: argparse.Namespace, session: Session, out: Path, frames: range, counts: list[int]
) -> None:
    told = {"clouds": len(counts), "frames": len(frames), "points": counts, "output": out}
    if not counts:
        none = (
            f"no frame of {len(frames)} has images of both cameras of a pair; nothing was written."
        )
        answer(args, told, none)
        return
    lines = [
        f"{len(counts)} clouds of {len(frames)} frames in {out}; {min(counts)} to {max(counts)} points."
    ]
    if not max(counts):
        say(
            "note: no points at all: do the cameras have empty masks? `handtrack doctor` checks them."
        )
    if out.resolve().is_relative_to(session.folder.resolve()):
        place = out.resolve().relative_to(session.folder.resolve()).as_posix()
        lines.append(
            f'To use these files instead of matching anew: in [clouds], files = "{place}/*.ply".'
        )
    answer(args, told, *lines)


def _pairs(session: Session) -> tuple[tuple[str, str], ...]:
    """Return the pairs of cameras with images that look the same way; session.toml names none."""
    views = [view for view in session.views if view.images is not None]
    found = []
    for a, b in combinations(views, 2):
        if _crossing_deg(a.camera.rotation[2] @ b.camera.rotation[2]) > _MOST_APART_DEG:
            continue
        try:
            rectified(a.camera, b.camera)
        except HandtrackError:
            continue  # cameras in one place, or one before the other
        found.append((a.name, b.name))
    if not found:
        raise HandtrackError(
            f"{session.folder}: no two cameras with images look in directions less than "
            f"{_MOST_APART_DEG:g} degrees apart, so there is no pair to match. Name pairs in "
            'session.toml: [clouds], stereo = [["left", "right"]].'
        )
    return tuple(found)


def _crossing_deg(cosine: float) -> float:
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
