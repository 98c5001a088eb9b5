"""A recording with all the files that handtrack writes in one, small and always the same: invented poses, through our own writers."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np

from handtrack.capture.masks.segmentation import SkinYCrCb
from handtrack.model.articulated import HandScale
from handtrack.model.model_file import write_scale
from handtrack.observation.pins import Pin
from handtrack.session import layout
from handtrack.session.first_pose import FirstPose, write_first_pose
from handtrack.session.session import Session
from handtrack.session.session_file import (
    CameraSettings,
    CloudSettings,
    HandSettings,
    LensSettings,
    RecordingSettings,
    SessionFile,
    write_session_file,
)
from handtrack.session.sources.corrections import SessionPins
from handtrack.session.tables import write_npz
from handtrack.simulation.simulate import Simulation, simulate
from handtrack.store.store import Span, WritableStore
from handtrack.store.take import TakeAbout
from handtrack.tracking.frame.result import Step, TrackResult
from handtrack_app.commands.batch import DONE, REFUSED, STARTED, Outcome, append
from tests.export.sequences import LOST_ROW, sample_sequence

SCALE = HandScale(0.98, {"index": 1.02}, offsets_mm={"index_tip": (0.1, -2.0, 0.5)}, std={"length_mm": 1.2, "overall": 0.01})  # fmt: skip
EVERYTHING = SessionFile(
    RecordingSettings("all keys", 30.0, "timestamps.csv", 0.043),
    HandSettings("hands/claw.toml", "left", "fit", False, "person.toml"),
    (
        CameraSettings(
            "cam0", "cam0/*.png", "masks/cam0/*.png", 128, (320, 240), (10, 20, 30, 40), bayer="rggb", demosaic="level_line",
            white_level=1023.0, keypoints="keypoints/cam0/*.json", keypoint_layout="mediapipe21", fps=25.0, lag_s=-0.04,
            lens=LensSettings("fisheye", (320, 240), [[150.0, 0.0, 160.0], [0.0, 151.0, 120.0], [0.0, 0.0, 1.0]], [0.02, -0.01, 0.003, -0.0005], [0.0, 0.1, 0.0]),
        ),
        CameraSettings("cam1", "cam1.mp4", SkinYCrCb(), depth="depth/cam1/*.png", depth_scale_m=0.000125),
    ),
    CloudSettings(depth=("cam1",), given={"crop_m": 0.1, "near_m": False}),
    {"silhouettes": {"weight": 0.5}, "solver": {"iterations": 12}},
)  # fmt: skip
"""a session.toml in which each key stands once"""
OUTCOMES = (
    Outcome("walk", "/data/walk", "5f0c", STARTED, ended="2026-01-01T00:00:00+00:00"),
    Outcome(
        "walk", "/data/walk", "5f0c", DONE, 0, 12.5, {"tracked": 8, "lost": 2}, 0.125, ["cam0 is late."],
        output="/data/walk/tracks/poses.npz", ended="2026-01-01T00:01:00+00:00",
    ),
    Outcome("run", "/data/run", "91b7", REFUSED, 2, 0.5, cause="no calibration.toml", ended="2026-01-01T00:02:00+00:00"),
)  # fmt: skip


def sample() -> TrackResult:
    """Return a left hand's frames, of which one is lost and the next doubtful, with all that a result of format 2 may have."""
    track = sample_sequence("left")[1]
    first = int(track.frame[0])
    part = track.between(range(first, first + LOST_ROW + 2))
    return replace(part, hand_length_mm=181.5, hand_length_std_mm=1.25, start_confidence=0.75)


def written(folder: Path) -> None:
    """Write the recording, and a batch's files beside it: session/, batch/."""
    session = folder / "session"
    with np.errstate(all="ignore"):
        simulate(
            session, Simulation(cameras=2, frames=1, motion="still", size=(64, 48), images=False)
        )
    write_scale(session / layout.HAND_FILE, SCALE)
    write_first_pose(
        session / "init_parameters.json", FirstPose(0, {"root_tx": 0.1, "index_mcp_flex": 0.3})
    )
    write_session_file(session / "session_everything.toml", EVERYTHING)
    pins = SessionPins(session, Session.open(session).rig)
    pins.write({0: [Pin("cam0", (20.5, 30.25), joint="index_tip"), Pin("cam1", (31.0, 22.0), bone="middle_metacarpal", point=(0.01, 0.02, 0.0))]})  # fmt: skip
    _take(session / "takes_store")
    write_npz(folder / "poses_2.npz", sample())
    batch = folder / "batch"
    batch.mkdir()
    for outcome in OUTCOMES:
        append(batch / "ledger.jsonl", outcome)


def _take(folder):
    """Write a store with one finished take: a folder that `tracks/` is in a session."""
    track = sample()
    first, last = int(track.frame[0]), int(track.frame[-1])
    about = TakeAbout(
        "handtrack track", "2026-01-01T00:00:00+00:00", (first, last + 1), track.labels, {"init.json": "5f0c21aa"},
        {"frame": first, "parameters": track.parameters[0].tolist()}, (first,), {"handtrack": "0.0"},
    )  # fmt: skip
    with WritableStore(folder, "handtrack track") as store:
        take = store.begin(about)
        for frame in track.frames():
            take.add(Step(frame, np.eye(len(frame.parameters))))
        take.finish()
        store.make_current([Span(1, first, last + 1)], "handtrack track")
        store.know_file("5be36c545ed450b44477e102644e4b27")


def copied(source: Path, folder: Path) -> Path:
    """Return a copy of the recorded session, in which its store stands where handtrack looks for it."""
    session = Path(shutil.copytree(source / "session", folder / "session"))
    (session / "takes_store").rename(session / layout.TRACKS_FOLDER)
    return session
