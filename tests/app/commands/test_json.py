"""`--json` on every command: one object on stdout, whatever else is said."""

import json
import os
import subprocess

import pytest

from handtrack import write_npz
from tests.app.command_line import CommandLine, small_recording
from tests.conftest import REPOSITORY
from tests.sample_track import hand_track

SLURM = REPOSITORY / "docs" / "cluster" / "slurm_array.sh"


def test_what_is_printed_is_one_object(tmp_path, capsys):
    handtrack = CommandLine(capsys)
    write_npz(tmp_path / "poses.npz", hand_track())
    small_recording(tmp_path / "take")
    for words, key in (
        (["doctor", tmp_path / "take"], "findings"),
        (["board", "--board", "chessboard:9x6:25mm", "--out", tmp_path / "b.svg"], "page_mm"),
        (["simulate", "--out", tmp_path / "s", "--frames", 1, "--cameras", 1, "--size", 64, 48], "session"),
    ):  # fmt: skip
        ended = handtrack.does(*words, "--json")
        assert key in json.loads(ended.out)


@pytest.mark.skipif(os.name != "posix", reason="a shell script")
def test_the_slurm_script_tracks_the_recording_of_its_number(tmp_path):
    (tmp_path / "list.txt").write_text("/data/take a\n/data/take b\n")
    program = tmp_path / "handtrack"
    program.write_text('#!/bin/bash\nprintf "%s|" "$@" "$HANDTRACK_THREADS"\n')
    program.chmod(0o755)
    environment = os.environ | {"PATH": f"{tmp_path}:{os.environ['PATH']}", "SLURM_ARRAY_TASK_ID": "2", "SLURM_CPUS_PER_TASK": "3", "HOME": str(tmp_path)}  # fmt: skip
    done = subprocess.run(["bash", SLURM, tmp_path / "list.txt", "/out"], env=environment, capture_output=True, text=True, check=True)  # fmt: skip
    assert done.stdout == "batch|/data/take b|--resume|--out|/out|3|"
