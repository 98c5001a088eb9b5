"""The commands of `handtrack`, run as a user would."""

from __future__ import annotations

import csv
import json
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from handtrack.capture.calibration.rig_file import read_rig
from handtrack.diagnostics.flexion import BENT_JOINTS
from handtrack.export.registry import FORMATS, export_format
from handtrack.model.articulated import keypoint_names
from handtrack.session.bundled import bundled_session
from handtrack.session.formats.tables import read_npz
from handtrack.session.session import Session
from handtrack_app import cli
from handtrack_app.commands import track as track_command
from tests.app.command_line import PROGRAM, CommandLine
from tests.session.small_session import edit

COMMANDS = ("open", "demo", "new", "track", "export", "evaluate", "simulate", "doctor", "bench")
METRICS = [
    "mpjpe_mm", "mpjpe_median_mm", "p95_mm", "max_mm", "mpjpe_tracked_mm", "pa_mpjpe_mm", "fingertip_mm",
    "pck_auc_50mm", "jitter_mm", "lost_frames", "coverage90", "finger_swaps",
    "flexion_deg", "flexion_offset_free_deg",
]  # fmt: skip
HEAVY = ("numpy", "cv2", "numba", "scipy", "viser", "rerun", "tqdm")


@pytest.fixture
def session(recorded: Path, tmp_path: Path) -> Path:
    """A small recording of its own for each test."""
    return Path(shutil.copytree(recorded, tmp_path / "session"))


# ---- help and usage --------------------------------------------------------------------------------


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_explains_itself(handtrack: CommandLine, command: str) -> None:
    ended = handtrack(command, "--help")
    assert ended.code == 0
    assert f"usage: handtrack {command}" in ended.out


def test_help_and_version(handtrack: CommandLine) -> None:
    ended = handtrack("--help")
    assert ended.code == 0
    for command in COMMANDS:
        assert f"\n    {command} " in ended.out
    version = handtrack("--version")
    assert version.code == 0
    assert version.out.startswith("handtrack ")


