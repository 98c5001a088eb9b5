"""The commands of the documentation run word for word, on small material; the tutorial on its own, if HANDTRACK_TUTORIAL is set."""

import os
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest

from handtrack import Session, read_npz
from handtrack.model.model_file import read_scale
from handtrack.session import bundled
from handtrack.simulation.simulate import Simulation, simulate
from tests.app.commands.test_new_joints import project
from tests.capture.joints.people import names, places
from tests.capture.sample_files import sample
from tests.conftest import REPOSITORY
from tests.test_docs import blocks

WHOLE = "HANDTRACK_TUTORIAL" in os.environ
FRAMES = 3
DOCS = REPOSITORY / "docs"
SERVERS = ("open", "demo")
"""they wait for a person in the browser"""


def lines(page):
    found = (line for body in blocks(DOCS / page, "sh") for line in body.splitlines())
    return [words for line in found if (words := shlex.split(line, comments=True))]


def shortened(words):
    """Return a line whose frames are among the few that there are, and that searches for no lost finger."""
    if words[0] == "simulate":
        return [*words[:3], "--cameras", "1", "--frames", "1"]
    if words[0] == "track":
        return [*words, *(f"--set=tracker.{search}=false" for search in ("recovery", "escape"))]
    numbers = {"--frames": f"0:{FRAMES}", "--rerun-frame": "1", "--count": "3"}
    return [numbers.get(option, word) for option, word in zip(["", *words], words, strict=False)]


def test_every_command_of_the_tutorial_runs(handtrack, tmp_path, monkeypatch):
    if not WHOLE:  # the bundled recording is one of a few frames
        shelf = tmp_path / "shelf"
        simulate(shelf / "another_hand", Simulation(frames=FRAMES, size=(160, 120)))
        monkeypatch.setattr(bundled, "_CHECKOUT", shelf)
        monkeypatch.setattr(bundled, "_INSTALLED", shelf / "none")
    monkeypatch.chdir(tmp_path)
    ran = set()
    for program, *words in lines("start/hand.md"):
        if program == "cp":
            shutil.copyfile(*words)
        elif words[0] not in SERVERS:
            handtrack.does(*(words if WHOLE else shortened(words)))
            ran.add(words[0])
    assert {"sample", "new", "doctor", "track", "export", "evaluate", "simulate"} <= ran


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_a_person_is_tracked_by_the_page_s_commands(handtrack, tmp_path, monkeypatch):
    project(tmp_path / "p").rename(tmp_path / "my_project")
    for path in (tmp_path / "my_project").glob("pose/*/*.json"):
        if int(path.stem.split("_")[-1]) >= FRAMES:
            path.unlink()
    monkeypatch.chdir(tmp_path)
    for _, *words in lines("start/person.md"):
        handtrack.does(*words)
    assert Session.open("walk").file.hand.model == "body34"
    handtrack.does("size", "walk", "--init", "auto")
    assert read_scale(Path("walk/body.json")).overall == pytest.approx(1.0, abs=0.1)
    track = read_npz("walk/tracks/poses.npz")
    assert len(track) == FRAMES
    there, known = track.joint_names, names()
    shared = [n for n in ("left_wrist", "right_knee", "left_shoulder", "nose") if n in there]
    found = track.joint_positions[:, [there.index(n) for n in shared]]
    true = places()[:FRAMES, [known.index(n) for n in shared]]
    assert np.linalg.norm(found - true, axis=2).mean() < 0.05


def test_a_realsense_recording_becomes_a_session(handtrack, tmp_path, monkeypatch):
    """Of three depth images of 500, 501, 502 units, a frame between the last two was dropped."""
    pytest.importorskip("rosbags")
    monkeypatch.chdir(tmp_path)
    sample("depth/realsense", tmp_path)
    page = "how-to/depth_and_stereo.md"
    (recipe,) = blocks(DOCS / page, "python")
    exec(compile(recipe, page, "exec"), {})
    (words,) = (words for _, *words in lines(page) if words[0] == "new")
    handtrack.does(*words)
    session = Session.open("my_hand")
    depths = [session.view("depth").depth_m(frame) for frame in range(4)]
    there = [None if d is None else float(d[0, 0]) for d in depths]
    assert there == pytest.approx([0.5, 0.501, None, 0.502])
    assert len(session.measured_cloud(0)) > 1000
