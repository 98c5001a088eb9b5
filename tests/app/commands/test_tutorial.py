"""The tutorial runs word for word, on its own material; here of fewer frames, unless HANDTRACK_TUTORIAL is set."""

import os
import re
import shlex
import shutil

import pytest

from handtrack.session import bundled
from handtrack.simulation.simulate import Simulation, simulate
from tests.app.command_line import CommandLine
from tests.conftest import REPOSITORY

WHOLE = "HANDTRACK_TUTORIAL" in os.environ
FRAMES = 3
PAGE = REPOSITORY / "docs" / "start" / "hand.md"
SERVERS = ("open", "demo", "start")
"""they wait for a person in the browser"""


def lines() -> list[list[str]]:
    """Return the shell lines of the tutorial, in their order."""
    blocks = re.findall(r"^```sh\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)  # fmt: skip
    return [shlex.split(line, comments=True) for body in blocks for line in body.splitlines()]


def shortened(words: list[str]) -> list[str]:
    """Return a line whose frames are among the few that there are."""
    numbers = {"--frames": f"0:{FRAMES}", "--rerun-frame": "1", "--count": "3"}
    before = [None, *words]
    short = [numbers.get(str(option), word) for option, word in zip(before, words, strict=False)]
    return short if words[1] != "simulate" else [*words[:4], "--cameras", "1", "--frames", "1"]


@pytest.fixture
def short_material(tmp_path_factory, monkeypatch):
    """The bundled recording is one of a few frames."""
    if WHOLE:
        return
    shelf = tmp_path_factory.mktemp("shelf")
    simulate(shelf / "another_hand", Simulation(frames=FRAMES, size=(160, 120)))
    monkeypatch.setattr(bundled, "_CHECKOUT", shelf)
    monkeypatch.setattr(bundled, "_INSTALLED", shelf / "none")


def test_every_command_of_the_tutorial_runs(tmp_path, monkeypatch, capsys, short_material):
    monkeypatch.chdir(tmp_path)
    handtrack, ran = CommandLine(capsys), []
    for words in lines():
        if words[0] == "cp":
            shutil.copyfile(words[1], words[2])
        elif words[1] not in SERVERS:
            ended = handtrack(*(words if WHOLE else shortened(words))[1:])
            assert ended.code == 0, f"{shlex.join(words)}\n{ended.err}"
            ran.append(words[1])
    assert {"sample", "new", "doctor", "track", "export", "evaluate", "simulate"} <= {*ran}


def test_samples_are_files_of_ones_own(tmp_path, capsys):
    handtrack = CommandLine(capsys)
    handtrack.does("sample", "open_fist_open", "--to", tmp_path / "mine")
    assert (tmp_path / "mine" / "masks" / "cam0" / "000000.png").is_file()
    again = handtrack("sample", "open_fist_open", "--to", tmp_path / "mine")
    assert (again.code, "is not empty" in again.err) == (2, True)
    other = handtrack("sample", "three_videos", "--to", tmp_path / "other")
    assert other.code == 2
    assert bundled.sample_names() == ("another_hand", "open_fist_open", "two_videos")
