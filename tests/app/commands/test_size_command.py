"""`handtrack size`: a person's hand from a recording into a file, and the file back into a session."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import Any

import pytest

from handtrack.model.model_file import load_model, read_scale
from handtrack.model.size import hand_length_mm
from handtrack.session.formats.tables import read_npz
from handtrack.session.run import TrackingRun
from handtrack.simulation.simulate import Simulation, simulate
from handtrack_app.commands import track as track_command
from handtrack_app.commands.terminal.progress import Stop
from tests.app.command_line import CommandLine, refused
from tests.session.small_session import edit

LARGER = 1.06
MEAN_MM = hand_length_mm(load_model())


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A hand 6 % larger than the mean, before three small cameras; the session calls it a mean one."""
    what = Simulation(
        frames=6, size=(320, 240), scale=LARGER, images=False, motion="curl", init_noise_m=0.003
    )
    folder = simulate(tmp_path_factory.mktemp("larger") / "session", what)
    edit(folder / "session.toml", f"scale = {LARGER}", "scale = 1.0")
    return folder


@pytest.fixture
def larger(made: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(made, tmp_path / "session"))


def test_a_size_is_saved_and_used(handtrack: CommandLine, larger: Path) -> None:
    def error() -> float:
        ended = handtrack("track", larger, "--frames", "0:4")
        assert ended.code == 0
        assert ("mm ±" in ended.out) == (larger / "hand.json").exists(), ended.out
        words = ["evaluate", larger / "tracks/poses.npz", "--truth", larger / "truth.npz", "--json"]
        return json.loads(handtrack(*words).out)["mpjpe_tracked_mm"]

    before = error()
    ended = handtrack("size", larger, "--count", "4", "--frames", "0:5")
    assert ended.code == 0, ended.err
    assert f"Saved to {larger / 'hand.json'}" in ended.out
    assert re.search(r"Hand 19[789] mm ± [12], within the adult range\.", ended.out)
    assert 'To use it: in session.toml, [hand], scale = "hand.json".' in ended.out
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
        ["hand.json exists", "not written over", "--out"],
    )


def test_what_cannot_be_sized(handtrack: CommandLine, larger: Path) -> None:
    within = larger.parent
    refused(
        handtrack, within, ["size", larger, "--out", "hand.txt"], ["--out hand.txt", ".json file"]
    )
    refused(
        handtrack,
        within,
        ["size", larger, "--out", larger / "none" / "hand.json"],
        ["there is no folder"],
    )
    refused(
        handtrack, within, ["size", larger, "--count", "0"], ["--count 0", "at least one frame"]
    )
    for camera in ("cam1", "cam2"):  # one camera alone cannot tell a large hand from a near one
        text = (larger / "session.toml").read_text()
        start = text.index(f'[[camera]]\nname = "{camera}"')
        stop = text.find("[[camera]]", start + 1)
        (larger / "session.toml").write_text(text[:start] + (text[stop:] if stop > 0 else ""))
    ended = handtrack("size", larger, "--frames", "0:2")
    assert ended.code == 2
    assert "well enough to tell its size: by cameras whose lines of sight differ" in ended.err
    assert not (larger / "hand.json").exists()


def test_a_size_that_is_fitted_later(handtrack: CommandLine, larger: Path) -> None:
    edit(larger / "session.toml", "scale = 1.0", 'scale = "fit"')
    saved = []
    for name in ("a.npz", "b.npz"):
        out = larger / name
        ended = handtrack("track", larger, "--frames", "0:2", "--size-later", "--out", out)
        assert ended.code == 0, ended.err
        told = [ended.err.index(w) for w in ("to the 2 frames that were tracked", "tracking again")]
        assert told == sorted(told)
        saved.append(out.read_bytes())
    assert saved[0] == saved[1]
    assert read_npz(larger / "a.npz").frame.tolist() == [0, 1]
    size = json.loads(read_npz(larger / "a.npz").scale)["overall"]
    assert size == pytest.approx(LARGER, rel=0.015)


def test_an_interrupted_second_tracking_keeps_the_first(
    handtrack: CommandLine, larger: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    edit(larger / "session.toml", "scale = 1.0", 'scale = "fit"')
    seen = track_command.TrackingRun.fit_size

    def fit(run: TrackingRun, should_stop: Stop, **how: Any) -> TrackingRun:
        should_stop.asked = True
        return seen(run, should_stop, **how)

    monkeypatch.setattr(track_command.TrackingRun, "fit_size", fit)
    ended = handtrack("track", larger, "--frames", "0:2", "--size-later")
    assert ended.code == 130
    assert "the hand's size is not fitted" in ended.err
    assert read_npz(larger / "tracks/poses.npz").frame.tolist() == [0, 1]
