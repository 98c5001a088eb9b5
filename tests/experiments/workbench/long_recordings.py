"""The workbench over a recording of any length: what it takes to open, to show a frame, to edit one, and the memory."""

from __future__ import annotations

import os
import tempfile
import time
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
from handtrack.session.takes import about_take
from handtrack.store.store import Span, WritableStore
from tests.experiments.workbench.hostile import latencies_ms, pose_sliders
from tests.experiments.workbench.program import RunningWorkbench
from tests.experiments.workbench.wire import WireClient

_SHOWN, _EDITED, _WALKED = 40, 20, 1_000
_STEP_S, _WRITTEN_S = 0.5, 2.0  # until a shown frame's pictures are there; until an edit is written
_LONGEST_S = 120.0
_QUIET = 0.15  # of a core: nothing goes on any more


def opened(count: int, truth: bool) -> dict[str, float]:
    """Return figures of the workbench over so many tracked frames, from the program's start on."""
    with tempfile.TemporaryDirectory() as name:
        folder = _make_recording(Path(name), count, truth)
        begun = time.monotonic()
        with RunningWorkbench(name) as program, WireClient(program.url) as client:
            _wait_for_timeline(client)
            figures = {"opened_s": time.monotonic() - begun, "opened_cpu_s": program.cpu_s()}
            figures["quiet_cpu_s"] = _until_quiet(program)
            frame, images = (
                next(one for one in client.widgets() if one["props"].get("label") == label)
                for label in ("Frame", "Live images")
            )
            figures["shown_bytes_with_pictures"] = _shown(client, frame["uuid"], count)[1]
            client.set_value(images["uuid"], False)
            time.sleep(_WRITTEN_S)
            figures["shown_ms"], figures["shown_bytes"] = _shown(client, frame["uuid"], count)
            figures |= _edited(client, folder)
            for turn in ("once", "twice"):
                for at in range(_WALKED):
                    client.set_value(frame["uuid"], at)
                    time.sleep(0.01)
                _until_quiet(program)
                figures[f"memory_mb_walked_{turn}"] = program.resident_mb()
    return figures


def _wait_for_timeline(client: WireClient) -> None:
    """Wait until the recording is shown at a glance: from then on it can be worked in."""
    until = time.monotonic() + _LONGEST_S
    while time.monotonic() < until:
        for _, message in list(client.messages):
            made = {**message.get("props", {}), **message.get("updates", {})}
            if "handtrack-timeline" in str(made.get("content", "")):
                return
        time.sleep(0.02)


def _until_quiet(program: RunningWorkbench) -> float:
    """Wait until the program rests; return its processor time until then [s]."""
    before, until = program.cpu_s(), time.monotonic() + _LONGEST_S
    while time.monotonic() < until:
        time.sleep(1.0)
        now = program.cpu_s()
        if now - before < _QUIET:
            return now
        before = now
    return before


def _shown(client: WireClient, slider: str, count: int) -> tuple[float, float]:
    """Return how long it takes until another frame is shown [ms], and the bytes that it sends to the page."""
    before, waits = client.bytes_taken, list[float]()
    for n in range(1, _SHOWN + 1):
        sent = client.set_value(slider, n * 23 % count)
        came = client.wait_for(sent, "/hand/flesh", "batched_positions")
        waits.append(1e3 * (came - sent) if came is not None else float("inf"))
        time.sleep(_STEP_S)
    return float(np.median(waits)), (client.bytes_taken - before) / _SHOWN


def _edited(client: WireClient, folder: Path) -> dict[str, float]:
    """Return what a pose set by hand writes, and how long it takes until the hand has moved."""
    slider, before = pose_sliders(client)[3], _size(folder)
    waits = []
    for _ in range(_EDITED):
        waits += latencies_ms(client, slider, 1)
        time.sleep(_WRITTEN_S)
    return {
        "edit_ms": float(np.median(waits)),
        "edit_bytes_written": (_size(folder) - before) / _EDITED,
    }


def _size(folder: Path) -> int:
    return sum(os.stat(path).st_size for path in (folder / "tracks").rglob("*.log"))


# ---- The recording, tracked already: two small cameras, masks that come round every four seconds

_CAMERAS = ("cam0", "cam1")


def _make_recording(folder: Path, count: int, truth: bool) -> Path:
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
