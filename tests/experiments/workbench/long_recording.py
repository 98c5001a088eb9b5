"""A recording of any length, tracked already: two small cameras, masks that come round every four seconds."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np

from handtrack import (
    ArticulatedModel,
    FrameResult,
    Session,
    TrackerState,
    TrackingRun,
    bundled_session,
)
from handtrack.session.takes.take_about import about_take
from handtrack.store.spans import Span
from handtrack.store.store import WritableStore

_CAMERAS = ("cam0", "cam1")


def make_recording(folder: Path, count: int, truth: bool) -> Path:
    """Write the session of so many frames, and a take of them all that is the current track. truth: with a truth.npz."""
    source = bundled_session("open_fist_open")
    cameras = "".join(
        f'[[camera]]\nname = "{name}"\nmasks = "masks/{name}/*.png"\n' for name in _CAMERAS
    )
    said = (source / "session.toml").read_text("utf-8").partition("[[camera]]")[0]
    (folder / "session.toml").write_text(said + cameras, "utf-8")
    for name in ("calibration.toml", "init.json"):
        (folder / name).write_bytes((source / name).read_bytes())
    for name in _CAMERAS:
        masks = folder / "masks" / name
        masks.mkdir(parents=True)
        given = sorted((source / "masks" / name).iterdir())[:count]
        for frame, path in enumerate(given):
            (masks / f"{frame:06d}.png").write_bytes(path.read_bytes())
        for frame in range(len(given), count):
            os.link(masks / f"{frame % len(given):06d}.png", masks / f"{frame:06d}.png")
    run = TrackingRun.open(Session.open(folder), {"model.fit_size": False})
    start, params = run.initial()
    _, result = run.tracker.step(TrackerState.beginning_at(params), run.observation(start))
    if truth:
        _write_truth(folder, result, count)
    with WritableStore(folder / "tracks", "handtrack bench") as store:
        take = store.begin(about_take(run, "handtrack bench", range(count), start, params))
        for frame in range(count):
            take.replace(_at(run.model, result, frame))
        take.finish()
        store.make_current([Span(take.take.number, 0, count)])
    return folder


def _at(model: ArticulatedModel, result: FrameResult, frame: int) -> FrameResult:
    """Return a frame of a hand that opens and closes."""
    values = result.parameters.copy()
    values[6:] += 0.2 * np.sin(frame / 7)
    values = model.joint_params(model.clipped(model.transform.solver_params(values)))
    bones = model.bones(model.transform.solver_params(values))
    return replace(
        result,
        frame=frame,
        time_s=frame / 25,
        parameters=values,
        T_world_bone=bones.T_world_bone,
        joint_positions=model.joint_positions(bones),
        keypoints21=model.keypoints21(bones),
    )


def _write_truth(folder: Path, result: FrameResult, count: int) -> None:
    assert result.keypoints21 is not None
    moved = 1e-3 * np.random.default_rng(0).normal(size=(count, 21, 3))
    np.savez_compressed(folder / "truth.npz", keypoints21=result.keypoints21 + moved)
