"""The commands of `handtrack`, run as a user would; `--json` and `--landmarks`."""

import json
import os
import shutil
import subprocess
from pathlib import Path

import pytest

from handtrack import bundled_session, read_npz, write_npz
from handtrack.session.bundled import demo_session
from handtrack_app.commands import track as track_command
from tests.conftest import REPOSITORY
from tests.export.sequences import sample_sequence
from tests.golden.meaning import numbers, unlike_recorded
from tests.golden.results import RESULTS
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
    assert "Did you mean 'track'?" in handtrack("trak").err


def test_a_mistake_of_ours_is_told_as_one(handtrack, monkeypatch, session):
    def fail(*_):
        raise ZeroDivisionError("by zero")

    monkeypatch.setattr("handtrack_app.commands.checks.Session.open", fail)
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


def test_track_evaluate_export(handtrack, done):
    poses = done / "tracks" / "poses.npz"
    first = poses.read_bytes()

    asked = ("evaluate", poses, "--json", "--truth")
    metrics = json.loads(handtrack(*asked, done / "truth.npz").out)
    assert metrics["points_used"] == 5 * 21
    assert metrics["mpjpe_mm"] < 5
    assert metrics["lost_frames"] == 0

    handtrack.does("export", poses, "--to", "keypoints")
    as_truth = handtrack(*asked, poses.parent / "poses_keypoints.npz")
    assert json.loads(as_truth.out)["max_mm"] == 0

    handtrack.does("track", done, "--seed", 0)
    assert poses.read_bytes() == first
    (kept,) = (poses.parent / "versions").iterdir()
    assert kept.read_bytes() == first


def test_options_of_track_are_followed_and_told_as_json(handtrack, session, tmp_path):
    out = tmp_path / "new folder" / "result.npz"
    (session / "init.json").rename(tmp_path / "first.json")
    edit(session / "session.toml", "tracker.recovery", "tracker.jumps")  # as scripts rely on
    idle = "cloud.crop_mm has no effect"
    ended = handtrack.does(
        "track", session, "--init", tmp_path / "first.json", "--frames", "2:4", "--out", out, "--use", "silhouettes",
        "--set", "solver.iterations=7", "--set", "model.coupling=18", "--set", "cloud.crop_mm=99", "--seed", 3,
        "--explain", "2", "--json",
    )  # fmt: skip
    told = json.loads(ended.out)
    assert list(told) == ["frames", "seconds", "warnings", "output"]
    assert told["frames"] == {"tracked": 2, "doubtful": 0, "lost": 0, "keyframe": 0}
    assert any(idle in text for text in told["warnings"])
    notes = [line for line in ended.err.splitlines() if line.startswith("note: ")]
    assert sum(idle in note for note in notes) == 1
    assert Path(told["output"]) == out and not (session / "tracks").exists()
    track = read_npz(out)
    assert track.frame.tolist() == [2, 3] and track.parameters.shape == (2, 26)
    settings = json.loads(track.settings)
    names = "solver.iterations keypoints.weight model.coupling tracker.seed tracker.recovery"
    assert [settings[name] for name in names.split()] == [7, 0, "18", 3, False]


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


def test_numbers_that_commands_tell_are_what_they_were(handtrack, session):
    for words in (("bench", "jump_tree_1024"), ("doctor", session)):
        json.loads(handtrack.does(*words, "--json").out)
    said = {}
    for words in (
        ("evaluate", RESULTS / "masks.npz", "--truth", RESULTS / "joints.npz"),
        ("spread", RESULTS / "masks.npz"),
        ("model", "check", REPOSITORY / "handtrack/model/definitions/body34.toml"),
    ):  # fmt: skip
        for more in ([], ["--json"]):
            told = handtrack.does(*words, *more).out
            assert not more or json.loads(told)
            said[f"{words[0]} {more}"] = numbers(told)
    assert not unlike_recorded("printed", said)


@pytest.mark.skipif(os.name != "posix", reason="a shell script")
def test_the_slurm_script_tracks_the_recording_of_its_number(tmp_path):
    (tmp_path / "list.txt").write_text("/data/take a\n/data/take b\n")
    program = tmp_path / "handtrack"
    program.write_text('#!/bin/bash\nprintf "%s|" "$@" "$HANDTRACK_THREADS"\n')
    program.chmod(0o755)
    environment = os.environ | {"PATH": f"{tmp_path}:{os.environ['PATH']}", "SLURM_ARRAY_TASK_ID": "2", "SLURM_CPUS_PER_TASK": "3", "HOME": str(tmp_path)}  # fmt: skip
    done = subprocess.run(["bash", REPOSITORY / "docs/cluster/slurm_array.sh", tmp_path / "list.txt", "/out"], env=environment, capture_output=True, text=True, check=True)  # fmt: skip
    assert done.stdout == "batch|/data/take b|--resume|--out|/out|3|"


def test_what_is_compared_is_what_the_truth_says_or_what_is_asked_for(handtrack, tmp_path):
    poses = tmp_path / "poses.npz"
    write_npz(poses, sample_sequence("left")[1])
    for of_truth, *asked in (("joints",), ("surface21",), ("surface21", "--landmarks", "joints")):
        truth = tmp_path / f"{of_truth}.npz"
        handtrack("export", poses, "--to", "keypoints", "--out", truth, "--landmarks", of_truth)
        ended = handtrack.does("evaluate", poses, "--truth", truth, "--json", *asked)
        found = json.loads(ended.out)
        assert (found["mpjpe_mm"] < 1e-6) == (not asked)
        assert found["keypoint_definition"] == [of_truth, *asked][-1]