def test_help_loads_nothing_heavy() -> None:
    code = (
        "import sys; from handtrack_app.cli import main; main(['track', '--help']);"
        f"print([m for m in {HEAVY!r} if m in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=PROGRAM,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.splitlines()[-1] == "[]"


@pytest.mark.parametrize(
    "words",
    [["track"], ["track", "s", "--frame", "0:3"], ["--fast"], ["open", "--port", "x"]],
)
def test_wrong_usage_shows_the_usage(handtrack: CommandLine, words: list[str]) -> None:
    ended = handtrack(*words)
    assert ended.code == 2
    assert ended.err.startswith("usage: handtrack")
    assert "error:" in ended.err


def test_without_a_command_the_bundled_session_opens(handtrack: CommandLine, monkeypatch) -> None:
    opened = {}
    monkeypatch.setattr(
        "handtrack_app.workbench.run_workbench", lambda folder, **o: opened.update(o, folder=folder)
    )
    for words, demo in ([], False), (["demo", "--no-browser"], True):
        assert handtrack(*words).code == 0
        assert opened["folder"] == bundled_session()
        assert opened["demo"] is demo
        assert opened["host"] == "127.0.0.1"
    assert handtrack("open", bundled_session(), "--rerun").code == 0
    assert opened["rerun"] is True


def test_a_mistake_of_ours_is_told_as_one(handtrack: CommandLine, monkeypatch, session) -> None:
    def fail(*_: object) -> None:
        raise ZeroDivisionError("by zero")

    monkeypatch.setattr("handtrack_app.commands.doctor.Session.open", fail)
    ended = handtrack("doctor", session)
    assert ended.code == 1
    assert ended.err.startswith(
        "handtrack doctor: an error inside handtrack, not in your data: ZeroDivisionError: by zero. "
        "Please report it"
    )
    log = Path(ended.err.rsplit(" ", 1)[1].strip().rstrip("."))
    assert "Traceback" in log.read_text()
    log.unlink()


# ---- track, evaluate, export -----------------------------------------------------------------------


def test_simulate_track_evaluate_export(handtrack: CommandLine, session: Path) -> None:
    tracked = handtrack("track", session)
    assert tracked.code == 0
    poses = session / "tracks" / "poses.npz"
    assert (
        tracked.out == f"5 of 5 frames: 5 tracked, 0 of low confidence, 0 lost. Saved to {poses}\n"
    )
    assert "tracking: 100%" in tracked.err
    first = poses.read_bytes()

    shown = handtrack("evaluate", poses, "--truth", session / "truth.npz")
    said = [line.split()[0] for line in shown.out.splitlines() if line]
    assert said[: len(METRICS)] == METRICS
    assert said[-21:] == list(keypoint_names())
    metrics = json.loads(
        handtrack("evaluate", poses, "--truth", session / "truth.npz", "--json").out
    )
    assert [name for name in metrics if name in METRICS] == METRICS
    assert {f"flexion_{joint}_deg" for joint in BENT_JOINTS} < set(metrics)
    assert metrics["points_used"] == 5 * 21
    assert metrics["mpjpe_mm"] < 5
    assert metrics["lost_frames"] == 0

    told = handtrack("export", poses).out.splitlines()
    assert [line.split()[0] for line in told] == [known.name for known in FORMATS]
    for kind in ("csv", "csv-long", "npz", "keypoints", "bvh", "urdf", "mp4"):
        ended = handtrack("export", poses, "--to", kind)
        assert ended.code == 0, ended.err
        written = ended.out.split(" written to ")[1].split(", with")[0]
        assert Path(written.strip()) == poses.with_name(f"poses{export_format(kind).ending}")
    assert (
        handtrack("export", poses, "--to", "bvh", "--up=-y", "--out", session / "up.bvh").code == 0
    )
    refused = handtrack("export", poses, "--to", "bvh", "--up", "q", "--out", session / "up.bvh")
    assert refused.code == 2
    assert "no axis 'q' in --up; known: x, y, z, -x, -y, -z" in refused.err
    with (poses.parent / "poses.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["frame"] for row in rows] == list("01234")
    assert {"index_mcp_flex_deg", "root_tx_m", "index_tip_x_m"} <= set(rows[0])
    as_truth = handtrack(
        "evaluate", poses, "--truth", poses.parent / "poses_keypoints.npz", "--json"
    )
    assert json.loads(as_truth.out)["max_mm"] == 0

    again = handtrack("track", session, "--seed", 0)  # another is among the settings that are kept
    assert again.code == 0
    assert poses.read_bytes() == first
    kept = list((poses.parent / "versions").iterdir())
    assert [file.read_bytes() for file in kept] == [first]


def test_frames_out_settings_and_init(
    handtrack: CommandLine, session: Path, tmp_path: Path
) -> None:
    out = tmp_path / "new folder" / "result.npz"
    (session / "init.json").rename(tmp_path / "first.json")
    ended = handtrack(
        "track", session, "--init", tmp_path / "first.json", "--frames", "2:4", "--out", out, "--use",
        "silhouettes", "--set", "solver.iterations=7", "--set", "model.coupling=18",
    )  # fmt: skip
    assert ended.code == 0
    track = read_npz(out)
    assert track.frame.tolist() == [2, 3]
    settings = json.loads(track.settings)
    assert settings["solver.iterations"] == 7
    assert settings["keypoints.weight"] == 0
    assert settings["model.coupling"] == "18"
    assert track.parameters.shape == (2, 26)
    assert not (session / "tracks").exists()


def test_the_seed_is_a_setting_and_the_name_that_scripts_rely_on_is_read(
    handtrack: CommandLine, session: Path, tmp_path: Path
) -> None:
    out, file = tmp_path / "poses.npz", session / "session.toml"
    file.write_text(file.read_text() + "\n[tracking]\ntracker.jumps = false\n")
    words = ["track", session, "--frames", "0:1", "--out", out]
    ended = handtrack(*words, "--seed", 3, "--set", "cloud.crop_mm=99")
    assert ended.code == 0
    settings = json.loads(read_npz(out).settings)
    assert settings["tracker.seed"] == 3
    assert settings["tracker.recovery"] is False
    notes = [line for line in ended.err.splitlines() if line.startswith("note: ")]
    assert sum("cloud.crop_mm has no effect" in note for note in notes) == 1
    refused = handtrack(*words, "--seed", -1)
    assert refused.code == 2
    assert "'tracker.seed': expected a whole number of at least 0, found -1" in refused.err


def test_a_session_of_depth_alone(handtrack: CommandLine, data_dir: Path, tmp_path: Path) -> None:
    out = tmp_path / "poses.npz"
    session = data_dir / "sessions" / "webxr_depth_640"
    words = ["track", session, "--out", out, "--frames", "0:2", "--set", "model.fit_size=false"]
    assert handtrack(*words, "--use", "cloud").code == 0
    assert read_npz(out).status.tolist() == [0, 0]


def test_a_start_in_the_middle_is_tracked_both_ways(handtrack: CommandLine, session: Path) -> None:
    init = json.loads((session / "init.json").read_text())
    (session / "init.json").write_text(json.dumps(init | {"frame": 2}))
    assert handtrack("track", session).code == 0
    assert read_npz(session / "tracks/poses.npz").frame.tolist() == [0, 1, 2, 3, 4]


def test_the_searches_of_a_frame_are_explained(handtrack: CommandLine, session: Path) -> None:
    ended = handtrack("track", session, "--frames", "0:2", "--explain", "1")
    assert ended.code == 0
    lines = ended.out.splitlines()
    assert lines[1].startswith("frame 1: ")
    assert "- a finger may be lost (one of the first 3 frames)" in lines
    assert lines[-1].startswith("result: tracked, energy ")
    outside = handtrack("track", session, "--frames", "0:2", "--explain", "4")
    assert outside.code == 2
    assert "--explain 4: expected one of the frames that are tracked, 0 to 1." in outside.err


def test_track_tells_how_it_went_as_json(handtrack: CommandLine, session: Path) -> None:
    ended = handtrack(
        "track", session, "--frames", "0:2", "--set", "cloud.crop_mm=99", "--explain", "1", "--json"
    )  # fmt: skip
    assert ended.code == 0
    told = json.loads(ended.out)
    assert list(told) == ["frames", "seconds", "warnings", "output"]
    assert told["frames"] == {
        "tracked": 2, "doubtful": 0, "lost": 0, "keyframe": 0,
    }  # fmt: skip
    assert told["seconds"] > 0
    assert any("cloud.crop_mm has no effect" in text for text in told["warnings"])
    assert Path(told["output"]) == session / "tracks/poses.npz"
    assert "result: tracked, energy " in ended.err


def test_the_size_fit_and_compiling_are_told(
    handtrack: CommandLine, session: Path, monkeypatch
) -> None:
    from numba.core import event

    def compile_something() -> bool:
        ours = {"dispatcher": SimpleNamespace(py_func=track_command.run)}
        with (
            event.trigger_event("numba:compile", data=ours),
            event.trigger_event("numba:compile", data=ours),
        ):
            return True

    monkeypatch.setattr(
        track_command.TrackingRun, "fit_size", lambda run, stop, tell: (compile_something(), run)[1]
    )
    edit(session / "session.toml", "scale = 1.0", 'scale = "fit"')
    ended = handtrack("track", session)
    assert ended.code == 0
    assert ended.err.startswith("fitting the hand's size …\ncompiling kernels for this machine")
    assert ended.err.count("compiling") == 1


def test_a_disk_that_fills_up_does_not_cost_the_result(
    handtrack: CommandLine, session: Path, monkeypatch
) -> None:
    write = track_command.write_result

    def full(path: Path, track) -> None:
        if path.is_relative_to(session):
            raise OSError(28, "No space left on device")
        write(path, track)

    monkeypatch.setattr(track_command, "write_result", full)
    ended = handtrack("track", session, "--frames", ":2")
    assert ended.code == 2
    saved = Path(ended.out.split("Saved to ")[1].strip())
    assert read_npz(saved).frame.tolist() == [0, 1]
    assert f"writing failed (No space left on device); the result is in {saved}" in ended.err
    shutil.rmtree(saved.parent)


# ---- new, simulate, doctor, bench ------------------------------------------------------------------


def test_new_makes_a_session_that_opens(handtrack: CommandLine, tmp_path: Path) -> None:
    source = bundled_session()
    out = tmp_path / "made"
    out.mkdir()  # empty: fine
    words = ["new", "--out", out, "--calibration", source / "calibration.toml", "--side", "left"]
    ended = handtrack(
        *words,
        "--video",
        f"cam1={source / 'cam1.mp4'}",
        "--video",
        f"cam0={source / 'cam0.mp4'}",
    )
    assert ended.code == 0
    assert f"session of 2 cameras and 100 frames of a hand in {out}" in ended.out
    assert sorted(path.name for path in out.iterdir()) == [
        "calibration.toml",
        "cam0.mp4",
        "cam1.mp4",
        "session.toml",
    ]
    session = Session.open(out)
    assert session.camera_names == ("cam1", "cam0")
    assert (session.name, session.fps, session.file.hand.side) == ("made", 25.0, "left")
    assert session.mask("cam0", 0) is not None
    assert list(tmp_path.iterdir()) == [out]


def test_new_without_masks_and_with_another_rate(handtrack: CommandLine, tmp_path: Path) -> None:
    source = bundled_session()
    video = f"cam0={source / 'cam0.mp4'}"
    ended = handtrack(
        "new", "--out", tmp_path / "a/b", "--calibration", source / "calibration.toml", "--video", video,
        "--masks", "none", "--fps", 50, "--name", "mine", "--world-unit-m", 0.001,
    )  # fmt: skip
    assert ended.code == 0
    file = Session.open(tmp_path / "a/b").file
    assert file.cameras[0].masks is None
    assert (file.session.name, file.session.fps, file.session.world_unit_m) == ("mine", 50.0, 1.0)
    given, written = (
        Session.open(source).rig["cam0"],
        read_rig(tmp_path / "a/b/calibration.toml")["cam0"],
    )
    assert np.allclose(written.translation, 0.001 * given.translation, rtol=0, atol=1e-12)


def test_simulate_is_the_same_for_the_same_seed(handtrack: CommandLine, tmp_path: Path) -> None:
    for name, seed in ("a", 4), ("b", 4), ("c", 5):
        words = [
            "simulate",
            "--out",
            tmp_path / name,
            "--frames",
            2,
            "--cameras",
            1,
            "--size",
            64,
            48,
        ]
        assert handtrack(*words, "--no-images", "--seed", seed).code == 0
    truth = {name: np.load(tmp_path / name / "truth.npz")["keypoints21"] for name in "abc"}
    np.testing.assert_array_equal(truth["a"], truth["b"])
    assert (truth["a"] != truth["c"]).any()


def test_doctor_lists_the_gravest_first(handtrack: CommandLine, session: Path) -> None:
    ended = handtrack("doctor", session)
    assert ended.code == 0
    assert "nothing odd was found" in ended.out.splitlines()[-1]
    (session / "masks/cam0/000003.png").unlink()
    lines = handtrack("doctor", session).out.splitlines()
    assert lines[0].startswith("warning: camera 'cam0'")
    assert lines[-1].endswith("1 warning.")


def test_bench_prints_tables_and_json(handtrack: CommandLine, monkeypatch) -> None:
    figures = {"ratio": 0.25, "ours_ms": 1.0, "reference_ms": 4.0, "reference": "invented"}
    monkeypatch.setattr(
        "handtrack.bench.silhouette_speed.silhouette_iteration_vs_blas", lambda: figures
    )
    name = "silhouette_iteration_vs_blas"
    assert json.loads(handtrack("bench", name, "--json").out) == {name: figures}
    shown = handtrack("bench", name).out
    assert shown.startswith(f"{name}\n  ratio")
    assert "0.25" in shown


def test_main_returns_what_the_program_exits_with(monkeypatch) -> None:
    monkeypatch.setattr(sys, "argv", ["handtrack", "--help"])
    assert cli.main() == 0


def test_a_misspelled_command_is_refused_with_the_one_that_may_be_meant(
    handtrack: CommandLine,
) -> None:
    ended = handtrack("trak", "session")
    assert ended.code == 2
    assert ended.out == ""
    assert "trak" in ended.err
    assert "'track'" in ended.err
