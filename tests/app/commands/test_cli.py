"""The commands of `handtrack`, run as a user would."""

import csv
import json
import shutil
import subprocess
from pathlib import Path

import pytest

from handtrack import Session, bundled_session, read_npz
from handtrack.diagnostics.flexion import BENT_JOINTS
from handtrack.export.registry import export_format
from handtrack.session.bundled import demo_session
from handtrack_app.commands import track as track_command
from tests.session.small_session import edit


def test_without_a_command_the_bundled_session_opens(handtrack, monkeypatch):
    opened = {}
    monkeypatch.setattr(
        "handtrack_app.workbench.run_workbench",
        lambda plan, _child, host, _port, _browser, demo, _token: opened.update(
            vars(plan), host=host, demo=demo
        ),
    )
    for words, demo in ([], False), (["demo", "--no-browser"], True):
        handtrack.does(*words)
        assert opened["folder"] == (demo_session() if demo else bundled_session())
        assert opened["demo"] is demo
        assert opened["host"] == "127.0.0.1"
    handtrack.does("open", bundled_session(), "--rerun")
    assert opened["rerun"] is True


def test_a_mistake_of_ours_is_told_as_one(handtrack, monkeypatch, session):
    def fail(*_):
        raise ZeroDivisionError("by zero")

    monkeypatch.setattr("handtrack_app.commands.doctor.Session.open", fail)
    ended = handtrack("doctor", session)
    assert ended.code == 1
    log = Path(ended.err.rsplit(" ", 1)[1].strip().rstrip("."))
    assert "Traceback" in log.read_text()
    log.unlink()


def test_bash_completes_commands_options_choices_and_files(handtrack, tmp_path):
    pytest.importorskip("shtab")
    (tmp_path / "bash").write_text(handtrack.does("completion", "bash").out)
    (tmp_path / "recording").mkdir()

    def completed(*words):
        line = f"COMP_WORDS=({' '.join(words)}); COMP_CWORD={len(words) - 1}; _shtab_handtrack"
        script = f'source ./bash; {line}; echo "${{COMPREPLY[@]}}"'
        ended = subprocess.run(
            ["bash", "-c", script], check=False, cwd=tmp_path, capture_output=True, text=True
        )
        return ended.stdout.split()

    assert completed("handtrack", "tra") == ["track"]
    assert completed("handtrack", "track", "--se") == ["--set", "--seed"]
    assert "seeded" in completed("handtrack", "new", "--masks", "s")
    assert completed("handtrack", "track", "rec") == ["recording"]


# ---- track, evaluate, export -----------------------------------------------------------------------


def test_track_evaluate_export(handtrack, session):
    handtrack.does("track", session)
    poses = session / "tracks" / "poses.npz"
    first = poses.read_bytes()

    asked = ("evaluate", poses, "--json", "--truth")
    metrics = json.loads(handtrack(*asked, session / "truth.npz").out)
    assert {f"flexion_{joint}_deg" for joint in BENT_JOINTS} < set(metrics)
    assert metrics["points_used"] == 5 * 21
    assert metrics["mpjpe_mm"] < 5
    assert metrics["lost_frames"] == 0

    for kind in ("csv", "csv-long", "npz", "keypoints", "bvh", "urdf", "mp4"):
        handtrack.does("export", poses, "--to", kind)
        assert poses.with_name(f"poses{export_format(kind).ending}").exists()
    with (poses.parent / "poses.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["frame"] for row in rows] == list("01234")
    assert {"index_mcp_flex_deg", "root_tx_m", "index_tip_x_m"} <= set(rows[0])
    as_truth = handtrack(*asked, poses.parent / "poses_keypoints.npz")
    assert json.loads(as_truth.out)["max_mm"] == 0

    handtrack.does("track", session, "--seed", 0)
    assert poses.read_bytes() == first
    (kept,) = (poses.parent / "versions").iterdir()
    assert kept.read_bytes() == first


def test_frames_out_settings_and_init(handtrack, session, tmp_path):
    out = tmp_path / "new folder" / "result.npz"
    (session / "init.json").rename(tmp_path / "first.json")
    handtrack.does(
        "track", session, "--init", tmp_path / "first.json", "--frames", "2:4", "--out", out, "--use",
        "silhouettes", "--set", "solver.iterations=7", "--set", "model.coupling=18",
    )  # fmt: skip
    track = read_npz(out)
    assert track.frame.tolist() == [2, 3]
    settings = json.loads(track.settings)
    assert settings["solver.iterations"] == 7
    assert settings["keypoints.weight"] == 0
    assert settings["model.coupling"] == "18"
    assert track.parameters.shape == (2, 26)
    assert not (session / "tracks").exists()


def test_the_seed_is_a_setting_and_the_name_that_scripts_rely_on_is_read(
    handtrack, session, tmp_path
):
    out, file = tmp_path / "poses.npz", session / "session.toml"
    edit(file, "tracker.recovery", "tracker.jumps")
    words = ["track", session, "--frames", "0:1", "--out", out]
    ended = handtrack.does(*words, "--seed", 3, "--set", "cloud.crop_mm=99")
    settings = json.loads(read_npz(out).settings)
    assert settings["tracker.seed"] == 3
    assert settings["tracker.recovery"] is False
    notes = [line for line in ended.err.splitlines() if line.startswith("note: ")]
    assert sum("cloud.crop_mm has no effect" in note for note in notes) == 1


def test_track_tells_how_it_went_as_json(handtrack, session):
    ended = handtrack.does(
        "track", session, "--frames", "0:2", "--set", "cloud.crop_mm=99", "--explain", "1", "--json"
    )  # fmt: skip
    told = json.loads(ended.out)
    assert list(told) == ["frames", "seconds", "warnings", "output"]
    assert told["frames"] == {
        "tracked": 2, "doubtful": 0, "lost": 0, "keyframe": 0,
    }  # fmt: skip
    assert told["seconds"] > 0
    assert any("cloud.crop_mm has no effect" in text for text in told["warnings"])
    assert Path(told["output"]) == session / "tracks/poses.npz"


def test_a_disk_that_fills_up_does_not_cost_the_result(handtrack, session, monkeypatch):
    write = track_command.write_result

    def full(path, track):
        if path.is_relative_to(session):
            raise OSError(28, "No space left on device")
        write(path, track)

    monkeypatch.setattr(track_command, "write_result", full)
    ended = handtrack("track", session, "--frames", ":2")
    assert ended.code == 2
    saved = Path(ended.out.split("Saved to ")[1].strip())
    assert read_npz(saved).frame.tolist() == [0, 1]
    shutil.rmtree(saved.parent)


# ---- new, simulate, doctor, bench ------------------------------------------------------------------


def test_new_makes_a_session_that_opens(handtrack, tmp_path):
    source = bundled_session()
    out = tmp_path / "made"
    out.mkdir()  # empty: fine
    words = ["new", "--out", out, "--calibration", source / "calibration.toml", "--side", "left"]
    videos = [w for n in (1, 0) for w in ("--video", f"cam{n}={source / f'cam{n}.mp4'}")]
    handtrack.does(*words, *videos)
    assert {path.name for path in out.iterdir()} == {
        *("calibration.toml", "cam0.mp4", "cam1.mp4", "session.toml")
    }
    session = Session.open(out)
    assert session.camera_names == ("cam1", "cam0")
    assert (session.name, session.fps, session.file.hand.side) == ("made", 25.0, "left")
    assert session.mask("cam0", 0) is not None
    assert list(tmp_path.iterdir()) == [out]
