"""`handtrack size`: a person's hand or body from a recording into a file, and the file back into a session."""

import json
import os
import re
import shutil
import signal
import time
from pathlib import Path

import pytest

from handtrack import load_model, read_npz
from handtrack.model.model_file import read_scale, scale_from, scale_table
from handtrack.model.size import hand_length_mm
from handtrack.simulation.simulate import Simulation, simulate
from handtrack_app.commands import track as track_command
from tests.app.command_line import QUICK, refused
from tests.session.small_session import edit

LARGER = 1.06
MEAN_MM = hand_length_mm(load_model())


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A hand 6 % larger than the mean, before three small cameras; the session calls it a mean one."""
    what = Simulation(
        frames=6, size=(320, 240), scale=LARGER, images=False, motion="curl", init_noise_m=0.003
    )
    folder = simulate(tmp_path_factory.mktemp("larger") / "session", what)
    edit(folder / "session.toml", f"scale = {LARGER}", "scale = 1.0")
    with (folder / "session.toml").open("a") as file:
        file.write(QUICK)
    return folder


@pytest.fixture
def larger(made, tmp_path):
    return Path(shutil.copytree(made, tmp_path / "session"))


def test_a_size_is_saved_and_used(handtrack, larger):
    def error():
        ended = handtrack.does("track", larger, "--frames", "0:3")
        assert ("mm ±" in ended.out) == (larger / "hand.json").exists(), ended.out
        words = ["evaluate", larger / "tracks/poses.npz", "--truth", larger / "truth.npz", "--json"]
        return json.loads(handtrack(*words).out)["mpjpe_tracked_mm"]

    before = error()
    ended = handtrack.does("size", larger, "--count", "4", "--frames", "0:5")
    assert str(larger / "hand.json") in ended.out
    assert re.search(r"Hand 19[789] mm ± [12], within the adult range\.", ended.out)
    assert read_scale(larger / "hand.json").overall == pytest.approx(LARGER, rel=0.015)
    edit(larger / "session.toml", "scale = 1.0", 'scale = "hand.json"')
    after = error()
    track = read_npz(larger / "tracks/poses.npz")
    assert track.hand_length_mm == pytest.approx(LARGER * MEAN_MM, rel=0.01)
    assert 0 < (track.hand_length_std_mm or 0) < 3
    assert after < 0.5 * before
    assert after < 1.0  # mm

    refused(
        handtrack,
        larger.parent,
        ["size", larger],
        ["--out"],
    )


def test_a_person_of_a_recording_is_what_the_next_one_begins_with(handtrack, larger, tmp_path):
    """A tracked result has the person; half of its frames know them better when they begin with their file."""
    edit(larger / "session.toml", "scale = 1.0", 'scale = "fit"')
    handtrack.does("track", larger)
    ended = handtrack.does(
        "person", larger / "tracks/poses.npz", "--out", larger / "person.toml", "--json"
    )
    found, said = read_scale(larger / "person.toml"), json.loads(ended.out)
    assert found.overall == pytest.approx(LARGER, rel=0.015)
    assert found.parts.keys() >= {"thumb", "index", "middle", "ring", "little"}
    assert "forearm" not in said["not_measured"], "there is none"

    def person_of(*more):
        out = tmp_path / "few.npz"
        out.unlink(missing_ok=True)
        handtrack.does("track", larger, "--frames", "0:3", "--out", out, *more)
        return scale_from(json.loads(read_npz(out).scale), "track")

    both = person_of("--person", str(larger / "person.toml"))
    assert both.std["length_mm"] < found.std["length_mm"]
    edit(larger / "session.toml", 'scale = "fit"', 'scale = "fit"\nperson = "person.toml"')
    assert scale_table(person_of()) == scale_table(both)

    given = larger / "given.npz"
    edit(larger / "session.toml", 'scale = "fit"\n', "scale = 1.0\n")
    refused(handtrack, larger.parent, ["track", larger], ["person.toml"])
    edit(larger / "session.toml", '\nperson = "person.toml"', "")
    handtrack.does("track", larger, "--frames", "0:1", "--out", given)
    refused(handtrack, larger.parent, ["person", given], ["given"])


def test_an_interrupted_size_fit_keeps_what_was_tracked_and_one_that_comes_later_is_told(
    handtrack, larger, monkeypatch
):
    edit(larger / "session.toml", "scale = 1.0", 'scale = "fit"')
    asked = ("track", larger, "--frames", "0:2", "--size-later")
    seen = track_command.TrackingRun.fit_size

    def fit(run, should_stop, **how):
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.01)
        return seen(run, should_stop, **how)

    with monkeypatch.context() as patch:
        patch.setattr(track_command.TrackingRun, "fit_size", fit)
        first = handtrack(*asked[:-1])
        assert (first.code, first.out) == (130, "") and not (larger / "tracks").exists()
        assert handtrack(*asked).code == 130
    assert read_npz(larger / "tracks/poses.npz").frame.tolist() == [0, 1]
    ended = handtrack.does(*asked)
    assert "tracking again" in ended.err
    track = read_npz(larger / "tracks/poses.npz")
    assert track.frame.tolist() == [0, 1]
    assert json.loads(track.scale)["overall"] == pytest.approx(LARGER, rel=0.015)
