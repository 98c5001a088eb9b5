"""A folder that cannot be written, and a program that may open no more files: one sentence each, and nothing lost."""

import ctypes
import json
import os
import shutil
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.app.command_line import PROGRAM, listing
from tests.session.test_hostile_sessions import contains

resource = pytest.importorskip("resource", reason="this system has no such limits")
_PR_CAPBSET_DROP, _CAP_DAC_OVERRIDE = 24, 1


@contextmanager
def no_more_files():
    """Let this process open no file any more."""
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    free = os.dup(0)
    os.close(free)
    resource.setrlimit(resource.RLIMIT_NOFILE, (free, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, before)


def test_c61_track_says_so_and_goes_on_later(handtrack, tracked, tmp_path):
    session = Path(
        shutil.copytree(tracked, tmp_path / "s", ignore=shutil.ignore_patterns("tracks"))
    )
    with no_more_files():
        ended = handtrack("track", session)
    assert ended.code == 2
    contains(ended.err, "Too many open files", "ulimit -n")
    assert ended.err.count("\n") == 1
    handtrack.does("track", session)
    assert (session / "tracks/poses.npz").read_bytes() == (
        tracked / "tracks/poses.npz"
    ).read_bytes()


DRIVER = """
import contextlib, io, json, sys
from handtrack_app.cli import main
ended = []
for words in json.loads(sys.argv[1]):
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(words)
    ended.append((code, out.getvalue(), err.getvalue()))
print(json.dumps(ended))
"""
"""runs commands, and prints how each ended"""


def obey():
    """Keep to the rights of files and folders, as who is no administrator must."""
    if os.geteuid() == 0:
        ctypes.CDLL(None).prctl(_PR_CAPBSET_DROP, _CAP_DAC_OVERRIDE, 0, 0, 0)


@pytest.fixture
def read_only(tracked, tmp_path):
    """A tracked session that cannot be written."""
    session = Path(shutil.copytree(tracked, tmp_path / "session"))
    everything = [session, *session.rglob("*")]
    for path in everything:
        path.chmod(0o555 if path.is_dir() else 0o444)
    trial = [sys.executable, "-c", f"open({str(session / 'x')!r}, 'w')"]
    if not subprocess.run(trial, check=False, capture_output=True, preexec_fn=obey).returncode:
        pytest.skip("here rights of a folder keep nobody from writing")
    yield session
    for path in everything:
        path.chmod(0o755)


def test_c55_a_read_only_folder_is_told_in_one_sentence(read_only, tmp_path):
    poses, out, before = read_only / "tracks/poses.npz", tmp_path / "poses.npz", listing(read_only)
    refused = (
        ["track", read_only],
        ["export", poses, "--to", "csv"],
        ["takes", read_only, "--restore", "1"],
    )
    lines = [*refused, ["doctor", read_only], ["track", read_only, "--out", out]]
    words = json.dumps([[str(word) for word in line] for line in lines])
    program = [sys.executable, "-c", DRIVER, words]
    child = subprocess.run(
        program, check=True, capture_output=True, text=True, env=PROGRAM, preexec_fn=obey
    )
    ended = json.loads(child.stdout)
    for code, _, told in ended[: len(refused)]:
        assert code == 2
        contains(told, "cannot be written", "Permission denied")
        assert told.count("\n") == 1
    assert ended[3][1].endswith("nothing odd was found.\n")
    assert ended[4][0] == 0
    assert out.read_bytes() == poses.read_bytes()
    assert listing(read_only) == before
